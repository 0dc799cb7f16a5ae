"""`BurnProblem`: what one deputy plans its burns for. Compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

from safe_inspect.compiling import njit
from safe_inspect.dynamics.step_maps import StepMaps
from safe_inspect.types import BoolArray, FloatArray

#: A burn smaller than this is none [m/s].
NO_BURN = 1e-9


class FlightLimits(NamedTuple):
    """The limits that a plan keeps to.

    Attributes:
        near: Least range to the chief [m].
        far: Largest range [m].
        speed: Largest speed at the range `near` [m/s]; infinite: no limit.
        slope: What the limit of speed gains with range [1/s].
        cos_glare: Cosine of the angle about the direction away from the sun that is kept out of; 2: none is.
    """

    near: float
    far: float
    speed: float
    slope: float
    cos_glare: float


class BurnProblem(NamedTuple):
    """What one deputy plans for: J steps from now, in SI units and Hill's frame.

    Attributes:
        maps: The maps of 0, 1, ... steps.
        lit: Points that are lit after 0, 1, ... steps, shape (J + 1, P).
        sun: Unit vector to the sun after 0, 1, ... steps, shape (J + 1, 3).
        points: The points [m], shape (P, 3).
        radius: Radius of their sphere [m].
        sight: Range from which on every point above the horizon is seen [m].
        needed: Points that the deputy has to inspect, shape (P,).
        others: Positions [m] and velocities [m/s] of the other deputies after 0, 1, ... steps, shape (D - 1, J + 1, 6).
        wait: Steps for which the limits have to hold at least.
        margin: Steps for which they have to hold after the last point.
        phase: Steps since the reset, so that plans made at different times check the same steps.
        period: A burn begins a multiple of this many steps from now.
        reach: Velocity change that one step can give along each axis [m/s], shape (3,).
        limits: Limits of range, speed and glare.
        clearance: Least distance of two deputies [m].
        haste: Price of time [m/s^2].
    """

    maps: StepMaps
    lit: BoolArray
    sun: FloatArray
    points: FloatArray
    radius: float
    sight: float
    needed: BoolArray
    others: FloatArray
    wait: int
    margin: int
    phase: int
    period: int
    reach: FloatArray
    limits: FlightLimits
    clearance: float
    haste: float


@njit
def burn_steps(delta_v: FloatArray, reach: FloatArray) -> int:
    """Return how many steps a burn lasts, 0 for none; the thrust is the same in each."""
    steps = 0
    for axis in range(3):
        size = abs(delta_v[axis])
        if size > NO_BURN:
            steps = max(steps, math.ceil(size / reach[axis] - 1e-9))
    return steps
