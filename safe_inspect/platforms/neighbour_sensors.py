"""Sensors of the other deputies, whose size does not depend on the number of deputies."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from pydantic import Field

from safe_inspect.compiling import njit
from safe_inspect.dynamics.coasting import coast, extreme_time, grid
from safe_inspect.geometry.neighbours import nearest_positions, nearest_velocities
from safe_inspect.platforms.base import Sensor
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators import Group, World
from safe_inspect.simulators.row_terms import AgentParameter, EnvironmentArray, RowInput, RowTerm
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveDuration, PositiveLength

#: Largest cell of the grid on which approaches are bracketed, as an angle of the orbit [rad].
_CELL = 0.25


@njit
def _closest_approach(
    deputies: int,
    max_range: float,
    table: FloatArray,
    n: float,
    own: int,
    position: FloatArray,
    velocity: FloatArray,
    relative: FloatArray,
) -> None:
    """Write the relative position at closest approach.

    The difference of two motions solves the same linear equations as one motion.
    """
    nearest_positions(0, max_range, own, position, relative)
    least = max_range * max_range
    for other in range(deputies):
        if other == own:
            continue
        p, v = position[other] - position[own], velocity[other] - velocity[own]
        time = extreme_time(p, v, table, n, 1.0)
        x, y, z, _, _, _, squared, _, _ = coast(p, v, time, math.sin(n * time), math.cos(n * time), n)
        if squared < least:
            least = squared
            relative[0], relative[1], relative[2] = x, y, z


class _Places(Plugin):
    """Fields of the sensors of the nearest other deputies.

    Attributes:
        k: Number of places.
        max_range: Range within which other deputies are detected, and the length of a position if there is none [m].
    """

    k: int = Field(default=2, ge=1, le=100)
    max_range: PositiveLength = 1000.0

    def inputs(self, world: World, group: Group) -> tuple[RowInput, ...]:
        """Return the inputs of the row kernels, the positions last."""
        return world.num_deputies, self.max_range, _own_index(group), EnvironmentArray("position")


class NearestDeputiesPositionSensor(_Places, Sensor, name="Sensor_NearestDeputiesPosition"):
    """Positions of the `k` nearest other deputies relative to the agent [m], Hill frame, nearest first, shape (R, 3 k).

    A place without a deputy within `max_range` reads as if a deputy were `max_range` away, straight outward from the
    origin through the agent's own position (along +x at the origin itself). Such a reading says that no deputy is near
    or on the chief's side, and it turns with the scene.
    """

    symbol: ClassVar[str] = "m"

    @property
    def element_names(self) -> tuple[str, ...]:
        """Three names for each place, x_0 to z_0 for the nearest deputy."""
        return tuple(f"{axis}_{place}" for place in range(self.k) for axis in "xyz")

    @property
    def limits(self) -> tuple[float, float]:
        """From -max_range to max_range [m]."""
        return -self.max_range, self.max_range

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the relative positions [m], Hill frame."""
        return RowTerm(nearest_positions, self.inputs(world, group))


class ClosestApproachPositionSensor(Sensor, name="Sensor_ClosestApproachPosition"):
    """Relative position, at its closest approach, of the deputy that comes closest [m], Hill frame, shape (R, 3).

    The closest approach is taken over all other deputies and all times within `duration`, with all thrusters off, from
    the closed-form solution of the Clohessy-Wiltshire equations. If no deputy comes within `max_range`, the reading is
    that of `Sensor_NearestDeputiesPosition` without a deputy.

    Attributes:
        duration: Duration of the prediction [s]; default: a quarter of an orbit.
        max_range: Range within which an approach is detected, and the length of the reading if there is none [m].
    """

    elements: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    symbol: ClassVar[str] = "m"

    duration: PositiveDuration | None = None
    max_range: PositiveLength = 1000.0

    @property
    def limits(self) -> tuple[float, float]:
        """From -max_range to max_range [m]."""
        return -self.max_range, self.max_range

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the position [m], Hill frame."""
        n = float(world.mean_motion)
        table = grid(n, 0.5 * math.pi / n if self.duration is None else self.duration, _CELL)
        arrays = EnvironmentArray("position"), EnvironmentArray("velocity")
        return RowTerm(_closest_approach, (world.num_deputies, self.max_range, table, n, _own_index(group), *arrays))


class NearestDeputiesVelocitySensor(_Places, Sensor, name="Sensor_NearestDeputiesVelocity"):
    """Velocities of the `k` nearest other deputies relative to the agent [m/s], Hill frame, shape (R, 3 k).

    The places are those of `Sensor_NearestDeputiesPosition` with the same fields; a place without a deputy reads 0.
    """

    symbol: ClassVar[str] = "m/s"

    @property
    def element_names(self) -> tuple[str, ...]:
        """Three names for each place, v_x_0 to v_z_0 for the nearest deputy."""
        return tuple(f"v_{axis}_{place}" for place in range(self.k) for axis in "xyz")

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the relative velocities [m/s], Hill frame."""
        return RowTerm(nearest_velocities, (*self.inputs(world, group), EnvironmentArray("velocity")))


def _own_index(group: Group) -> AgentParameter:
    """Return the index of each agent's deputy."""
    return AgentParameter(np.arange(group.first, group.first + group.size))
