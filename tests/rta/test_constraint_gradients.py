"""Gradients and rates against central differences, and h against the formulas written out with vectors."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.rta.constraints import RelativeState, constraint_set

ROWS = 10_000
N = 0.001027
HORIZONS = {"100 s": 100.0, "an orbit": 6118.0, "two orbits": 12236.0}


def shifted(state, by, sun=0.0):
    return RelativeState(state.position + by[..., :3], state.velocity + by[..., 3:], state.sun_angle + sun)


def away_from_edges(state):
    """Return the rows farther than 0.1 m from where h is not smooth, but for the switches of the closest approach."""
    distance = np.linalg.norm(state.position, axis=1)
    sun = np.stack((np.cos(state.sun_angle), -np.sin(state.sun_angle), 0 * distance), axis=1)
    along = -np.sum(state.position * sun, axis=1)
    off_axis = np.linalg.norm(state.position + along[:, None] * sun, axis=1)
    gap = off_axis * np.cos(np.pi / 6) - along * np.sin(np.pi / 6)
    edges = np.stack((distance - 10.0, distance - 800.0, off_axis, gap))
    return np.abs(edges).min(axis=0) > 0.1


@pytest.mark.parametrize("name", [name for name in constraint_set({}) if name != "PSM"])
def test_gradients_are_central_differences(name, draw):
    state = draw(1, ROWS)
    state = state[away_from_edges(state)]
    assert len(state) > 0.95 * ROWS
    constraint = constraint_set({})[name]
    exact, numeric = constraint.gradient(state), np.zeros((len(state), 6))
    for column in range(6):
        step = np.zeros(6)
        step[column] = 1e-4 if column < 3 else 1e-5
        difference = constraint.h(shifted(state, step)) - constraint.h(shifted(state, -step))
        numeric[:, column] = difference / (2 * step[column])
    np.testing.assert_allclose(exact, numeric, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("horizon", HORIZONS)
def test_the_gradient_of_the_closest_approach_is_a_central_difference_away_from_its_kinks(horizon, draw):
    state = draw(2, ROWS)
    constraint = constraint_set({"psm_horizon": HORIZONS[horizon]}, ["PSM"])["PSM"]
    exact, here = constraint.gradient(state), constraint.h(state)
    smooth = np.ones(ROWS, bool)
    worst = np.zeros(ROWS)
    for column in range(6):
        step = np.zeros(6)
        step[column] = 1e-4 if column < 3 else 1e-7
        ahead, behind = constraint.h(shifted(state, step)), constraint.h(shifted(state, -step))
        slopes = np.stack((ahead - here, here - behind)) / step[column]
        scale = 1.0 + np.abs(exact[:, column])
        smooth &= np.abs(slopes[0] - slopes[1]) < 1e-2 * scale  # else a kink, or a hit on the centre, lies between
        worst = np.maximum(worst, np.abs(slopes.mean(axis=0) - exact[:, column]) / scale)
    assert smooth.mean() > 0.99
    assert worst[smooth].max() < 5e-3
    assert np.quantile(worst, 0.9) < 1e-5


@pytest.mark.parametrize("name", constraint_set({}))
def test_the_rate_is_the_derivative_as_the_sun_turns(name, draw):
    state = draw(3, ROWS)
    state = state[away_from_edges(state)]
    constraint = constraint_set({})[name]
    numeric = (
        constraint.h(shifted(state, np.zeros(6), 1e-6)) - constraint.h(shifted(state, np.zeros(6), -1e-6))
    ) / 2e-6
    np.testing.assert_allclose(constraint.evaluate(state).rate, N * numeric, rtol=1e-5, atol=1e-7)
    if name == "sun":
        assert np.abs(constraint.evaluate(state).rate).max() > 1e-3


def test_h_and_phi_are_the_formulas_of_the_reference(draw):
    state = draw(4, ROWS)
    p, v = state.position, state.velocity
    r, speed = np.linalg.norm(p, axis=1), np.linalg.norm(v, axis=1)
    constraints = constraint_set({})
    a = constraints["chief_collision"].max_acceleration
    radial = np.einsum("ij,ij->i", p, v) / r

    def root(distance):
        return np.sign(distance) * np.sqrt(2 * a * np.abs(distance))

    sun = np.stack((np.cos(state.sun_angle), -np.sin(state.sun_angle), 0 * r), axis=1)
    axis, beta = -sun, np.pi / 6
    angle = np.arccos(np.einsum("ij,ij->i", p, axis) / r)
    d = r * np.sin(angle - beta)
    across = p - np.einsum("ij,ij->i", p, axis)[:, None] * axis
    generator = np.cos(beta) * axis + np.sin(beta) * across / np.linalg.norm(across, axis=1)[:, None]
    q = np.einsum("ij,ij->i", p, generator)[:, None] * generator
    turning = np.cross([0.0, 0.0, -N], q)
    expected_h = {
        "chief_collision": root(r - 10.0) + radial,
        "r_max": root(800.0 - r) - radial,
        "rel_vel": 0.2 + 2 * N * (np.sqrt(r**2 + 1e-5) - 10.0) - np.sqrt(speed**2 + 1e-5),
        "sun": root(d) + np.einsum("ij,ij->i", p - q, v - turning) / d,
        "x_vel": 1.0 - v[:, 0] ** 2,
        "y_vel": 1.0 - v[:, 1] ** 2,
        "z_vel": 1.0 - v[:, 2] ** 2,
    }
    for name, h in expected_h.items():
        np.testing.assert_allclose(constraints[name].h(state), h, rtol=1e-9, atol=1e-9, err_msg=name)
    np.testing.assert_allclose(constraints["sun"](state), angle - beta, atol=1e-9)
    np.testing.assert_allclose(constraints["chief_collision"](state), r - 10.0, atol=1e-9)
    np.testing.assert_allclose(constraints["r_max"](state), 800.0 - r, atol=1e-9)
    np.testing.assert_allclose(constraints["rel_vel"](state), 0.2 + 2 * N * (r - 10.0) - speed, atol=1e-12)
    np.testing.assert_allclose(constraints["z_vel"](state), 1.0 - np.abs(v[:, 2]), atol=1e-12)
