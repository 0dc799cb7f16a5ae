"""The files of a mission: its log with a row for each control step, and `read_mission` for replays and figures.

``log.npz`` holds, with SI units, positions in W and quaternions from a body's axes to W: the time ``t`` and the index
of the phase ``state``; the truth at the start of the step, of the chaser ``x`` (position and velocity), ``q``, ``w``
(angular velocity in B) and of the target ``target_q``, ``target_w`` (in T); the estimates ``estimated_x``,
``estimated_q``, ``estimated_target_p``, ``_q``, ``_w``, ``estimated_ratios`` (J1/J3, J2/J3), ``sigma`` (of attitude
[rad] and rate [rad/s]) and ``nees``; ``reference``, the position and velocity that the chaser follows; in B, the
commands ``force`` and ``torque``, what the actuators gave for them without their lag, ``flown`` (force and torque), and
with it at the end of the step, ``wrench``; the least ``clearance`` during the step; of the tube, NaN without an
approach, the ``margin`` that the clearance must keep, its half width ``tube`` about the true reference and its
share of the force ``tube_force``; and ``pointing_error`` of the camera [rad].
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic_core import to_json

from safe_inspect.dynamics.quaternion import conjugate, multiply, rotate, to_matrix
from safe_inspect.errors import UNREADABLE_ARRAYS, CheckpointError, SafeInspectError
from safe_inspect.rendezvous.coordination.context import Phase
from safe_inspect.rendezvous.experiment import RendezvousConfig, load_rendezvous
from safe_inspect.rendezvous.planner.query import Plan, PlanStatus
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import AnyArray, FloatArray

EVENTS, ARRAYS, SUMMARY, CONFIG = "events.jsonl", "log.npz", "summary.json", "config.resolved.yml"
#: What is written of a plan: attributes of `Plan`.
_OF_PLANS = ("t_start", "times", "position", "velocity", "force", "position_target")
#: The arrays that every log must have, with the shape of one control step.
_STEP_SHAPES = {
    "t": (), "state": (), "x": (6,), "q": (4,), "w": (3,), "target_q": (4,), "target_w": (3,),
    "estimated_target_q": (4,), "reference": (6,), "force": (3,), "torque": (3,),
    "flown": (6,), "clearance": (), "margin": (), "tube": (), "tube_force": (), "pointing_error": (),
}  # fmt: skip
#: Likewise, of the arrays that a log of an earlier version may lack.
_OTHER_SHAPES = {
    "estimated_x": (6,), "estimated_q": (4,), "estimated_target_p": (3,), "estimated_target_w": (3,),
    "estimated_ratios": (2,), "nees": (), "sigma": (2,), "wrench": (6,),
}  # fmt: skip


@dataclass(eq=False)
class MissionLog:
    """The log of one mission, in memory.

    Attributes:
        events: What happened, in order: tick, t, state, event and data.
        rows: The rows of each array, one for each control step, by name.
        plans: The plans that the chaser has followed.
    """

    events: list[dict[str, Any]] = field(default_factory=list)
    rows: dict[str, list[AnyArray]] = field(default_factory=dict)
    plans: list[Plan] = field(default_factory=list)

    def event(self, tick: int, time: float, state: str, name: str, data: dict[str, Any]) -> None:
        """Add an event."""
        self.events.append({"tick": tick, "t": round(time, 6), "state": state, "event": name, "data": data})

    def add(self, **values: Any) -> None:
        """Add the values of one control step, by name."""
        for name, value in values.items():
            self.rows.setdefault(name, []).append(np.array(value))

    def arrays(self) -> dict[str, AnyArray]:
        """Return the arrays by name; their first axis is the control steps."""
        return {name: np.stack(rows) for name, rows in self.rows.items()}

    def write(self, folder: Path, config: str, summary: dict[str, Any]) -> None:
        """Write the files of a mission into an existing folder."""
        (folder / CONFIG).write_text(config, encoding="utf-8")
        lines = [json_text(event) for event in self.events]
        (folder / EVENTS).write_text("\n".join(lines) + "\n", encoding="utf-8")
        np.savez_compressed(folder / ARRAYS, **self.arrays())  # type: ignore[arg-type]
        for index, plan in enumerate(self.plans):
            np.savez_compressed(folder / f"plan_{index}.npz", **{name: getattr(plan, name) for name in _OF_PLANS})
        (folder / SUMMARY).write_text(json_text(summary, 2) + "\n", encoding="utf-8")


def json_text(value: Any, indent: int | None = None) -> str:
    """Return a value, with arrays and numbers of NumPy, as JSON; numbers that are not finite become null."""
    return to_json(value, indent=indent, inf_nan_mode="null", fallback=lambda array: array.tolist()).decode()


class PhaseInterval(NamedTuple):
    """A period of a mission in one phase.

    Attributes:
        phase: The phase.
        start: Time at which the phase was entered [s].
        end: Time at which the phase was left [s].
    """

    phase: Phase
    start: float
    end: float


@dataclass(frozen=True, eq=False)
class MissionRecord:
    """A mission that was flown, as read from its files.

    Attributes:
        config: The experiment.
        target: The target.
        arrays: The arrays by name; their first axis is the control steps.
        plans: The plans that the chaser has followed; only some of their arrays are recorded.
        events: The events, in order.
        summary: The summary; see `summarise_mission`.
    """

    config: RendezvousConfig
    target: Target
    arrays: dict[str, AnyArray]
    plans: tuple[Plan, ...]
    events: tuple[dict[str, Any], ...]
    summary: dict[str, Any]

    def phases(self) -> list[PhaseInterval]:
        """Return the phases in order, without those that were entered and left in the same control step."""
        time, state = self.arrays["t"], self.arrays["state"]
        starts = np.flatnonzero(np.diff(state, prepend=state[0] - 1))
        ends = np.append(time[starts[1:]], time[-1] + self.config.mission.step)
        phases = list(Phase)
        spans = zip(starts, ends, strict=True)
        return [PhaseInterval(phases[state[k]], float(time[k]), float(end)) for k, end in spans]

    def approach(self) -> int:
        """Return the control step at which the first approach starts, or 0 if there is none."""
        return int(np.argmax(self.arrays["state"] == Phase.TRACK.number))

    def until(self, time: float) -> MissionRecord:
        """Return the mission up to a time [s]."""
        shown = self.arrays["t"] <= time
        return replace(
            self,
            arrays={name: array[shown] for name, array in self.arrays.items()},
            plans=tuple(plan for plan in self.plans if plan.times[0] <= time),
        )

    def position_in_target(self) -> FloatArray:
        """Return the chaser's position in T [m], shape (K, 3)."""
        return rotate(conjugate(self.arrays["target_q"]), self.arrays["x"][:, :3])

    def believed_target(self, row: int) -> tuple[FloatArray, FloatArray] | None:
        """Return where the chaser believes the target, as seen from its true pose: R and d [m], both in the true T.

        A point p of the target, in T, is believed at ``R p + d``. None if the motion of the target is not known, if
        the pilot knows the truth, or if the log has no estimates.

        Args:
            row: The control step.
        """
        arrays = {name: array[row] for name, array in self.arrays.items()}
        if "estimated_q" not in arrays or not 0.0 < arrays["sigma"][0] < 1.0:
            return None
        to_target, to_believed = conjugate(arrays["target_q"]), conjugate(arrays["estimated_target_q"])
        body, believed_body = multiply(to_target, arrays["q"]), multiply(to_believed, arrays["estimated_q"])
        rotation = to_matrix(multiply(body, conjugate(believed_body)))
        seen = rotate(to_believed, arrays["estimated_x"][:3] - arrays["estimated_target_p"])
        return rotation, rotate(to_target, arrays["x"][:3]) - rotation @ seen

    def force_in_inertial(self) -> FloatArray:
        """Return the commanded force in W [N], shape (K, 3)."""
        return rotate(self.arrays["q"], self.arrays["force"])

    def mating_distance(self) -> FloatArray:
        """Return the distance of the chaser from the mating point [m], shape (K,)."""
        return np.asarray(np.linalg.norm(self.position_in_target() - self.target.mating_point, axis=1))


