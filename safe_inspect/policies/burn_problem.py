"""`BurnProblem`: the planning problem of one deputy, its prediction of the others, and the cost of a plan. Compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.step_maps import StepMaps, advance_steps
from safe_inspect.types import BoolArray, FloatArray, IntArray

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


#: Cost of points that are not inspected [m/s]: once per plan, for each point, and for each by its shortfall.
_INCOMPLETE, _POINT, _SHORTFALL = 0.1, 0.02, 0.1
#: Cost of a limit that is violated in one step [m/s]; of the square of the share by which a body is too near; and of
#: the share, at most 1, by which the chief is too far, which is lower as it can be corrected later.
_BREACH, _TOO_NEAR, _TOO_FAR = 0.02, 20.0, 0.1
#: Points must be above the horizon by this factor of the radius squared, as a margin for rounding errors.
_HORIZON = 1.0 + 1e-9


class PlanOutcome(NamedTuple):
    """Result of a plan.

    Attributes:
        cost: Cost that the search minimises [m/s].
        delta_v: Velocity change that is spent, sum over the axes [m/s].
        left: Number of needed points that are not inspected.
        end: Number of steps after which the last needed point is inspected; the whole horizon if points are left.
        breaches: Number of checks at which a limit is violated.
    """

    cost: float
    delta_v: float
    left: int
    end: int
    breaches: int


@njit
def _encounters(others: FloatArray, clearance: float, j: int, after: FloatArray, half: float) -> tuple[float, int]:
    """Return the cost of being too near to other deputies [m/s], and whether this is the case.

    The distance is the least one within `half` [s] before and after j steps if both move in straight lines, so that no
    encounter between two checks is missed.
    """
    price, broken = 0.0, 0
    for k in range(others.shape[0]):
        apart, along, squared = 0.0, 0.0, 0.0
        for axis in range(3):
            offset, speed = after[axis] - others[k, j, axis], after[3 + axis] - others[k, j, 3 + axis]
            apart += offset * offset
            along += offset * speed
            squared += speed * speed
        reach = abs(along) if abs(along) < half * squared else half * squared
        nearest = apart - (2.0 * abs(along) - reach) * (reach / squared) if squared > 0.0 else apart
        if nearest < clearance * clearance:
            price += _BREACH + _TOO_NEAR * (1.0 - math.sqrt(max(0.0, nearest)) / clearance) ** 2
            broken = 1
    return price, broken


@njit
def _breaches(limits: FlightLimits, after: FloatArray, r: float, sx: float, sy: float) -> tuple[float, int]:
    """Return the cost of the limits of range, speed and glare that a state violates [m/s], and whether there is one."""
    price, broken = 0.0, 0
    near, far = limits.near, limits.far
    if r < near:
        price += _BREACH + _TOO_NEAR * (1.0 - r / near) ** 2
        broken = 1
    if r > far:
        price += _BREACH + _TOO_FAR * min(1.0, r / far - 1.0)
        broken = 1
    if limits.speed < math.inf:
        limit = limits.speed + limits.slope * (r - near)
        squared = after[3] * after[3] + after[4] * after[4] + after[5] * after[5]
        if limit < 0.0 or squared > limit * limit:
            price += _BREACH + math.sqrt(squared) - limit
            broken = 1
    if limits.cos_glare <= 1.0:
        away = -(after[0] * sx + after[1] * sy) / r
        if away > limits.cos_glare:
            price += _BREACH + away - limits.cos_glare
            broken = 1
    return price, broken


@njit
def evaluate_plan(
    problem: BurnProblem,
    state: FloatArray,
    start: IntArray,
    delta_v: FloatArray,
    stride: int,
    cutoff: float = math.inf,
) -> PlanOutcome:
    """Predict a plan and check every `stride`-th step.

    Args:
        problem: The planning problem.
        state: Position [m] and velocity [m/s] now, shape (6,).
        start: First step of each burn from now, sorted and settled by `settle`, shape (K,).
        delta_v: Velocity change of each burn [m/s], shape (K, 3).
        stride: Number of steps between two checks. 1 is exact; a larger one misses points that are only seen in
            between.
        cutoff: The evaluation stops as soon as the plan costs more than this [m/s]; the returned cost is then infinite.
    """
    left = np.flatnonzero(problem.needed)  # the first `count` numbers are those of points that are not yet inspected
    count = left.shape[0]
    lack = np.full(count, 2.0)
    now, after, acceleration = state.copy(), state.copy(), np.zeros(3)
    horizon = problem.lit.shape[0] - 1
    points, radius = problem.points, problem.radius
    limit = radius * radius * _HORIZON
    lit, sun, reach, others = problem.lit, problem.sun, problem.reach, problem.others
    sight, phase, clearance = problem.sight, problem.phase, problem.clearance
    maps, limits, step_size = problem.maps, problem.limits, problem.maps.step_size
    half = 0.5 * stride * step_size
    time, burn, breaches, spent, price = 0, 0, 0, 0.0, 0.0
    end = 0 if count == 0 else horizon
    until = min(horizon, problem.wait + problem.margin) if count == 0 else horizon
    while time < until:
        while burn < start.shape[0] and burn_steps(delta_v[burn], reach) == 0:
            burn += 1
        if burn < start.shape[0] and start[burn] <= time:
            length = burn_steps(delta_v[burn], reach)
            for axis in range(3):
                acceleration[axis] = delta_v[burn, axis] / (length * step_size)
                spent += abs(delta_v[burn, axis])
            burn += 1
        else:
            acceleration[:] = 0.0
            length = horizon if burn == start.shape[0] else start[burn] - time
        length = min(length, horizon - time)
        j = 0
        while j < length and time + j < until:
            j = min(length, j + stride - (phase + time + j) % stride)
            advance_steps(maps, j, now, acceleration, after)
            x, y, z = after[0], after[1], after[2]
            r = math.sqrt(x * x + y * y + z * z)
            more, broken = _breaches(limits, after, r, sun[time + j, 0], sun[time + j, 1])
            if others.shape[0] > 0:
                further, met = _encounters(others, clearance, time + j, after, half)
                more += further
                broken |= met
            price += more * stride
            breaches += broken
            if spent + price > cutoff:
                return PlanOutcome(math.inf, spent, count, horizon, breaches)
            if r < sight or count == 0:
                continue
            bright = lit[time + j]
            q = 0
            while q < count:
                p = left[q]
                if bright[p]:
                    short = limit - (points[p, 0] * x + points[p, 1] * y + points[p, 2] * z)
                    if short <= 0.0:
                        count -= 1
                        left[q], lack[q] = left[count], lack[count]
                        continue
                    lack[q] = min(lack[q], short / (radius * r))
                q += 1
            if count == 0:
                end = time + j
                until = min(horizon, max(end, problem.wait) + problem.margin)
        time += length
        now[:] = after
    if count > 0:
        price += _INCOMPLETE
        for q in range(count):
            price += _POINT + _SHORTFALL * lack[q]
    return PlanOutcome(spent + price + problem.haste * step_size * end, spent, count, end, breaches)
