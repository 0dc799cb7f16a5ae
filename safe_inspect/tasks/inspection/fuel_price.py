"""`FuelPriceSchedule`: makes fuel more expensive once the inspection succeeds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from safe_inspect.dynamics.base import NO_DISTURBANCE, DisturbanceBounds, MotionLimits
from safe_inspect.simulators.component import Component, RunningComponent
from safe_inspect.simulators.offers import OfView
from safe_inspect.simulators.state import State
from safe_inspect.simulators.world import World
from safe_inspect.tasks.inspection.delta_v_scale import DeltaVScale, DeltaVSchedule
from safe_inspect.types import AnyArray, ArraySpec, BoolArray, IntArray

_SCALE = "delta_v_scale"


class FuelPriceSchedule(Component):
    """Scale of the delta-v reward for each environment slot, which is kept through resets; see `DeltaVScale`.

    Array: ``delta_v_scale`` [1/(m/s)], shape (N,).

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
    def _consistent(self) -> FuelPriceSchedule:
        for field in ("delta_v_scale_bounds", "inspected_points_update_bounds"):
            check_interval(field, *getattr(self, field))
        return self

    def disturbance_bounds(self, limits: MotionLimits) -> DisturbanceBounds:
        """Return zero bounds: the schedule does not affect the motion of deputies."""
        return NO_DISTURBANCE

    def __call__(self, world: World, num_envs: int) -> RunningComponent:
        """Return the running schedule."""
        schedule = DeltaVSchedule(
            start=self.delta_v_scale_bounds[1],
            bounds=self.delta_v_scale_bounds,
            change=self.delta_v_scale_step,
            steps_until_update=self.steps_until_update,
            fractions=self.inspected_points_update_bounds,
        )
        return _RunningSchedule(schedule, world, num_envs, self.delta_v_updater_criteria == "score")


def check_interval(field: str, low: float, high: float) -> None:
    """Check that a pair of bounds is in order.

    Raises:
        ValueError: It is not.
    """
    if not low <= high:
        raise ValueError(f"`{field}` is [low, high], but {low} is above {high}; swap them")


class _RunningSchedule(RunningComponent):
    arrays = {_SCALE: ArraySpec(())}  # noqa: RUF012 - never written

    def __init__(self, schedule: DeltaVSchedule, world: World, num_envs: int, by_score: bool) -> None:
        self._schedule, self._num_envs, self._by_score = schedule, num_envs, by_score
        self._points = next(iter(world.offers.world.get("points", {}).values()), None)
        self._scale = DeltaVScale(schedule, num_envs)

    def resume(self, state: State, rows: IntArray) -> None:
        state[_SCALE][:] = self._scale.scale[rows]

    def step(self, state: State, running: BoolArray) -> None:
        self._scale.advance(running)
        state[_SCALE][:] = self._scale.scale

    def end(self, state: State, rows: IntArray) -> None:
        if self._points is not None:
            points = state.points[self._points.entity]
            found = points.team_score[rows] if self._by_score else points.team_count[rows] / self._points.num_points
            self._scale.end_episodes(rows, found)

    def part(self, rows: IntArray) -> RunningComponent:
        part = copy(self)
        part._scale = self._scale.take(rows)
        return part

    def join(self, part: _RunningSchedule, rows: IntArray) -> None:
        self._scale.put(rows, part._scale)

    def restart(self) -> None:
        self._scale = DeltaVScale(self._schedule, self._num_envs)

    def state_dict(self) -> dict[str, AnyArray]:
        return self._scale.state_dict()

    def load_state_dict(self, state: Mapping[str, AnyArray]) -> None:
        self._scale.load_state_dict({name: np.asarray(array) for name, array in state.items()})

    def of_view(self) -> Mapping[str, Callable[[Any], Any]]:
        return {_SCALE: OfView(_SCALE)}
