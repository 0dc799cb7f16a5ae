"""`StepMaps`: closed-form maps of coasting and thrusting arcs of a body of 1 kg, for any number of steps at once."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.cwh import cwh_row, transition
from safe_inspect.types import FloatArray


class StepMaps(NamedTuple):
    """The maps of 0, 1, ..., J steps; read-only.

    Attributes:
        phi: Transition matrices, shape (J + 1, 6, 6).
        gamma: Input matrices, for a body of 1 kg, of a thrust that is held during all steps, shape (J + 1, 6, 3).
        step_size: Length of a step [s].
    """

    phi: FloatArray
    gamma: FloatArray
    step_size: float


@lru_cache(maxsize=8)
def step_maps(mean_motion: float, step_size: float, steps: int) -> StepMaps:
    """Return the maps of 0 to `steps` steps.

    Args:
        mean_motion: Mean motion of the chief's orbit [rad/s].
        step_size: Length of a step [s].
        steps: The largest number of steps, J.
    """
    maps = [transition(mean_motion, 1.0, count * step_size) for count in range(steps + 1)]
    phi, gamma = (np.stack([pair[index] for pair in maps]) for index in (0, 1))
    phi.flags.writeable = gamma.flags.writeable = False
    return StepMaps(phi, gamma, step_size)


@njit
def advance_steps(maps: StepMaps, steps: int, state: FloatArray, acceleration: FloatArray, after: FloatArray) -> None:
    """Write position and velocity after some steps under one acceleration.

    Args:
        maps: The maps.
        steps: Number of steps.
        state: Position [m] and velocity [m/s], Hill frame, shape (6,).
        acceleration: Thrust divided by mass, held during all steps [m/s^2], shape (3,).
        after: Output: position and velocity, shape (6,).
    """
    x = (state[0], state[1], state[2], state[3], state[4], state[5])
    row = cwh_row(maps.phi[steps], maps.gamma[steps], x, acceleration[0], acceleration[1], acceleration[2])
    for i in range(6):
        after[i] = row[i]
