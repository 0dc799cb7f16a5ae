"""Plans of a few burns: what they cost, by plain NumPy; what is found and when they are reviewed, against a record.

A change that is meant to change plans has to update the record:

    RECORD_RESULTS=1 python -m pytest -n 0 tests/policies/test_burns.py
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from safe_inspect.dynamics.step_maps import step_maps
from safe_inspect.geometry.sphere import sphere_points
from safe_inspect.policies.burn_execution import DeputyRows, PlanRows, follow_plans, rows_to_plan
from safe_inspect.policies.burn_problem import (
    BurnProblem,
    FlightLimits,
    PlanOutcome,
    burn_steps,
    coast_others,
    evaluate_plan,
)
from safe_inspect.policies.burn_search import AnnealingEffort, accepted_cost, revise_plan, settle

from ..golden.records import check_record

RECORD = Path(__file__).with_name("burns.json")
N, DT, STEPS, POINTS, RADIUS = 0.001027, 10.0, 240, 30, 10.0
MAPS = step_maps(N, DT, STEPS)
NO_LIMITS = FlightLimits(0.0, math.inf, math.inf, 0.0, 2.0)
LIMITS = {
    "none": NO_LIMITS,
    "range": FlightLimits(14.0, 70.0, math.inf, 0.0, 2.0),
    "speed": FlightLimits(20.0, 900.0, 0.05, 0.002, 2.0),
    "glare": FlightLimits(10.0, 900.0, math.inf, 0.0, 0.8),
    "all": FlightLimits(15.0, 60.0, 0.08, 0.003, 0.9),
}


def problem(seed: int, limits: FlightLimits, others: int = 0, **fields: Any) -> BurnProblem:
    """Return a problem of points on a sphere, lit on the sun's side; the others begin near the deputy of `plan`."""
    generator = np.random.default_rng(seed)
    points = sphere_points("fibonacci", POINTS, RADIUS)
    angle = generator.uniform(0.0, 2.0 * np.pi) - N * DT * np.arange(STEPS + 1)
    sun = np.stack((np.cos(angle), np.sin(angle), 0.0 * angle), axis=1)
    far = np.zeros((others, STEPS + 1, 6))
    for k in range(others):
        far[k] = MAPS.phi @ (plan(seed)[0] + generator.normal(size=6) * np.repeat((10.0, 0.1), 3))
    given = BurnProblem(
        MAPS, sun @ points.T > 0.0, sun, points, RADIUS, 12.0, generator.random(POINTS) < 0.9, far, 100, 20, 3, 2,
        np.array([0.05, 0.04, 0.03]), limits, 12.0, 1e-4,
    )  # fmt: skip
    return given._replace(**fields)


