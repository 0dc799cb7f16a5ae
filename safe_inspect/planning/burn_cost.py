"""Cost of a plan of burns: fuel, points that are not inspected, and violated limits. Compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.step_maps import advance_steps
from safe_inspect.planning.burn_problem import BurnProblem, FlightLimits, burn_steps
from safe_inspect.types import FloatArray, IntArray

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
    left: IntArray,
    lack: FloatArray,
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
        left: Workspace of P numbers.
        lack: Workspace of P numbers.
        cutoff: The evaluation stops as soon as the plan costs more than this [m/s]; the returned cost is then infinite.
    """
    count = 0
    for p in range(problem.needed.shape[0]):
        if problem.needed[p]:
            left[count], lack[count] = p, 2.0
            count += 1
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
