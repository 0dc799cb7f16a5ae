"""`BurnInspectionSensor`: how many more points the deputy would inspect if it burned now, and coasted then."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from safe_inspect.compiling import njit
from safe_inspect.dynamics.coasting import coasting_position
from safe_inspect.geometry.visibility import inspect_in_binary_light
from safe_inspect.platforms.coasting_inspection import LookAheadSensor
from safe_inspect.simulators.row_terms.loops import RowTerm
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveSpeed


@njit
def _more_after_burns(
    position: FloatArray,
    velocity: FloatArray,
    inspector: NDArray[np.int8],
    sun_angle: float,
    step: int,
    table: FloatArray,
    axes: FloatArray,
    constants: FloatArray,
    reading: FloatArray,
) -> None:
    """Write what each burn adds to the points that coasting inspects.

    Args:
        position: Position relative to the body [m], shape (3,).
        velocity: Velocity [m/s], shape (3,).
        inspector: Who inspected each point, -1 for nobody, shape (P,).
        sun_angle: Angle of the sun [rad].
        step: Control steps since the reset.
        table: As for `Sensor_CoastingInspection`, shape (K, 7).
        axes: The points [m], shape (3, P).
        constants: As for `Sensor_CoastingInspection`, and the changes of velocity by the burns [m/s], the first zero,
            shape (4 + 3 (B + 1),).
        reading: Takes the result, shape (B,).
    """
    horizon, terminator, n, last = constants[0], constants[1], constants[2], constants[3]
    burns = constants[4:].reshape((-1, 3))
    total, number, none = len(inspector), 0, 0
    open_axes = np.empty((3, total))
    for p in range(total):
        if inspector[p] < 0:
            for axis in range(3):
                open_axes[axis, number] = axes[axis, p]
            number += 1
    found = np.empty(number, np.int8)
    cos_sun, sin_sun = math.cos(sun_angle), math.sin(sun_angle)
    for b in range(burns.shape[0]):
        found[:] = -1
        u, v, w = velocity[0] + burns[b, 0], velocity[1] + burns[b, 1], velocity[2] + burns[b, 2]
        state = position[0], position[1], position[2], u, v, w
        for k in range(table.shape[0]):
            steps, angle, cos, sin, cos_turn, sin_turn, _ = table[k]
            if step + steps > last:
                break
            viewer = coasting_position(n, state, angle, cos, sin)
            sun = cos_sun * cos_turn - sin_sun * sin_turn, -(sin_sun * cos_turn + cos_sun * sin_turn), 0.0
            inspect_in_binary_light(viewer, sun, open_axes, horizon, terminator, 0, found)
        seen = 0
        for p in range(number):
            seen += found[p] == 0
        if b == 0:
            none = seen
        else:
            reading[b - 1] = (seen - none) / total


class BurnInspectionSensor(LookAheadSensor, name="Sensor_BurnInspection"):
    """What a burn now would add to the points that the deputy inspects by coasting [-], shape (R, 6 B).

    For each of the B sizes of `delta_v`, of burns along +x, -x, +y, -y, +z and -z of Hill's frame: the share of all
    points that would be inspected after the burn, less that without it. A burn is a change of velocity at once. See
    `LookAheadSensor`; it looks every 0.1 rad of the orbit at most.

    Attributes:
        inspection_entity_name: The body that carries the points, at the origin of Hill's frame.
        duration: How long the deputy coasts [s]; one orbit unless given.
        horizon: Number of steps after which the episode ends [-]; that of the task unless given.
        delta_v: Sizes of the burns [m/s].
    """

    looks_every: ClassVar[float] = 0.1

    delta_v: tuple[PositiveSpeed, ...] = Field(default=(0.02, 0.06), min_length=1)

    @property
    def element_names(self) -> tuple[str, ...]:
        """The direction and the size of each burn."""
        return tuple(f"{sign}{axis}_{size:g}" for size in self.delta_v for axis in "xyz" for sign in "+-")

    def _term(self, inputs: tuple[Any, ...]) -> RowTerm:
        directions = np.array([sign * np.eye(3)[axis] for axis in range(3) for sign in (1.0, -1.0)])
        burns = np.concatenate([np.zeros((1, 3)), *(size * directions for size in self.delta_v)])
        return RowTerm(_more_after_burns, (*inputs[:-1], np.concatenate([inputs[-1], burns.ravel()])))
