"""Motion without thrust and its nearest and farthest points, against the matrix exponential and dense samples."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from safe_inspect.dynamics.coasting import (
    closed_motion_state,
    coast,
    coasting_position,
    extreme_time,
    grid,
    largest_coasting_range,
    least_coasting_range,
)

from ..reference.hill import system_matrices

N = 0.001027
units = st.tuples(*[st.floats(-1.0, 1.0)] * 6)


def state_of(unit, size, speed):
    return np.multiply(unit, [size] * 3 + [speed] * 3)


@settings(max_examples=100, deadline=None)
@given(unit=units, size=st.sampled_from((1.0, 100.0)), speed=st.sampled_from((0.01, 1.0)), angle=st.floats(-7.0, 7.0))
def test_coasting_is_the_matrix_exponential_and_its_derivatives(unit, size, speed, angle):
    x, t = state_of(unit, size, speed), angle / N
    matrix, _ = system_matrices(N, 1.0)
    expected = expm(matrix * t) @ x
    rate = matrix @ expected
    p, v, a = expected[:3], expected[3:], rate[3:]
    scale = size + speed / N
    s, c = math.sin(angle), math.cos(angle)
    found = np.array(coast(x[:3].copy(), x[3:].copy(), t, s, c, N))
    np.testing.assert_allclose(found[:3], p, rtol=1e-9, atol=1e-9 * scale)
    np.testing.assert_allclose(found[3:6], v, rtol=1e-9, atol=1e-9 * scale * N)
    assert found[6] == pytest.approx(p @ p, rel=1e-8, abs=1e-8 * scale**2)
    assert found[7] == pytest.approx(p @ v, rel=1e-8, abs=1e-8 * scale**2 * N)
    assert found[8] == pytest.approx(v @ v + p @ a, rel=1e-8, abs=1e-8 * scale**2 * N**2)
    np.testing.assert_allclose(coasting_position(N, tuple(x.tolist()), angle, c, s), p, rtol=1e-9, atol=1e-9 * scale)
    x[4] = -2.0 * N * x[0]
    closed = expm(matrix * t) @ x
    found = np.array(closed_motion_state(N, tuple(x.tolist()), c, s))
    np.testing.assert_allclose(found[:3], closed[:3], rtol=1e-9, atol=1e-9 * scale)
    np.testing.assert_allclose(found[3:], closed[3:], rtol=1e-9, atol=1e-9 * scale * N)


@settings(max_examples=60, deadline=None)
@given(unit=units, size=st.sampled_from((1.0, 100.0)), horizon=st.sampled_from((100.0, 3000.0, 12000.0)))
def test_no_sample_is_nearer_than_the_nearest_or_farther_than_the_farthest(unit, size, horizon):
    x, table = state_of(unit, size, size * N), grid(N, horizon)
    p, v = x[:3].copy(), x[3:].copy()
    count = 4000
    step = expm(system_matrices(N, 1.0)[0] * (horizon / count))
    states = [x]
    for _ in range(count):
        states.append(step @ states[-1])
    ranges = np.linalg.norm(np.array(states)[:, :3], axis=-1)
    tiny = 1e-7 * (size + ranges.max())
    fastest = np.linalg.norm(np.array(states)[:, 3:], axis=-1).max()
    between = fastest * horizon / count  # what may happen between two samples
    least, largest = least_coasting_range(p, v, table, N), largest_coasting_range(p, v, table, N)
    assert ranges.min() - between - tiny <= least <= ranges.min() + tiny
    assert ranges.max() - tiny <= largest <= ranges.max() + between + tiny
    t = extreme_time(p, v, table, N, 1.0)
    assert 0.0 <= t <= horizon
    there = np.linalg.norm(np.array(coast(p, v, t, math.sin(N * t), math.cos(N * t), N))[:3])
    assert there == pytest.approx(least, rel=1e-12)


@pytest.mark.parametrize("cell", [0.3, 0.6, 1.0])
def test_a_coarse_grid_finds_what_a_fine_one_does(cell):
    """In a wide cell the range may fall, rise and fall again."""
    generator = np.random.default_rng(4)
    coarse, fine = grid(N, 6000.0, cell), grid(N, 6000.0, 0.01)
    for x in generator.normal(size=(4000, 6)) * ([100.0] * 3 + [100.0 * N] * 3):
        p, v = x[:3].copy(), x[3:].copy()
        for extreme in (least_coasting_range, largest_coasting_range):
            assert extreme(p, v, coarse, N) == pytest.approx(extreme(p, v, fine, N), abs=1e-6)
