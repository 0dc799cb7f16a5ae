"""Docking and contact as row kernels of one chaser in one environment."""

from __future__ import annotations

import math

from safe_inspect.compiling import njit
from safe_inspect.geometry.distance import distance
from safe_inspect.simulators.row_terms import EnvironmentArray, RowInput
from safe_inspect.tasks.docking.speed_limit import own_motion
from safe_inspect.types import FloatArray


@njit
def is_docked(reach: float, speed: float, *motion: FloatArray) -> bool:
    """Return whether a chaser is at the mating point and has the same velocity.

    Args:
        reach: Largest distance to the mating point [m].
        speed: Largest speed relative to the mating point [m/s].
        *motion: Position [m] and velocity [m/s] of the chaser, then of the mating point, each of shape (3,).
    """
    return distance(motion[0], motion[2]) <= reach and distance(motion[1], motion[3]) <= speed


@njit
def is_in_contact(radius: float, clearance: float) -> bool:
    """Return whether the clearance of a chaser's centre is below its radius [m]."""
    return clearance < radius


@njit
def docking_error(time_scale: float, *motion: FloatArray) -> float:
    """Return ``sqrt(|p - p_m|^2 + (T |v - v_m|)^2)`` [m].

    Args:
        time_scale: Weight T of a relative velocity [s].
        *motion: Position p [m] and velocity v [m/s] of the chaser, then p_m and v_m of the mating point, shape (3,).
    """
    apart, lag = distance(motion[0], motion[2]), time_scale * distance(motion[1], motion[3])
    return math.sqrt(apart * apart + lag * lag)


def docking_inputs(before: bool = False) -> tuple[RowInput, RowInput, RowInput, RowInput]:
    """Return the position and velocity of the chaser, then of the mating point, as inputs of a row kernel.

    Args:
        before: Whether to read the values before the step.
    """
    return (
        *own_motion(before),
        EnvironmentArray("mating_point_position", before),
        EnvironmentArray("mating_point_velocity", before),
    )
