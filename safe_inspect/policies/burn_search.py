"""Search for the plan of burns with the least cost, compiled: simulated annealing from several starts."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.policies.burn_problem import BurnProblem, PlanOutcome, burn_steps, evaluate_plan
from safe_inspect.random.splitmix import SplitMixState, next_uniform
from safe_inspect.types import FloatArray, IntArray


@njit
def accepted_cost(cost: float, temperature: float, done: float, uniform: float) -> float:
    """Return the cost up to which a changed plan is accepted: ``cost - temperature (1 - done) ln(uniform)``.

    Source: N. Metropolis et al., 1953; S. Kirkpatrick et al., "Optimization by Simulated Annealing", 1983, with a
    temperature that decreases linearly.

    Args:
        cost: Cost of the current plan.
        temperature: Initial temperature, in the unit of the cost.
        done: Completed share of the search, from 0 to 1.
        uniform: A random number in [0, 1).
    """
    return cost - temperature * (1.0 - done) * math.log(uniform + 1e-300)


#: Smallest and largest change of a burn, as powers of ten [m/s].
_SMALLEST, _LARGEST = -3.3, -0.8
#: Largest velocity of an evasive manoeuvre along each axis [m/s], and its largest number of steps.
_ASIDE, _BACK_AFTER = 0.5, 40
#: Initial temperature of the annealing [m/s].
_TEMPERATURE = 0.01
#: Factor by which the number of restarts may grow while no valid plan has been found.
_PATIENCE = 2


class AnnealingEffort(NamedTuple):
    """Extent of a search.

    Attributes:
        restarts: Number of annealing runs; the first starts from the given plan.
        iterations: Number of plans that are tried in each run.
        stride: Number of steps between two checks during the search; its results are then checked at every step.
    """

    restarts: int
    iterations: int
    stride: int


@njit
def settle(problem: BurnProblem, start: IntArray, delta_v: FloatArray) -> None:
    """Sort burns, and move each to a step where the deputy may start one and where the previous burn has ended."""
    horizon = problem.lit.shape[0] - 1
    for axis in range(3):
        if problem.reach[axis] <= 0.0:
            delta_v[:, axis] = 0.0
    for k in range(1, start.shape[0]):
        i = k
        while i > 0 and start[i] < start[i - 1]:
            start[i], start[i - 1] = start[i - 1], start[i]
            delta_v[i], delta_v[i - 1] = delta_v[i - 1].copy(), delta_v[i].copy()
            i -= 1
    free = 0
    for k in range(start.shape[0]):
        begin = max(start[k], free)
        start[k] = (begin + problem.period - 1) // problem.period * problem.period
        if start[k] >= horizon:
            start[k] = horizon
            delta_v[k] = 0.0
        free = start[k] + burn_steps(delta_v[k], problem.reach)


@njit
def _perturb(problem: BurnProblem, seed: SplitMixState, start: IntArray, delta_v: FloatArray) -> None:
    """Change a plan at random, by a small or a large amount."""
    count = start.shape[0]
    kind, k, axis = next_uniform(seed), int(next_uniform(seed) * count), int(next_uniform(seed) * 3)
    size = 10.0 ** (_SMALLEST + (_LARGEST - _SMALLEST) * next_uniform(seed))
    if kind < 0.45:
        delta_v[k, axis] += size * (2.0 * next_uniform(seed) - 1.0)
    elif kind < 0.55:
        for i in range(3):
            delta_v[k, i] += size * (2.0 * next_uniform(seed) - 1.0)
    elif kind < 0.65:
        delta_v[k, axis] = 0.0
    elif kind < 0.70:
        delta_v[k] = 0.0
    elif kind < 0.82:
        shift = 1.5 * 10.0 ** (2.5 * next_uniform(seed)) * (2.0 * next_uniform(seed) - 1.0)
        start[k] = max(0, start[k] + problem.period * math.ceil(shift / problem.period))
    elif kind < 0.88:
        delta_v[k, axis] *= 0.7 + 0.35 * next_uniform(seed)
    elif kind < 0.92:
        delta_v *= 0.9 + 0.1 * next_uniform(seed)
    else:
        other, share = int(next_uniform(seed) * count), next_uniform(seed)
        moved = share * delta_v[k, axis]
        delta_v[k, axis] -= moved
        delta_v[other, axis] += moved


@njit
def _initial_plan(
    problem: BurnProblem, seed: SplitMixState, state: FloatArray, round_: int, start: IntArray, delta_v: FloatArray
) -> None:
    """Write a starting plan: a first burn that removes most of the drift along the track, or none."""
    horizon = problem.lit.shape[0] - 1
    delta_v[:] = 0.0
    start[0] = 0
    for k in range(1, start.shape[0]):
        start[k] = int(0.6 * horizon * next_uniform(seed))
    if round_ % 4 != 3:
        # The mean motion, which determines the drift, follows from the map of one step: phi[3, 4] = 2 sin(n dt).
        mean_motion = math.asin(0.5 * problem.maps.phi[1, 3, 4]) / problem.maps.step_size
        delta_v[0, 1] = -(0.6 + 0.6 * next_uniform(seed)) * (state[4] + 2.0 * mean_motion * state[0])
    if round_ % 2 == 1:
        for axis in range(3):
            delta_v[0, axis] += 0.05 * (2.0 * next_uniform(seed) - 1.0)
    elif round_ > 0 and start.shape[0] > 1:
        # An evasive manoeuvre and its reversal, as the plans so far may violate a limit.
        for axis in range(3):
            aside = _ASIDE * (2.0 * next_uniform(seed) - 1.0)
            delta_v[0, axis] += aside
            delta_v[1, axis] -= aside
        start[1] = int(_BACK_AFTER * next_uniform(seed))


@njit
def _anneal(
    problem: BurnProblem,
    state: FloatArray,
    start: IntArray,
    delta_v: FloatArray,
    seed: SplitMixState,
    effort: AnnealingEffort,
) -> PlanOutcome:
    """Replace a plan by the best plan that is found, or leave it unchanged if it is the best.

    Args:
        problem: The planning problem.
        state: Position [m] and velocity [m/s] now, shape (6,).
        start: First step of each burn from now, shape (K,); read and written.
        delta_v: Velocity change of each burn [m/s], Hill frame, shape (K, 3); read and written.
        seed: State of the random numbers, shape (1,); read and written.
        effort: Extent of the search.

    Returns:
        Result of the plan, checked at every step.
    """
    restarts, iterations, stride = effort.restarts, effort.iterations, effort.stride
    settle(problem, start, delta_v)
    best = evaluate_plan(problem, state, start, delta_v, 1)
    old_start, old = start.copy(), delta_v.copy()
    new_start, new = start.copy(), delta_v.copy()
    for attempt in range(_PATIENCE * restarts):
        if attempt >= restarts and best.left == 0 and best.breaches == 0:
            break
        if attempt > 0:
            _initial_plan(problem, seed, state, attempt - 1, old_start, old)
            settle(problem, old_start, old)
        cost = evaluate_plan(problem, state, old_start, old, stride).cost
        lowest = math.inf
        for iteration in range(iterations):
            new_start[:], new[:] = old_start, old
            _perturb(problem, seed, new_start, new)
            if next_uniform(seed) < 0.3:
                _perturb(problem, seed, new_start, new)
            settle(problem, new_start, new)
            cutoff = accepted_cost(cost, _TEMPERATURE, iteration / iterations, next_uniform(seed))
            if np.abs(new).sum() > cutoff:  # the fuel alone exceeds the cutoff
                continue
            found = evaluate_plan(problem, state, new_start, new, stride, cutoff)
            if found.cost > cutoff:
                continue
            cost = found.cost
            old_start[:], old[:] = new_start, new
            # Coarse checks overestimate a short violation, so a plan that only reduces one is checked exactly too.
            sound = best.left == 0 and best.breaches == 0
            if cost < best.cost or (cost < lowest and not sound):
                lowest = cost
                exact = evaluate_plan(problem, state, new_start, new, 1)
                if exact.cost < best.cost:
                    best = exact
                    start[:], delta_v[:] = new_start, new
    for k in range(start.shape[0]):
        if best.left == 0 and start[k] >= max(best.end, problem.wait + problem.margin):  # too late to matter
            delta_v[k] = 0.0
    return best


@njit
def revise_plan(
    problem: BurnProblem,
    state: FloatArray,
    start: IntArray,
    delta_v: FloatArray,
    seed: SplitMixState,
    effort: AnnealingEffort,
) -> tuple[int, int]:
    """Review a plan: leave it unchanged, improve its remainder before its next burn, or make a new plan.

    The arguments are those of `_anneal`.

    Returns:
        `PlanOutcome.left` and `PlanOutcome.end` of the plan.
    """
    settle(problem, start, delta_v)
    outcome = evaluate_plan(problem, state, start, delta_v, 1)
    restarts = effort.restarts if outcome.left > 0 or outcome.breaches > 0 else 0
    for k in range(start.shape[0]):
        if start[k] == 0 and burn_steps(delta_v[k], problem.reach) > 0:
            restarts = max(restarts, 1)
    if restarts > 0:
        outcome = _anneal(
            problem, state, start, delta_v, seed, AnnealingEffort(restarts, effort.iterations, effort.stride)
        )
    return outcome.left, outcome.end
