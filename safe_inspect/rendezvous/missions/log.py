"""The log of a mission: events, arrays with a row for each control step, and a summary."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from safe_inspect.rendezvous.planner.query import Plan
from safe_inspect.types import AnyArray

EVENTS, ARRAYS, SUMMARY, CONFIG = "events.jsonl", "log.npz", "summary.json", "config.resolved.yml"


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
        lines = [json.dumps(json_value(event), allow_nan=False) for event in self.events]
        (folder / EVENTS).write_text("\n".join(lines) + "\n", encoding="utf-8")
        np.savez_compressed(folder / ARRAYS, **self.arrays())  # type: ignore[arg-type]
        for index, plan in enumerate(self.plans):
            np.savez_compressed(
                folder / f"plan_{index}.npz",
                t_start=plan.t_start,
                times=plan.times,
                position=plan.position,
                velocity=plan.velocity,
                force=plan.force,
                position_target=plan.position_target,
            )
        (folder / SUMMARY).write_text(
            json.dumps(json_value(summary), indent=2, allow_nan=False) + "\n", encoding="utf-8"
        )


def json_value(value: Any) -> Any:
    """Return a value that JSON can store; numbers that are not finite become null."""
    if isinstance(value, dict):
        return {key: json_value(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [json_value(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
