"""Sensors of what lies ahead: the own motion without thrust, and the time that is left."""

from __future__ import annotations

import math
from typing import ClassVar, Self

import numpy as np
from pydantic import Field

from safe_inspect.compiling import njit
from safe_inspect.dynamics.coasting import grid, largest_coasting_range, least_coasting_range
from safe_inspect.platforms.base import Sensor
from safe_inspect.simulators.row_terms.inputs import EnvironmentArray, OwnArray
from safe_inspect.simulators.row_terms.loops import RowTerm
from safe_inspect.simulators.simulator import Simulator
from safe_inspect.simulators.view import Group
from safe_inspect.simulators.world import World
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveDuration

#: Widest cell of the grid on which approaches are bracketed, as an angle of the orbit [rad].
_CELL = 0.25


@njit
def _coasting_ranges(
    position: FloatArray, velocity: FloatArray, table: FloatArray, n: float, reading: FloatArray
) -> None:
    reading[0] = least_coasting_range(position, velocity, table, n)
    reading[1] = largest_coasting_range(position, velocity, table, n)


@njit
def _share_left(step: int, horizon: int, reading: FloatArray) -> None:
    reading[0] = max(0.0, 1.0 - step / horizon)


class CoastingRangeSensor(Sensor, name="Sensor_CoastingRange"):
    """Closest and farthest range to the origin of Hill's frame if the thrusters stay off from now on [m], shape (R, 2).

    The two are the least and the largest of ``|p(t)|`` over 0 <= t <= `duration` of the closed-form solution of the
    Clohessy-Wiltshire equations, at all times t: approaches are bracketed on a grid of at most 0.25 rad of the orbit
    and refined by Newton's method.

    Attributes:
        duration: How long the deputy coasts [s]; one orbit unless given.
    """

    elements: ClassVar[tuple[str, ...]] = ("closest", "farthest")
    symbol: ClassVar[str] = "m"
    bounds: ClassVar[tuple[float, float]] = (0.0, np.inf)

    duration: PositiveDuration | None = None

    def row(self, world: World, group: Group) -> RowTerm:
        """Write the closest and the farthest range [m]."""
        n = float(world.mean_motion)
        table = grid(n, 2.0 * math.pi / n if self.duration is None else self.duration, _CELL)
        return RowTerm(_coasting_ranges, (OwnArray("position"), OwnArray("velocity"), table, n))


class TimeLeftSensor(Sensor, name="Sensor_TimeLeft"):
    """Share of the episode that is left, max(0, 1 - step / horizon) [-], shape (R, 1): 1 at the reset, 0 at the end.

    Attributes:
        horizon: Number of steps after which the episode ends [-]; that of the task unless given.
    """

    elements: ClassVar[tuple[str, ...]] = ("time_left",)
    bounds: ClassVar[tuple[float, float]] = (0.0, 1.0)

    horizon: int = Field(default=1224, ge=1)

    def in_task(self, simulator: Simulator, horizon: int) -> Self:
        """Return the sensor with the horizon of the task, unless one was given."""
        return self if "horizon" in self.model_fields_set else self.model_copy(update={"horizon": horizon})

    def row(self, world: World, group: Group) -> RowTerm:
        """Write the share that is left [-]."""
        return RowTerm(_share_left, (EnvironmentArray("step"), self.horizon))
