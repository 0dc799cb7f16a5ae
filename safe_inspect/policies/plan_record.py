"""The file of the optimiser: the plans and results of its episodes."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from safe_inspect.errors import SafeInspectError
from safe_inspect.outputs import new_file
from safe_inspect.types import FloatArray

_FORMAT = 1
#: Fields of an entry that are columns of the file as they are.
_COLUMNS = ("success", "steps", "inspected", "burns", "planned", "inspector", "own")


class Burn(BaseModel):
    """One burn of a plan.

    Attributes:
        step: Step of the episode with which it starts, from 0.
        steps: Its number of steps.
        thrust: Thrust held during these steps [N], Hill frame.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    step: int = Field(ge=0)
    steps: int = Field(default=1, ge=1)
    thrust: tuple[float, float, float]


FlightPlan = tuple[Burn, ...]

_PLAN: TypeAdapter[FlightPlan] = TypeAdapter(FlightPlan)


def flight_plan(thrust: FloatArray) -> FlightPlan:
    """Return a plan with the thrust of every step [N], shape (T, 3); steps with the same thrust are one burn."""
    changes = np.flatnonzero(np.diff(thrust, axis=0, prepend=0.0, append=0.0).any(axis=1)).tolist()
    return tuple(
        Burn(step=begin, steps=end - begin, thrust=tuple(thrust[begin].tolist()))
        for begin, end in pairwise(changes)
        if thrust[begin].any()
    )


@dataclass(frozen=True)
class Entry:
    """One episode with an open-loop plan.

    Attributes:
        key: Random key of the episode.
        success: Whether it was won.
        delta_v: Velocity change spent, mean over the deputies [m/s].
        steps: Number of steps.
        inspected: Number of points inspected.
        burns: Number of burns, mean over the deputies.
        plan: The plan that was executed.
        planned: Velocity change of the plan that the search found [m/s]; None if it found none.
        inspector: Velocity change of the scripted inspector in this episode [m/s]; None if it fails or was not run.
        own: Whether the plan is that of the search; else it is the trajectory of the inspector.
    """

    key: int
    success: bool
    delta_v: float
    steps: int
    inspected: int
    burns: float
    plan: FlightPlan = ()
    planned: float | None = None
    inspector: float | None = None
    own: bool = True


@dataclass(frozen=True)
class Record:
    """The plans of the episodes of environment slots 0, 1, 2, ...

    Attributes:
        seed: Seed of the run.
        effort: Extent of the search.
        task: The part of a task that makes episodes comparable; see `safe_inspect.evaluation.task.task_of`.
        about: Origin of the numbers: version, configuration file, overrides.
        entries: The episodes.
    """

    seed: int
    effort: str
    task: Mapping[str, Any]
    about: Mapping[str, Any]
    entries: tuple[Entry, ...] = ()

    def difference(self, other: Record) -> str:
        """Return in what another record differs as a run; empty if it is of the same run."""
        for what in ("seed", "effort"):
            if getattr(self, what) != getattr(other, what):
                return f"the {what} is {getattr(other, what)!r} there and {getattr(self, what)!r} here"
        if self.about.get("safe_inspect") != other.about.get("safe_inspect"):
            return f"it was made by version {other.about.get('safe_inspect')}"
        return "" if self.task == other.task else "it is of another task"

    def as_dict(self) -> dict[str, Any]:
        """Return the content of the file."""
        entries = self.entries
        return {
            "format": _FORMAT,
            "kind": "optimiser",
            "seed": self.seed,
            "episodes": len(entries),
            "effort": self.effort,
            # A plan that fails is no reference for the cost of a success.
            "delta_v": [entry.delta_v if entry.success else None for entry in entries],
            "spent": [entry.delta_v for entry in entries],
            **{name: [getattr(entry, name) for entry in entries] for name in _COLUMNS},
            "keys": [f"{entry.key:016x}" for entry in entries],
            "plans": [_PLAN.dump_python(entry.plan, mode="json") for entry in entries],
            **self.about,
            "task": self.task,
        }


def read_record(path: str | os.PathLike[str]) -> Record:
    """Return the record in a file.

    Raises:
        SafeInspectError: The file cannot be read, or has no record.
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
        if content["format"] != _FORMAT:
            raise ValueError(f"its format is {content['format']}, not {_FORMAT}")
        entries = tuple(
            Entry(
                key=int(content["keys"][row], 16),
                delta_v=content["spent"][row],
                plan=_PLAN.validate_python(content["plans"][row]),
                **{name: content[name][row] for name in _COLUMNS},
            )
            for row in range(content["episodes"])
        )
        about = {name: content[name] for name in ("safe_inspect", "configuration_file", "overrides")}
        return Record(content["seed"], content["effort"], content["task"], about, entries)
    except OSError as error:
        raise SafeInspectError(f"{path}: the file cannot be read ({error.strerror}); give another file") from None
    except (ValueError, KeyError, TypeError, IndexError, ValidationError) as error:
        reason = f"no {error}" if isinstance(error, KeyError) else str(error).partition("\n")[0]
        raise SafeInspectError(
            f"{path}: not a file of `safe-inspect baseline optimiser` ({reason}); give another file"
        ) from None


def write_record(record: Record, path: Path) -> None:
    """Write a record to a file.

    Raises:
        OutputError: The file cannot be written.
    """
    with new_file(path) as work:
        work.write_text(json.dumps(record.as_dict(), allow_nan=False) + "\n", encoding="utf-8")
