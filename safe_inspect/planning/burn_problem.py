"""`BurnProblem`: the planning problem of one deputy, and its prediction of the others. Compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.step_maps import StepMaps, advance_steps
from safe_inspect.types import BoolArray, FloatArray

#: Velocity change up to which a burn is ignored [m/s].
_NO_BURN = 1e-9


class FlightLimits(NamedTuple):
    """Limits that a plan must satisfy.

    Attributes:
        near: Least range to the chief [m].
        far: Largest range [m].
        speed: Largest speed at the range `near` [m/s]; infinite: no limit.
        slope: Increase of the speed limit with range [1/s].
        cos_glare: Cosine of the half angle of the excluded cone about the direction away from the sun; 2: no cone.
    """

    near: float
    far: float
    speed: float
    slope: float
    cos_glare: float


class BurnProblem(NamedTuple):
    """Planning problem of one deputy: J steps from now, in SI units and Hill's frame.

    Attributes:
        maps: The maps of 0, 1, ... steps.
        lit: Mask of the points that are lit after 0, 1, ... steps, shape (J + 1, P).
        sun: Unit vector to the sun after 0, 1, ... steps, shape (J + 1, 3).
        points: The points [m], shape (P, 3).
        radius: Radius of their sphere [m].
        sight: Range from which on every point above the horizon is in view [m].
        needed: Mask of the points that the deputy has to inspect, shape (P,).
        others: Positions [m] and velocities [m/s] of the other deputies after 0, 1, ... steps, shape (D - 1, J + 1, 6).
        wait: Minimum number of steps for which the limits must hold.
        margin: Number of steps for which the limits must hold after the last point.
        phase: Steps since the reset, so that plans made at different times check the same steps.
        period: Burns start at multiples of this number of steps from now.
        reach: Velocity change that one step can give along each axis [m/s], shape (3,).
        limits: Limits of range, speed and glare.
        clearance: Least distance between two deputies [m].
        haste: Cost of time [m/s^2].
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
    """Return the number of steps of a burn, 0 for none; the thrust is the same in each step."""
    steps = 0
    for axis in range(3):
        size = abs(delta_v[axis])
        if size > _NO_BURN:
            steps = max(steps, math.ceil(size / reach[axis] - 1e-9))
    return steps


@njit
def coast_others(problem: BurnProblem, position: FloatArray, velocity: FloatArray) -> int:
    """Write `BurnProblem.others`, and remove from `BurnProblem.needed` the points that the others will inspect.

    The others are assumed to coast from now on. Points that a deputy would see after it has left the range from the
    points' radius to `FlightLimits.far` do not count, as it will not fly there.

    Args:
        problem: The deputy's planning problem.
        position: Positions of the others [m], shape (D - 1, 3).
        velocity: Velocities of the others [m/s], shape (D - 1, 3).

    Returns:
        Number of steps after which the last of those points is inspected.
    """
    points, needed, lit, radius, sight = problem.points, problem.needed, problem.lit, problem.radius, problem.sight
    far, maps = problem.limits.far, problem.maps
    state, after, coasting = np.empty(6), np.empty(6), np.zeros(3)
    last = 0
    for k in range(position.shape[0]):
        state[:3], state[3:] = position[k], velocity[k]
        inside = True
        for j in range(lit.shape[0]):
            advance_steps(maps, j, state, coasting, after)
            x, y, z = after[0], after[1], after[2]
            problem.others[k, j] = after
            r2 = x * x + y * y + z * z
            inside = inside and radius * radius <= r2 <= far * far
            if j == 0 or not inside or r2 < sight * sight:
                continue
            for p in range(points.shape[0]):
                if not needed[p] or not lit[j, p]:
                    continue
                if points[p, 0] * x + points[p, 1] * y + points[p, 2] * z >= radius * radius:
                    needed[p] = False
                    last = max(last, j)
    return last
