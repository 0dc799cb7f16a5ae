"""Adaptive scale of the delta-v reward: fuel costs more once the inspection succeeds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class DeltaVSchedule:
    """Rule by which the scale changes.

    Attributes:
        start: Initial scale.
        bounds: Smallest and largest scale (both negative: a cost).
        change: Value added when the inspection succeeds (negative: the cost increases).
        steps_until_update: Steps between two updates.
        fractions: If the mean inspected fraction is at most the first value, `change` is subtracted; if it is at least
            the second, it is added.
    """

    start: float
    bounds: tuple[float, float]
    change: float
    steps_until_update: int
    fractions: tuple[float, float]


class DeltaVScale:
    """Scale of each environment slot, which is kept through resets.

    Every slot counts its own steps and averages the inspected fraction at the end of its episodes, so the scale
    depends neither on the batch size nor on the number of workers. An interval in which no episode ended changes
    nothing, and an episode that is abandoned by a reset does not count.
    """

    def __init__(self, schedule: DeltaVSchedule, num_envs: int) -> None:
        self._schedule = schedule
        self.scale: FloatArray = np.full(num_envs, schedule.start)
        self._steps: IntArray = np.zeros(num_envs, dtype=np.int64)
        self._sum: FloatArray = np.zeros(num_envs)
        self._episodes: IntArray = np.zeros(num_envs, dtype=np.int64)
        self._calls_until_due = schedule.steps_until_update

    def state_dict(self) -> dict[str, AnyArray]:
        """Return copies of the complete state, each of shape (N,), for a checkpoint."""
        return {
            "scale": self.scale.copy(),
            "steps": self._steps.copy(),
            "sum": self._sum.copy(),
            "episodes": self._episodes.copy(),
        }

    def load_state_dict(self, state: Mapping[str, AnyArray]) -> None:
        """Continue from the result of `state_dict`; if the number of slots differs, each slot gets the mean scale."""
        if len(state["scale"]) != len(self.scale):
            self.scale[:] = np.clip(np.mean(state["scale"]), *self._schedule.bounds)
            return
        self.scale[:] = np.clip(state["scale"], *self._schedule.bounds)
        self._steps[:], self._sum[:], self._episodes[:] = state["steps"], state["sum"], state["episodes"]
        self._calls_until_due = self._schedule.steps_until_update - int(self._steps.max())

    def take(self, rows: IntArray) -> DeltaVScale:
        """Return a copy for some slots only."""
        part = DeltaVScale(self._schedule, len(rows))
        part.load_state_dict({name: array[rows] for name, array in self.state_dict().items()})
        return part

    def put(self, rows: IntArray, other: DeltaVScale) -> None:
        """Overwrite some slots, shape (R,), with the first R slots of another object."""
        count = len(rows)
        self.scale[rows], self._steps[rows] = other.scale[:count], other._steps[:count]
        self._sum[rows], self._episodes[rows] = other._sum[:count], other._episodes[:count]
        self._calls_until_due = self._schedule.steps_until_update - int(self._steps.max())

    def end_episodes(self, rows: IntArray, fraction: FloatArray) -> None:
        """Record ended episodes by their slots and inspected fractions."""
        self._sum[rows] += fraction
        self._episodes[rows] += 1

    def advance(self, running: BoolArray) -> None:
        """Count one step of the slots whose episode is running, and update the slots whose interval has ended."""
        schedule = self._schedule
        self._steps += running
        self._calls_until_due -= 1
        if self._calls_until_due > 0:  # No slot can be due yet.
            return
        due: BoolArray = self._steps >= schedule.steps_until_update
        mean = self._sum / np.maximum(self._episodes, 1)
        adapts = due & (self._episodes > 0)
        low, high = schedule.fractions
        direction = (adapts & (mean >= high)).astype(np.float64) - (adapts & (mean <= low))
        np.clip(self.scale + direction * schedule.change, *schedule.bounds, out=self.scale)
        for counter in (self._steps, self._sum, self._episodes):
            counter[due] = 0
        self._calls_until_due = schedule.steps_until_update - int(self._steps.max())
