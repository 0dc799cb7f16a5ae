"""`FuelPriceSchedule`: makes fuel more expensive once the inspection succeeds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators import OfView, PassiveComponent, RunningComponent, State, World
from safe_inspect.tasks.inspection.points_view import PointsModel
from safe_inspect.types import AnyArray, ArraySpec, BoolArray, FloatArray, IntArray

_SCALE = "delta_v_scale"


class FuelPrice(Plugin):
    """Fields of the plugins that set the scale of the delta-v reward, a cost.

    Attributes:
        steps_until_update: Steps of a slot between two updates of its scale.
        delta_v_scale_bounds: Smallest and largest scale [1/(m/s)]; it starts at the largest.
        delta_v_scale_step: Change of the scale at an update.
        inspected_points_update_bounds: The step is subtracted from the scale if the mean inspected fraction at the end
            of an episode is at most the first value, and added if it is at least the second.
        delta_v_updater_criteria: Quantity that is compared: ``count``, the inspected fraction of the points, or
            ``score``, the summed weight of the inspected points.
    """

    steps_until_update: int = Field(default=1500, ge=1)
    delta_v_scale_bounds: tuple[float, float] = (-0.1, -0.001)
    delta_v_scale_step: float = -0.00005
    inspected_points_update_bounds: tuple[float, float] = (0.8, 0.9)
    delta_v_updater_criteria: Literal["count", "score"] = "count"

    @model_validator(mode="after")
    def _consistent(self) -> FuelPrice:
        for field in ("delta_v_scale_bounds", "inspected_points_update_bounds"):
            low, high = getattr(self, field)
            if not low <= high:
                raise ValueError(f"`{field}` is [low, high], but {low} is above {high}; swap them")
        return self


class FuelPriceSchedule(FuelPrice, PassiveComponent):
    """Scale of the delta-v reward for each environment slot, which is kept through resets.

    Every slot counts its own steps and averages the inspected fraction at the end of its episodes, so the scale
    depends neither on the batch size nor on the number of workers. An interval in which no episode ended changes
    nothing, and an episode that is abandoned by a reset does not count.

    Array: ``delta_v_scale`` [1/(m/s)], shape (N,).
    """

    def __call__(self, world: World, num_envs: int) -> RunningComponent:
        """Return the running schedule."""
        return _RunningSchedule(self, num_envs, next(iter(world.offers.world.get("points", {}).values()), None))


class _RunningSchedule(RunningComponent):
    arrays = {_SCALE: ArraySpec(())}  # noqa: RUF012 - never written
    offered = {_SCALE: OfView}  # noqa: RUF012 - never written

    def __init__(self, schedule: FuelPrice, num_envs: int, points: PointsModel | None = None) -> None:
        self._schedule, self._num_envs, self._points = schedule, num_envs, points
        self.restart()

    def restart(self) -> None:
        self.scale: FloatArray = np.full(self._num_envs, self._schedule.delta_v_scale_bounds[1])
        self._steps: IntArray = np.zeros(self._num_envs, dtype=np.int64)
        self._sum: FloatArray = np.zeros(self._num_envs)
        self._episodes: IntArray = np.zeros(self._num_envs, dtype=np.int64)

    def resume(self, state: State, rows: IntArray) -> None:
        state[_SCALE][:] = self.scale[rows]

    def step(self, state: State, running: BoolArray) -> None:
        self.advance(running)
        state[_SCALE][:] = self.scale

    def end(self, state: State, rows: IntArray) -> None:
        if self._points is not None:
            points, by_score = state.points[self._points.entity], self._schedule.delta_v_updater_criteria == "score"
            found = points.team_score[rows] if by_score else points.team_count[rows] / self._points.num_points
            self.end_episodes(rows, found)

    def part(self, rows: IntArray) -> _RunningSchedule:
        part = _RunningSchedule(self._schedule, len(rows), self._points)
        part.load_state_dict({name: array[rows] for name, array in self.state_dict().items()})
        return part

    def join(self, part: _RunningSchedule, rows: IntArray) -> None:
        count = len(rows)
        self.scale[rows], self._steps[rows] = part.scale[:count], part._steps[:count]
        self._sum[rows], self._episodes[rows] = part._sum[:count], part._episodes[:count]

    def state_dict(self) -> dict[str, AnyArray]:
        own = {"scale": self.scale, "steps": self._steps, "sum": self._sum, "episodes": self._episodes}
        return {name: array.copy() for name, array in own.items()}

    def load_state_dict(self, state: Mapping[str, AnyArray]) -> None:
        """Continue from the result of `state_dict`; if the number of slots differs, each slot gets the mean scale."""
        bounds = self._schedule.delta_v_scale_bounds
        if len(state["scale"]) != len(self.scale):
            self.scale[:] = np.clip(np.mean(state["scale"]), *bounds)
            return
        self.scale[:] = np.clip(state["scale"], *bounds)
        self._steps[:], self._sum[:], self._episodes[:] = state["steps"], state["sum"], state["episodes"]

    def end_episodes(self, rows: IntArray, fraction: FloatArray) -> None:
        """Record ended episodes by their slots and inspected fractions."""
        self._sum[rows] += fraction
        self._episodes[rows] += 1

    def advance(self, running: BoolArray) -> None:
        """Count one step of the slots whose episode is running, and update the slots whose interval has ended."""
        schedule = self._schedule
        self._steps += running
        due: BoolArray = self._steps >= schedule.steps_until_update
        if not due.any():
            return
        mean = self._sum / np.maximum(self._episodes, 1)
        adapts = due & (self._episodes > 0)
        low, high = schedule.inspected_points_update_bounds
        direction = (adapts & (mean >= high)).astype(np.float64) - (adapts & (mean <= low))
        np.clip(self.scale + direction * schedule.delta_v_scale_step, *schedule.delta_v_scale_bounds, out=self.scale)
        for counter in (self._steps, self._sum, self._episodes):
            counter[due] = 0
