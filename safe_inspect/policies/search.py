"""Search for the cheapest plan of burns, compiled: simulated annealing from several beginnings."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from safe_inspect.compiling import njit
from safe_inspect.policies.plan import Course, Outcome, burn_steps, evaluate
from safe_inspect.types import FloatArray, IntArray

Seed = NDArray[np.uint64]

#: Smallest and largest change of a burn, as powers of ten [m/s].
_SMALLEST, _LARGEST = -3.3, -0.8
#: Largest velocity to step aside with [m/s], and the steps after which it is taken away at the latest.
_ASIDE, _BACK_AFTER = 0.5, 40
#: First temperature of the annealing [m/s].
_TEMPERATURE = 0.01
#: A search that has found no sound plan goes on for so many times its restarts.
_PATIENCE = 2


@njit
def draw(seed: Seed) -> float:
    """Return the next uniform number in [0, 1) of a generator with one word of state (splitmix64), shape (1,)."""
    seed[0] += np.uint64(0x9E3779B97F4A7C15)
    z = seed[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) * 2.0**-53


@njit
def settle(course: Course, start: IntArray, delta_v: FloatArray) -> None:
    """Put burns in order, each at a step where the deputy may begin one, and none before the last has ended."""
    horizon = course.lit.shape[0] - 1
    for axis in range(3):
        if course.reach[axis] <= 0.0:
            delta_v[:, axis] = 0.0
    for k in range(1, start.shape[0]):
        i = k
        while i > 0 and start[i] < start[i - 1]:
            start[i], start[i - 1] = start[i - 1], start[i]
            for axis in range(3):
                delta_v[i, axis], delta_v[i - 1, axis] = delta_v[i - 1, axis], delta_v[i, axis]
            i -= 1
    free = 0
    for k in range(start.shape[0]):
        begin = max(start[k], free)
        start[k] = (begin + course.period - 1) // course.period * course.period
        if start[k] >= horizon:
            start[k] = horizon
            delta_v[k] = 0.0
        free = start[k] + burn_steps(delta_v[k], course.reach)


@njit
def _vary(course: Course, seed: Seed, start: IntArray, delta_v: FloatArray) -> None:
    """Change a plan a little, or much, at random."""
    count = start.shape[0]
    kind, k, axis = draw(seed), int(draw(seed) * count), int(draw(seed) * 3)
    size = 10.0 ** (_SMALLEST + (_LARGEST - _SMALLEST) * draw(seed))
    if kind < 0.45:
        delta_v[k, axis] += size * (2.0 * draw(seed) - 1.0)
    elif kind < 0.55:
        for i in range(3):
            delta_v[k, i] += size * (2.0 * draw(seed) - 1.0)
    elif kind < 0.65:
        delta_v[k, axis] = 0.0
    elif kind < 0.70:
        delta_v[k] = 0.0
    elif kind < 0.82:
        shift = 1.5 * 10.0 ** (2.5 * draw(seed)) * (2.0 * draw(seed) - 1.0)
        start[k] = max(0, start[k] + course.period * math.ceil(shift / course.period))
    elif kind < 0.88:
        delta_v[k, axis] *= 0.7 + 0.35 * draw(seed)
    elif kind < 0.92:
        delta_v *= 0.9 + 0.1 * draw(seed)
    else:
        other, share = int(draw(seed) * count), draw(seed)
        moved = share * delta_v[k, axis]
        delta_v[k, axis] -= moved
        delta_v[other, axis] += moved


@njit
def _begin(course: Course, seed: Seed, state: FloatArray, round_: int, start: IntArray, delta_v: FloatArray) -> None:
    """Write a plan to begin with: a first burn that takes away most of the drift along the track, or none."""
    horizon = course.lit.shape[0] - 1
    delta_v[:] = 0.0
    start[0] = 0
    for k in range(1, start.shape[0]):
        start[k] = int(0.6 * horizon * draw(seed))
    if round_ % 4 != 3:
        # The mean motion, and with it the drift, from the map of one step: phi[3, 4] = 2 sin(n dt).
        mean_motion = math.asin(0.5 * course.phi[1, 3, 4]) / course.step_size
        delta_v[0, 1] = -(0.6 + 0.6 * draw(seed)) * (state[4] + 2.0 * mean_motion * state[0])
    if round_ % 2 == 1:
        for axis in range(3):
            delta_v[0, axis] += 0.05 * (2.0 * draw(seed) - 1.0)
    elif round_ > 0 and start.shape[0] > 1:
        # A step aside and back: the plans so far break a limit.
        for axis in range(3):
            aside = _ASIDE * (2.0 * draw(seed) - 1.0)
            delta_v[0, axis] += aside
            delta_v[1, axis] -= aside
        start[1] = int(_BACK_AFTER * draw(seed))


@njit
def improve(
    course: Course,
    state: FloatArray,
    start: IntArray,
    delta_v: FloatArray,
    seed: Seed,
    restarts: int,
    iterations: int,
    stride: int,
) -> Outcome:
    """Replace a plan by the best that is found, itself included.

    Args:
        course: What the plan is for.
        state: Position [m] and velocity [m/s] now, shape (6,).
        start: First step of each burn from now, shape (K,); read and written.
        delta_v: Velocity change of each burn [m/s], Hill frame, shape (K, 3); read and written.
        seed: State of the random numbers, shape (1,); read and written.
        restarts: How many times the annealing begins; first from the given plan.
        iterations: Plans that are tried each time.
        stride: The search looks at every so-many-th step; whatever it finds is then looked at in every step.

    Returns:
        What becomes of the plan, by every step.
    """
    left, lack = np.empty(course.needed.shape[0], np.int64), np.empty(course.needed.shape[0])
    settle(course, start, delta_v)
    best = evaluate(course, state, start, delta_v, 1, left, lack)
    old_start, old = start.copy(), delta_v.copy()
    new_start, new = start.copy(), delta_v.copy()
    for attempt in range(_PATIENCE * restarts):
        if attempt >= restarts and best.left == 0 and best.breaches == 0:
            break
        if attempt > 0:
            _begin(course, seed, state, attempt - 1, old_start, old)
            settle(course, old_start, old)
        cost = evaluate(course, state, old_start, old, stride, left, lack).cost
        lowest = math.inf
        for iteration in range(iterations):
            new_start[:], new[:] = old_start, old
            _vary(course, seed, new_start, new)
            if draw(seed) < 0.3:
                _vary(course, seed, new_start, new)
            settle(course, new_start, new)
            bar = cost - _TEMPERATURE * (1.0 - iteration / iterations) * math.log(draw(seed) + 1e-300)
            if np.abs(new).sum() > bar:  # the fuel alone is too much
                continue
            found = evaluate(course, state, new_start, new, stride, left, lack, bar)
            if found.cost > bar:
                continue
            cost = found.cost
            old_start[:], old[:] = new_start, new
            # Looks far apart overrate a breach that is short: a plan that only lessens one has to be looked at too.
            sound = best.left == 0 and best.breaches == 0
            if cost < best.cost or (cost < lowest and not sound):
                lowest = cost
                exact = evaluate(course, state, new_start, new, 1, left, lack)
                if exact.cost < best.cost:
                    best = exact
                    start[:], delta_v[:] = new_start, new
    for k in range(start.shape[0]):
        if best.left == 0 and start[k] >= max(best.end, course.wait + course.margin):  # too late to be of use
            delta_v[k] = 0.0
    return best


@njit
def revise(
    course: Course,
    state: FloatArray,
    start: IntArray,
    delta_v: FloatArray,
    seed: Seed,
    restarts: int,
    iterations: int,
    stride: int,
) -> tuple[int, int]:
    """Look at a plan: keep it, better what is left of it before its next burn, or make a new one.

    The arguments are those of `improve`.

    Returns:
        `Outcome.left` and `Outcome.end` of the plan.
    """
    settle(course, start, delta_v)
    left, lack = np.empty(course.needed.shape[0], np.int64), np.empty(course.needed.shape[0])
    outcome = evaluate(course, state, start, delta_v, 1, left, lack)
    begins = restarts if outcome.left > 0 or outcome.breaches > 0 else 0
    for k in range(start.shape[0]):
        if start[k] == 0 and burn_steps(delta_v[k], course.reach) > 0:
            begins = max(begins, 1)
    if begins > 0:
        outcome = improve(course, state, start, delta_v, seed, begins, iterations, stride)
    return outcome.left, outcome.end
