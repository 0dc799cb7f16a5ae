"""The closest approach of coasting, against a dense grid, against integration, and by hand."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from safe_inspect.rta.constraints import RelativeState
from safe_inspect.rta.constraints.ranges import PassivelySafeManoeuvre

N = 0.001027
ORBIT = 2 * math.pi / N
SYSTEM = np.zeros((6, 6))
SYSTEM[:3, 3:] = np.eye(3)
SYSTEM[3, 0], SYSTEM[3, 4], SYSTEM[4, 3], SYSTEM[5, 2] = 3 * N**2, 2 * N, -2 * N, -(N**2)


def ranges(state, times):
    """Return the coasting range of every row at every time, by powers of the matrix exponential, shape (R, T)."""
    x = np.concatenate((state.position, state.velocity), axis=1)
    step = expm(SYSTEM * (times[1] - times[0])).T
    found = []
    for _ in times:
        found.append(np.linalg.norm(x[:, :3], axis=1))
        x = x @ step
    return np.stack(found, axis=1)


@pytest.mark.parametrize(("horizon", "nodes"), [(100.0, 1001), (ORBIT, 3001), (3.3 * ORBIT, 8001)])
@pytest.mark.parametrize("fastest", [0.05, 1.0])
def test_no_closer_approach_is_missed(horizon, nodes, fastest, draw):
    state = draw(11, 1000, farthest=300.0, fastest=fastest)
    least = PassivelySafeManoeuvre(horizon=horizon).h(state) + 10.0
    times = np.linspace(0.0, horizon, nodes)
    brute = ranges(state, times)
    assert (least <= brute.min(axis=1) + 1e-6).all()
    # the grid's least is above the true one by no more than half a step of flight
    fastest_flight = np.abs(np.diff(brute, axis=1)).max(axis=1)
    assert (least >= brute.min(axis=1) - fastest_flight).all()


def test_slow_drifting_ellipses_with_many_approaches_are_followed_too():
    generator = np.random.default_rng(12)
    position = generator.uniform(-100.0, 100.0, (1000, 3))
    velocity = generator.normal(0.0, 0.01, (1000, 3))
    velocity[:, 1] -= 2 * N * position[:, 0]
    state = RelativeState(position, velocity, np.zeros(1000))
    least = PassivelySafeManoeuvre(horizon=2 * ORBIT).h(state) + 10.0
    brute = ranges(state, np.linspace(0.0, 2 * ORBIT, 6001)).min(axis=1)
    assert (least <= brute + 1e-6).all()
    np.testing.assert_allclose(least, brute, atol=0.1)


def test_the_closest_approach_is_that_of_the_integrated_motion(draw):
    state = draw(13, 12, farthest=200.0, fastest=0.5)
    least = PassivelySafeManoeuvre(horizon=1.5 * ORBIT).h(state) + 10.0
    for row in range(len(state)):
        start = np.concatenate((state.position[row], state.velocity[row]))

        def closing(_time, x):
            return x[:3] @ x[3:]

        closing.direction = 1.0
        flown = solve_ivp(
            lambda _time, x: SYSTEM @ x, (0.0, 1.5 * ORBIT), start, method="DOP853", events=closing,
            rtol=1e-12, atol=1e-12,
        )  # fmt: skip
        visited = [start, flown.y[:, -1], *flown.y_events[0]]
        assert least[row] == pytest.approx(min(np.linalg.norm(x[:3]) for x in visited), abs=1e-6)


def test_a_straight_pass_over_a_short_time_by_hand():
    # 50 m off, flying at 1 m/s past a miss distance of 30 m: closest after 40 s
    state = RelativeState(np.array([[0.0, -40.0, 30.0]]), np.array([[0.0, 1.0, 0.0]]), np.zeros(1))
    slow_orbit = PassivelySafeManoeuvre(mean_motion=1e-9, collision_radius=10.0, horizon=100.0)
    found = slow_orbit.evaluate(state)
    assert found.h[0] == pytest.approx(20.0, abs=1e-6)
    np.testing.assert_allclose(found.gradient[0], [0, 0, 1, 0, 0, 40], atol=1e-4)
    np.testing.assert_array_equal(found.phi, found.h)
    # with a horizon of 10 s the closest is the last: 30 m aside, 30 m behind
    early = PassivelySafeManoeuvre(mean_motion=1e-9, collision_radius=10.0, horizon=10.0).evaluate(state)
    aside = math.sqrt(0.5)
    assert early.h[0] == pytest.approx(30.0 / aside - 10.0, abs=1e-6)
    np.testing.assert_allclose(early.gradient[0], [0, -aside, aside, 0, -10 * aside, 10 * aside], atol=1e-4)


def test_leaving_deputies_are_closest_now():
    state = RelativeState(np.array([[0.0, 60.0, 0.0]]), np.array([[0.0, 0.3, 0.0]]), np.zeros(1))
    found = PassivelySafeManoeuvre(collision_radius=10.0).evaluate(state)
    assert found.h[0] == 50.0
    np.testing.assert_array_equal(found.gradient[0], [0, 1, 0, 0, 0, 0])


def test_the_closed_ellipse_about_the_chief_keeps_its_semi_minor_axis():
    # x = 50 cos nt, y = -100 sin nt: the 2 by 1 ellipse of relative motion
    state = RelativeState(np.array([[0.0, 100.0, 0.0]]), np.array([[50.0 * N, 0.0, 0.0]]), np.zeros(1))
    for orbits in (0.3, 1.0, 5.0):
        least = PassivelySafeManoeuvre(collision_radius=10.0, horizon=orbits * ORBIT).h(state)[0]
        assert least == pytest.approx(40.0, abs=1e-9)


def test_a_longer_horizon_is_never_safer(draw):
    state = draw(14, 500, farthest=300.0, fastest=0.3)
    h = [PassivelySafeManoeuvre(horizon=horizon).h(state) for horizon in (50.0, 100.0, 1000.0, ORBIT, 2 * ORBIT)]
    for shorter, longer in pairwise(h):
        assert (longer <= shorter + 1e-9).all()
    assert (h[-1] < h[0] - 1.0).mean() > 0.3


def reversed_in_time(state, horizon):
    """Return the states from which the same ranges are flown in the reverse order: coasted, then mirrored in y."""
    x = np.concatenate((state.position, state.velocity), axis=1) @ expm(SYSTEM * horizon).T
    x *= np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    return RelativeState(x[:, :3].copy(), x[:, 3:].copy(), state.sun_angle)


@pytest.mark.parametrize("horizon", [100.0, 2 * ORBIT])
def test_flown_backwards_the_closest_approach_is_the_same(horizon, draw):
    state = draw(16, 1000, farthest=300.0, fastest=0.3)
    constraint = PassivelySafeManoeuvre(horizon=horizon)
    np.testing.assert_allclose(constraint.h(state), constraint.h(reversed_in_time(state, horizon)), atol=1e-8)


def test_a_dip_between_two_nodes_of_the_grid_is_found():
    # the range rises at 0 s and at 95 s, nodes of the grid, and has a maximum and its least value between
    state = RelativeState(np.array([[205.5, -647.6, 395.1]]), np.array([[-1e-4, -3e-4, -2e-4]]), np.zeros(1))
    flown = ranges(state, np.linspace(0.0, 380.0, 7601))[0]
    assert flown[1] > flown[0]
    assert flown[1901] > flown[1900]
    assert flown.min() < min(flown[0], flown[1900], flown[-1]) - 0.02
    constraint = PassivelySafeManoeuvre(horizon=380.0)
    for way in (state, reversed_in_time(state, 380.0)):
        assert constraint.h(way)[0] == pytest.approx(flown.min() - 10.0, abs=1e-6)