def plan(seed: int, burns: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a state, first steps in order with room for each burn, and velocity changes, some of them none."""
    generator = np.random.default_rng(100 + seed)
    state = np.concatenate((generator.normal(size=3) * 30.0, generator.normal(size=3) * 0.05))
    start = np.sort(generator.choice(STEPS // 10, burns, replace=False)) * 10
    delta_v = generator.uniform(-0.2, 0.2, (burns, 3)) * (generator.random((burns, 3)) < 0.7)
    return state, start, delta_v


def evaluated(given: BurnProblem, seed: int, stride: int = 1, cutoff: float = math.inf) -> PlanOutcome:
    state, start, delta_v = plan(seed)
    return PlanOutcome(*evaluate_plan(given, state, start, delta_v, stride, cutoff))


def states_of(state: np.ndarray, start: np.ndarray, delta_v: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """Return the states after every step of a plan, one step at a time, shape (STEPS + 1, 6)."""
    states, push = [state], np.zeros((STEPS, 3))
    for begin, change in zip(start, delta_v, strict=True):
        steps = max(math.ceil(size / limit) for size, limit in zip(np.abs(change), reach, strict=True))
        push[begin : begin + steps] += change / (max(steps, 1) * DT)
    for step in range(STEPS):
        states.append(MAPS.phi[1] @ states[-1] + MAPS.gamma[1] @ push[step])
    return np.array(states)


def cost_by_numpy(given: BurnProblem, seed: int) -> tuple[float, float, int, int, int]:
    """Return what becomes of a plan, checked at every step."""
    state, start, delta_v = plan(seed)
    states = states_of(state, start, delta_v, given.reach)
    r, speed = np.linalg.norm(states[:, :3], axis=1), np.linalg.norm(states[:, 3:], axis=1)
    sees = (states[:, :3] @ given.points.T >= RADIUS**2 * (1 + 1e-9)) & given.lit & (r >= given.sight)[:, None]
    sees[0] = False
    first = np.where(sees.any(axis=0), sees.argmax(axis=0), STEPS + 1)[given.needed]
    done = first <= STEPS
    end = int(first.max(initial=0)) if done.all() else STEPS
    until = min(STEPS, max(end, given.wait) + given.margin) if done.all() else STEPS
    k, f = np.arange(1, until + 1), given.limits
    r, speed, price, broken = r[k], speed[k], np.zeros(until), np.zeros(until, bool)
    terms = [
        (r < f.near, 0.02 + 20.0 * (1.0 - r / max(f.near, 1e-9)) ** 2),
        (r > f.far, 0.02 + 0.1 * np.minimum(1.0, r / f.far - 1.0)),
    ]
    if f.speed < math.inf:
        limit = f.speed + f.slope * (r - f.near)
        terms.append((speed > limit, 0.02 + speed - limit))
    if f.cos_glare <= 1.0:
        away = -(states[k, :2] * given.sun[k, :2]).sum(axis=1) / r
        terms.append((away > f.cos_glare, 0.02 + away - f.cos_glare))
    met = np.zeros(until, bool)
    for other in given.others:
        offset, motion = states[k, :3] - other[k, :3], states[k, 3:] - other[k, 3:]
        moment = np.clip(-(offset * motion).sum(axis=1) / (motion**2).sum(axis=1), -5.0, 5.0)
        least = np.linalg.norm(offset + moment[:, None] * motion, axis=1)
        price += np.where(least < given.clearance, 0.02 + 20.0 * (1.0 - least / given.clearance) ** 2, 0.0)
        met |= least < given.clearance
    for where, amount in terms:
        price += np.where(where, amount, 0.0)
        broken |= where
    spent = np.abs(delta_v[start < until]).sum()
    total = spent + price.sum() + given.haste * DT * end
    if not done.all():
        ranges = np.linalg.norm(states[:, :3], axis=1)[:, None]
        lacking = (RADIUS**2 * (1 + 1e-9) - states[:, :3] @ given.points.T) / (RADIUS * ranges)
        counted = given.lit & (ranges >= given.sight)
        counted[0] = False
        lack = np.where(counted, lacking, 2.0).min(axis=0)[given.needed][~done]
        total += 0.1 + (0.02 + 0.1 * np.minimum(lack, 2.0)).sum()
    return total, spent, int((~done).sum()), end, int((broken | met).sum())


@pytest.mark.parametrize("others", [0, 2])
@pytest.mark.parametrize("name", LIMITS)
def test_a_plan_costs_what_its_states_say(name: str, others: int) -> None:
    left = breaches = 0
    for seed in range(12):
        given = problem(seed, LIMITS[name], others)
        if seed % 3 == 0:  # few points, so that all are seen
            given.needed[3:] = False
        if seed % 6 == 1:
            given.needed[:] = False
            given = given._replace(wait=30 + seed)
        found, expected = evaluated(given, seed), cost_by_numpy(given, seed)
        assert found[2:] == expected[2:]
        np.testing.assert_allclose(found[:2], expected[:2], rtol=1e-9)
        left, breaches = left + found.left, breaches + found.breaches
    assert left > 30
    assert breaches > 15 or (name == "none" and not others)


def test_a_plan_is_broken_off_above_a_cutoff_and_checked_every_few_steps() -> None:
    numbers = []
    for seed in range(8):
        given = problem(seed, LIMITS["all"], 1)
        whole = evaluated(given, seed)
        assert evaluated(given, seed, cutoff=math.inf) == whole
        numbers += [evaluated(given, seed, cutoff=share * whole.cost) for share in (0.1, 0.6, 0.9)]
        numbers += [evaluated(given, seed, stride) for stride in (2, 5, 7)]
    check_record(RECORD, "evaluated", {"outcomes": numbers})


@pytest.mark.parametrize(("size", "steps"), [(0.0, 0), (1e-9, 0), (1.2e-9, 1), (0.05, 1), (0.0500001, 2), (0.1, 2)])
def test_a_burn_lasts_as_long_as_its_largest_axis(size: float, steps: int) -> None:
    for axis in range(3):
        delta_v = np.zeros(3)
        delta_v[axis] = -size
        assert burn_steps(delta_v, np.full(3, 0.05)) == steps
    assert burn_steps(np.array([0.02, size, 0.0]), np.array([0.01, 0.05, 0.01])) == max(2, steps)


def test_burns_are_put_in_order_and_none_begins_before_the_last_has_ended() -> None:
    given = problem(0, NO_LIMITS, period=4, reach=np.array([0.05, 0.0, 0.02]))
    start = np.array([31, 5, 6, STEPS - 1, 0])
    delta_v = np.array([[0.1, 0.5, 0.0], [0.0, 0.5, 0.1], [0.05, 0.5, 0.0], [0.01, 0.0, 0.0], [0.0, 0.9, 0.0]])
    settle(given, start, delta_v)
    assert start.tolist() == [0, 8, 16, 32, STEPS]
    assert delta_v.tolist() == [[0, 0, 0], [0, 0, 0.1], [0.05, 0, 0], [0.1, 0, 0], [0, 0, 0]]


@pytest.mark.parametrize("name", ["none", "all"])
@pytest.mark.parametrize("few", [False, True])
def test_a_plan_is_kept_improved_before_its_burn_or_made_again(name: str, few: bool) -> None:
    """Where all points are seen and where not, with another deputy near and without."""
    arrays: dict[str, list[Any]] = {"outcome": [], "start": [], "delta_v": [], "seed": []}
    for seed in range(12):
        given = problem(seed, LIMITS[name], seed // 2 % 2)
        given.needed[4:] &= not few
        state, start, delta_v = plan(seed, 1 + seed % 4)
        state[3:] *= 0.3
        start[0] = 0 if seed % 4 < 2 else start[0] + 10
        random, before = np.array([seed], np.uint64), delta_v.copy()
        outcome = revise_plan(given, state, start, delta_v, random, AnnealingEffort(1 + seed % 6, 40, 3))
        if random[0] == seed:
            np.testing.assert_array_equal(delta_v, before)
        found = outcome, start, delta_v.sum(axis=1), random >> np.uint64(32)
        for kept, value in zip(arrays.values(), found, strict=True):
            kept.extend(np.ravel(value))
    check_record(RECORD, f"revised, {name}, {few}", arrays)


def test_a_worse_plan_is_accepted_as_metropolis_says() -> None:
    for cost, temperature, done, uniform in ((1.0, 0.5, 0.0, 0.3), (2.0, 0.1, 0.75, 0.9), (0.0, 1.0, 1.0, 0.5)):
        expected = cost - temperature * (1.0 - done) * math.log(uniform)
        assert accepted_cost(cost, temperature, done, uniform) == pytest.approx(expected, rel=1e-14)
    assert accepted_cost(0.0, 1.0, 0.0, 0.0) == pytest.approx(300.0 * math.log(10.0))


def test_points_that_others_will_inspect_are_struck_off() -> None:
    struck = 0
    for seed in range(8):
        given = problem(seed, LIMITS["range" if seed % 2 else "none"], others=2)
        generator = np.random.default_rng(seed)
        position, velocity = generator.normal(size=(2, 3)) * 20.0, generator.normal(size=(2, 3)) * 0.03
        before = given.needed.copy()
        given.others[:] = np.nan
        last = coast_others(given, position, velocity)
        first = np.full(POINTS, STEPS + 1)
        for k in range(2):
            states = MAPS.phi @ np.concatenate((position[k], velocity[k]))
            np.testing.assert_allclose(given.others[k], states, rtol=1e-12, atol=1e-12)
            r = np.linalg.norm(states[:, :3], axis=1)
            inside = np.logical_and.accumulate((r >= RADIUS) & (r <= given.limits.far)) & (r >= given.sight)
            sees = (states[:, :3] @ given.points.T >= RADIUS**2) & given.lit & inside[:, None]
            sees[0] = False
            seen = sees.any(axis=0) & (first > STEPS)
            first[seen] = sees.argmax(axis=0)[seen]
        np.testing.assert_array_equal(given.needed, before & (first > STEPS))
        assert last == first[before & (first <= STEPS)].max(initial=0)
        struck += int((before & ~given.needed).sum())
    assert struck > 20


#: A deputy at rest with a plan of two burns: step, finished, arrival, review, turn, off the arc by; and whether it
#: plans then, and its review afterwards. Burns begin at steps 12 and 30 and last two steps each.
CASES = {
    "a review that is due": (20, 0, 20, 20, 0, 0.0, 0.0, True, 20),
    "a review that is overdue": (22, 0, 22, 20, 0, 0.0, 0.0, True, 20),
    "a review to come": (18, 0, 18, 20, 0, 0.0, 0.0, False, 20),
    "planned before": (20, 0, 21, 20, 0, 0.0, 0.0, False, 20),
    "steps that were left out": (18, 0, 16, 20, 0, 0.0, 0.0, True, 0),
    "finished": (20, 1, 20, 20, 0, 0.0, 0.0, False, 20),
    "another's turn": (21, 0, 21, 20, 0, 0.0, 0.0, False, 20),
    "its own turn": (21, 0, 21, 20, 1, 0.0, 0.0, True, 20),
    "off the arc in position": (18, 0, 18, 20, 0, 1.2e-4, 0.0, True, 0),
    "nearly off the arc in position": (18, 0, 18, 20, 0, 0.9e-4, 0.0, False, 20),
    "off the arc in velocity": (18, 0, 18, 20, 0, 0.0, 1.2e-7, True, 0),
    "nearly off the arc in velocity": (18, 0, 18, 20, 0, 0.0, 0.9e-7, False, 20),
    "off the arc in another's turn": (19, 0, 19, 20, 0, 1.0, 0.0, False, 0),
    "the step of a burn": (12, 0, 12, 20, 0, 0.0, 0.0, True, 20),
    "amid a burn": (13, 0, 13, 10, 1, 0.0, 0.0, False, 10),
    "after a burn": (14, 0, 14, 10, 0, 0.0, 0.0, True, 10),
    "after a burn, not due": (14, 0, 14, 20, 0, 0.0, 0.0, False, 20),
}


def deputy(step: int, finished: int, state: np.ndarray) -> DeputyRows:
    return DeputyRows(np.array([step]), np.array([finished], np.int8), state[:, :3].copy(), state[:, 3:].copy())


@pytest.mark.parametrize("name", CASES)
def test_when_a_plan_is_reviewed(name: str) -> None:
    step, finished, arrival, review, turn, away, faster, due, after = CASES[name]
    for axis in range(3):
        for sign in (1.0, -1.0):
            state = np.arange(1.0, 7.0)[None]
            expected = state.copy()
            expected[0, axis] += sign * away
            expected[0, 3 + axis] += sign * faster
            deputies = DeputyRows(
                np.array([step]), np.array([finished], np.int8), state[:, :3].copy(), state[:, 3:].copy()
            )
            plans = PlanRows(
                np.array([[12, 30]]), np.array([[[0.06, 0.0, 0.0], [0.0, 0.0, -0.1]]]), np.array([review]), expected,
                np.array([arrival]), np.array([turn]), np.full((1, 3), 0.05),
            )  # fmt: skip
            assert rows_to_plan(deputies, plans, 2).tolist() == [due]
            assert plans.review.tolist() == [after]


@pytest.mark.parametrize(
    ("step", "finished", "push"),
    [(11, 0, (0.0, 0.0, 0.0)), (12, 0, (0.003, 0.0, 0.0)), (13, 0, (0.003, 0.0, 0.0)), (14, 0, (0.0, 0.0, 0.0)),
     (13, 1, (0.0, 0.0, 0.0)), (30, 0, (0.0, 0.0, -0.005)), (31, 0, (0.0, 0.0, -0.005)), (32, 0, (0.0, 0.0, 0.0))],
)  # fmt: skip
def test_a_plan_is_flown_and_where_it_leads_is_remembered(step: int, finished: int, push: tuple[float, ...]) -> None:
    state = np.array([[50.0, -20.0, 30.0, 0.1, -0.2, 0.05]])
    deputies = deputy(step, finished, state)
    plans = PlanRows(
        np.array([[12, 30]]), np.array([[[0.06, 0.0, 0.0], [0.0, 0.0, -0.1]]]), np.zeros(1, np.int64),
        np.full((1, 6), np.nan), np.zeros(1, np.int64), np.zeros(1, np.int64), np.full((1, 3), 0.05),
    )  # fmt: skip
    acceleration = np.full((1, 3), np.nan)
    follow_plans(deputies, plans, MAPS, acceleration)
    np.testing.assert_allclose(acceleration, [push], rtol=1e-14)
    np.testing.assert_allclose(plans.expected[0], MAPS.phi[1] @ state[0] + MAPS.gamma[1] @ push, rtol=1e-12)
    assert plans.arrival.tolist() == [step + 1]
