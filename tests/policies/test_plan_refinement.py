"""Plans that linear programmes refine see every point, within the limits of range and of thrust, for less fuel."""

from __future__ import annotations

import math

import numpy as np
import pytest

from safe_inspect.dynamics.step_maps import step_maps
from safe_inspect.geometry.sphere import sphere_points
from safe_inspect.policies.burn_problem import BurnProblem, FlightLimits
from safe_inspect.policies.plan_refinement import refine_plan
from safe_inspect.types import FloatArray

N, DT, STEPS, RADIUS = 0.001027, 10.0, 320, 10.0
MAPS = step_maps(N, DT, STEPS)


def problem(seed: int, near: float = RADIUS, far: float = 200.0, reach: float = 1.0) -> tuple[BurnProblem, FloatArray]:
    """Return an episode that begins at some 40 m, with points that are lit on the sun's side, and its first state."""
    generator = np.random.default_rng(seed)
    state = np.concatenate((generator.normal(size=3) * 25.0, generator.normal(size=3) * 0.03))
    points = sphere_points("fibonacci", 12, RADIUS)
    angle = generator.uniform(0.0, 2.0 * np.pi) - N * DT * np.arange(STEPS + 1)
    sun = np.stack((np.cos(angle), np.sin(angle), 0.0 * angle), axis=1)
    return BurnProblem(
        maps=MAPS, lit=sun @ points.T > 0.0, sun=sun, points=points, radius=RADIUS, sight=RADIUS,
        needed=np.arange(12) != 5, others=np.empty((0, STEPS + 1, 6)), wait=0, margin=0, phase=0, period=1,
        reach=np.full(3, reach), limits=FlightLimits(near, far, math.inf, 0.0, 2.0), clearance=1.0, haste=0.0,
    ), state  # fmt: skip


def flown(state: FloatArray, delta_v: FloatArray) -> FloatArray:
    """Return the position after every step, step by step [m]."""
    positions = [state[:3]]
    for burn in delta_v:
        state = MAPS.phi[1] @ state + MAPS.gamma[1] @ (burn / DT)
        positions.append(state[:3])
    return np.array(positions)


@pytest.mark.parametrize("reach", [1.0, 0.05])
def test_every_point_is_seen_within_the_limits(reach: float) -> None:
    found = 0
    for seed in range(12):
        near, far = 12.0, 60.0 if seed % 2 else 90.0
        given, state = problem(seed, near, far, reach)
        delta_v = refine_plan(given, state, np.zeros((STEPS, 3)))
        if delta_v is None:
            continue
        found += 1
        assert np.abs(delta_v).max() <= reach * (1.0 + 1e-9)
        position = flown(state, delta_v)
        seen = given.lit & (position @ given.points.T / RADIUS >= RADIUS + 0.5e-6)
        seen[0] = False
        assert seen[:, given.needed].any(axis=0).all()
        last = max(int(seen[:, p].argmax()) for p in np.flatnonzero(given.needed))
        r = np.linalg.norm(position[1 : last + 1], axis=1)
        assert r.min() >= near
        assert r.max() <= far
    assert found >= 8


def test_a_refined_plan_is_not_refined_further_and_cheaper_sightings_are_found() -> None:
    given, state = problem(3)
    one = refine_plan(given, state, np.zeros((STEPS, 3)))
    assert one is not None
    again = refine_plan(given, state, one)
    assert again is not None
    assert np.abs(again).sum() == pytest.approx(np.abs(one).sum(), abs=1e-4)
    detour = one.copy()
    detour[40, 2] += 0.02
    back = refine_plan(given, state, detour)
    assert back is not None
    assert np.abs(back).sum() < np.abs(detour).sum() - 0.005


def test_no_plan_is_found_for_a_point_that_is_never_lit_or_without_thrust() -> None:
    given, state = problem(3)
    dark = given.lit.copy()
    dark[:, 2] = False
    assert refine_plan(given._replace(lit=dark), state, np.zeros((STEPS, 3))) is None
    assert refine_plan(given._replace(reach=np.zeros(3)), state, np.zeros((STEPS, 3))) is None
