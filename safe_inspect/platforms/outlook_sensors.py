"""Sensors that predict: the agent's own motion without thrust, what it would inspect, and the time that is left."""

from __future__ import annotations

import math
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from safe_inspect.compiling import njit
from safe_inspect.dynamics.coasting import coasting_position, grid, largest_coasting_range, least_coasting_range
from safe_inspect.geometry.visibility import inspect_in_view, point_axes
from safe_inspect.platforms.base import Sensor
from safe_inspect.plugins.plugin import PointsName
from safe_inspect.simulators import Group, Simulator, World
from safe_inspect.simulators.row_terms import EnvironmentArray, OwnArray, RowTerm
from safe_inspect.tasks.inspection.rotation import ChiefRotation, rotating_body
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


#: Fractions of the coasting time after which the remaining points are counted.
_PARTS = (0.125, 0.25, 0.5, 1.0)
#: Largest interval between two predicted positions, as an angle of the orbit [rad].
_PREDICTED_CELL = 0.05


@njit
def _left_after_coasting(
    position: FloatArray,
    velocity: FloatArray,
    inspector: NDArray[np.int8],
    direction: FloatArray,
    step: int,
    table: FloatArray,
    axes: FloatArray,
    constants: FloatArray,
    reading: FloatArray,
) -> None:
    """Write the shares of remaining points, and the mean direction of the points that remain at the end.

    Args:
        position: Position relative to the body [m], shape (3,).
        velocity: Velocity [m/s], shape (3,).
        inspector: Deputy that inspected each point, -1 for none, shape (P,).
        direction: Unit vector to the sun, Hill frame, shape (3,).
        step: Control steps since the reset.
        table: For each predicted position: control steps, angle of the orbit and its cosine and sine, cosine and sine
            of the angle by which the sun has turned, and whether a share is written after it, shape (K, 7).
        axes: The points [m], shape (3, P).
        constants: Radius squared and the terminator, see `inspect_in_view`, mean motion [rad/s], control
            steps of an episode, and the edge of the Earth's shadow, see `Shadow`, shape (5,).
        reading: Output: the result, shape (7,).
    """
    horizon, terminator, n, last, edge = constants
    state = position[0], position[1], position[2], velocity[0], velocity[1], velocity[2]
    found, total, noted = inspector.copy(), len(inspector), 0
    x, y = direction[0], direction[1]
    for k in range(table.shape[0]):
        steps, angle, cos, sin, cos_turn, sin_turn, notes = table[k]
        if step + steps <= last:
            viewer = coasting_position(n, state, angle, cos, sin)
            sun = x * cos_turn + y * sin_turn, y * cos_turn - x * sin_turn, direction[2]
            if sun[0] >= edge:
                inspect_in_view(viewer, sun, axes, horizon, terminator, 0, found)
        if notes:
            left = 0
            for p in range(total):
                left += found[p] < 0
            reading[noted] = left / total
            noted += 1
    left = 0
    reading[noted:] = 0.0
    for p in range(total):
        if found[p] < 0:
            left += 1
            for axis in range(3):
                reading[noted + axis] += axes[axis, p]
    length = math.sqrt(horizon) * max(left, 1)
    for axis in range(3):
        reading[noted + axis] /= length


class CoastingInspectionSensor(Sensor, name="Sensor_CoastingInspection"):
    """Points that would remain uninspected if the thrusters stayed off from now on [-], shape (R, 7).

    The first four elements are shares of all points: those that are still uninspected, by all deputies up to now and by
    this deputy while coasting, after an eighth, a quarter, a half and the whole of `duration`, or at the horizon of the
    episode if that is earlier. The last three are the mean (x, y, z) of the unit vectors, Hill frame, of the points
    that remain at the end, zeros if there are none. The trajectory is the closed-form solution of the
    Clohessy-Wiltshire equations, evaluated at intervals of at most 0.05 rad of the orbit. An eclipse counts; other
    deputies, collisions, the range limit and the camera's field of view do not.

    Attributes:
        inspection_entity_name: The body that carries the points, at the origin of Hill's frame.
        duration: How long the deputy coasts [s]; default: one orbit.
        horizon: Number of steps after which the episode ends [-]; default: that of the task.
    """

    elements: ClassVar[tuple[str, ...]] = ("left_eighth", "left_quarter", "left_half", "left", "x", "y", "z")
    bounds: ClassVar[tuple[float, float]] = (-1.0, 1.0)

    inspection_entity_name: PointsName = "chief"
    duration: PositiveDuration | None = None
    horizon: int = Field(default=1224, ge=1)

    def in_task(self, simulator: Simulator, horizon: int) -> Self:
        """Return the sensor with the horizon of the task, unless `horizon` is set.

        Raises:
            ValueError: The body turns.
        """
        for component in simulator.compose()[1]:
            turns = isinstance(component, ChiefRotation) and component.entity_name == self.inspection_entity_name
            self._require_still(turns)
        return self if "horizon" in self.model_fields_set else self.model_copy(update={"horizon": horizon})

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the shares and the mean direction [-].

        Raises:
            ValueError: The body turns.
        """
        name, model = self.inspection_entity_name, world.points[self.inspection_entity_name]
        self._require_still(name == rotating_body(world))
        radius, shadow = model.radius, world.offers.world.get("shadow")
        edge = -math.inf if shadow is None else shadow.edge
        return RowTerm(
            _left_after_coasting,
            (
                OwnArray("position"),
                OwnArray("velocity"),
                EnvironmentArray(f"points/{name}/inspector"),
                EnvironmentArray("sun_direction"),
                EnvironmentArray("step"),
                self._table(world),
                point_axes(model.points),
                np.array([radius * radius, model.terminator, world.mean_motion, self.horizon, edge]),
            ),
        )

    def _require_still(self, turns: bool) -> None:
        if turns:
            text = f"needs a body that does not turn, but {self.inspection_entity_name!r} turns; remove the sensor"
            raise ValueError(f"{self.registered_name} {text}")

    def _table(self, world: World) -> FloatArray:
        n = float(world.mean_motion)
        duration = 2.0 * math.pi / n if self.duration is None else self.duration
        last = max(1, round(duration / world.step_size))
        stride = max(1, int(_PREDICTED_CELL / (n * world.step_size)))
        noted = [max(1, round(part * last)) for part in _PARTS]
        steps = sorted({*range(stride, last, stride), *noted})
        time = np.array(steps) * world.step_size
        turned = world.sun_rate * time
        columns = steps, n * time, np.cos(n * time), np.sin(n * time), np.cos(turned), np.sin(turned)
        return np.stack([*columns, np.isin(steps, noted)], axis=1).astype(np.float64)