def read_mission(folder: str | os.PathLike[str]) -> MissionRecord:
    """Read a mission from its folder.

    Raises:
        CheckpointError: A file is missing or damaged.
        ConfigError: The experiment is no longer valid.
    """
    path = Path(folder).expanduser()
    for name in (CONFIG, ARRAYS, EVENTS, SUMMARY):
        if not (path / name).is_file():
            raise CheckpointError(f"{path}: there is no {name}; give the folder of a mission")
    config = load_rendezvous((path / CONFIG).resolve()).config
    arrays = _arrays(path / ARRAYS)
    _check_shapes(path / ARRAYS, arrays)
    plans: list[Plan] = []
    while (file := path / f"plan_{len(plans)}.npz").is_file():
        own: dict[str, Any] = _arrays(file)
        missing = [name for name in _OF_PLANS if name not in own]
        if missing:
            raise _damaged(file, f"no array {missing[0]}")
        values = {name: own[name][()] for name in _OF_PLANS}
        plans.append(Plan(PlanStatus.SOLVED, duration=float(np.ptp(own["times"])), **values))
    lines = (path / EVENTS).read_text(encoding="utf-8", errors="replace").splitlines()
    events = tuple(_json(path / EVENTS, line) for line in lines if line.strip())
    summary = _json(path / SUMMARY, (path / SUMMARY).read_text(encoding="utf-8", errors="replace"))
    return MissionRecord(config, config.target(), arrays, tuple(plans), events, summary)


def _arrays(file: Path) -> dict[str, AnyArray]:
    try:
        with np.load(file) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except UNREADABLE_ARRAYS as error:
        raise _damaged(file, str(error).partition("\n")[0] or type(error).__name__) from None


def _check_shapes(file: Path, arrays: dict[str, AnyArray]) -> None:
    steps = len(arrays["t"]) if "t" in arrays and arrays["t"].ndim == 1 else 0
    missing = [name for name in _STEP_SHAPES if name not in arrays]
    if missing:
        raise _damaged(file, f"no array {missing[0]}")
    for name, shape in (_STEP_SHAPES | {name: _OTHER_SHAPES[name] for name in _OTHER_SHAPES if name in arrays}).items():
        if not steps or arrays[name].shape != (steps, *shape):
            raise _damaged(file, f"{name} has the shape {arrays[name].shape}, not {(steps or 'K', *shape)}")
    if not np.isin(arrays["state"], np.arange(len(Phase))).all():
        raise _damaged(file, "state has a number that is not a phase")
    for name in ("x", "q", "target_q"):
        if not np.isfinite(arrays[name]).all():
            raise _damaged(file, f"{name} is not finite")


def _json(file: Path, text: str) -> dict[str, Any]:
    try:
        value = json.loads(text)
    except ValueError as error:
        raise _damaged(file, str(error)) from None
    if not isinstance(value, dict):
        raise _damaged(file, "not a mapping of names to values")
    return value


def _damaged(file: Path, reason: str) -> SafeInspectError:
    return CheckpointError(f"{file}: the file cannot be read ({reason}); fly the mission again")
