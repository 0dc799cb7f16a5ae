"""Sensors that predict: the agent's own motion without thrust, and the time that is left."""

from __future__ import annotations

import math
from typing import ClassVar, Self

import numpy as np
from pydantic import Field

from safe_inspect.compiling import njit
from safe_inspect.dynamics.coasting import coasting_position, grid, largest_coasting_range, least_coasting_range
from safe_inspect.platforms.base import Sensor
from safe_inspect.simulators.row_terms.inputs import EnvironmentArray, OwnArray
from safe_inspect.simulators.row_terms.loops import RowTerm
from safe_inspect.simulators.simulator import Simulator
from safe_inspect.simulators.view import Group
from safe_inspect.simulators.world import World
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveDuration, PositiveLength

#: Largest cell of the grid on which approaches are bracketed, as an angle of the orbit [rad].
_CELL = 0.25


@njit
def _coasting_ranges(
    position: FloatArray, velocity: FloatArray, table: FloatArray, n: float, reading: FloatArray
) -> None:
    reading[0] = least_coasting_range(position, velocity, table, n)
    reading[1] = largest_coasting_range(position, velocity, table, n)


@njit
def _times_to_limits(
    position: FloatArray,
    velocity: FloatArray,
    table: FloatArray,
    steps: FloatArray,
    nearest: float,
    farthest: float,
    n: float,
    reading: FloatArray,
) -> None:
    """Write the fractions of the duration after which the range falls below `nearest` and rises above `farthest`."""
    reading[0] = reading[1] = 1.0
    crashes = least_coasting_range(position, velocity, table, n) < nearest
    leaves = largest_coasting_range(position, velocity, table, n) > farthest
    state = position[0], position[1], position[2], velocity[0], velocity[1], velocity[2]
    for k in range(steps.shape[0]):
        if not (crashes or leaves):
            break
        x, y, z = coasting_position(n, state, steps[k, 0], steps[k, 1], steps[k, 2])
        square = x * x + y * y + z * z
        if crashes and square < nearest * nearest:
            reading[0], crashes = (k + 1) / steps.shape[0], False
        if leaves and square > farthest * farthest:
            reading[1], leaves = (k + 1) / steps.shape[0], False


@njit
def _share_left(step: int, horizon: int, reading: FloatArray) -> None:
    reading[0] = max(0.0, 1.0 - step / horizon)


class CoastingRangeSensor(Sensor, name="Sensor_CoastingRange"):
    """Closest and farthest range to the origin of Hill's frame if the thrusters stay off from now on [m], shape (R, 2).

    The values are the minimum and the maximum of ``|p(t)|`` over 0 <= t <= `duration`, at all times t, of the
    closed-form solution of the Clohessy-Wiltshire equations. Approaches are bracketed on a grid of at most 0.25 rad of
    the orbit and refined by Newton's method.

    Attributes:
        duration: How long the deputy coasts [s]; default: one orbit.
    """

    elements: ClassVar[tuple[str, ...]] = ("closest", "farthest")
    symbol: ClassVar[str] = "m"
    bounds: ClassVar[tuple[float, float]] = (0.0, np.inf)

    duration: PositiveDuration | None = None

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the closest and the farthest range [m]."""
        n = float(world.mean_motion)
        table = grid(n, 2.0 * math.pi / n if self.duration is None else self.duration, _CELL)
        return RowTerm(_coasting_ranges, (OwnArray("position"), OwnArray("velocity"), table, n))


class CoastingTimeToLimitsSensor(Sensor, name="Sensor_CoastingTimeToLimits"):
    """Times until coasting would end in a crash and beyond the largest range [-], shape (R, 2).

    The values are the fractions of `duration` after which, with the thrusters off, the range to the origin of Hill's
    frame is first below `crash_region_radius` and first above `max_distance` at the end of a control step; 1 if that
    never happens. The motion is the closed-form solution of the Clohessy-Wiltshire equations.

    Attributes:
        duration: How long the deputy coasts [s]; default: one orbit.
        crash_region_radius: Smallest range, that of `CrashDoneFunction` [m].
        max_distance: Largest range, that of `MaxDistanceDoneFunction` [m].
    """

    elements: ClassVar[tuple[str, ...]] = ("time_to_crash", "time_to_exit")
    bounds: ClassVar[tuple[float, float]] = (0.0, 1.0)

    duration: PositiveDuration | None = None
    crash_region_radius: PositiveLength = 10.0
    max_distance: PositiveLength = 800.0

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the two fractions."""
        n = float(world.mean_motion)
        duration = 2.0 * math.pi / n if self.duration is None else self.duration
        angles = n * world.step_size * np.arange(1, max(1, round(duration / world.step_size)) + 1)
        steps = np.stack((angles, np.cos(angles), np.sin(angles)), axis=-1)
        table = grid(n, duration, _CELL)
        limits = self.crash_region_radius, self.max_distance
        return RowTerm(_times_to_limits, (OwnArray("position"), OwnArray("velocity"), table, steps, *limits, n))


class TimeLeftSensor(Sensor, name="Sensor_TimeLeft"):
    """Fraction of the episode that is left, max(0, 1 - step / horizon) [-], shape (R, 1): 1 at the reset, 0 at the end.

    Attributes:
        horizon: Number of steps after which the episode ends [-]; default: that of the task.
    """

    elements: ClassVar[tuple[str, ...]] = ("time_left",)
    bounds: ClassVar[tuple[float, float]] = (0.0, 1.0)

    horizon: int = Field(default=1224, ge=1)

    def in_task(self, simulator: Simulator, horizon: int) -> Self:
        """Return the sensor with the horizon of the task, unless `horizon` is set."""
        return self if "horizon" in self.model_fields_set else self.model_copy(update={"horizon": horizon})

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the fraction that is left [-]."""
        return RowTerm(_share_left, (EnvironmentArray("step"), self.horizon))
