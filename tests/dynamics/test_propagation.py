"""The compiled step against the matrix product, and a batch's rows against single rows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safe_inspect.dynamics.cwh import propagate, transition

PHI, GAMMA = transition(0.001027, 12.0, 10.0)


def rows(count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(0, 80, (count, 3)), rng.normal(0, 0.3, (count, 3)), rng.uniform(-1, 1, (count, 3))


def step(position: np.ndarray, velocity: np.ndarray, control: np.ndarray) -> np.ndarray:
    out = np.full((2, *position.shape), np.nan)
    propagate(position, velocity, control, PHI, GAMMA, out[0], out[1])
    return out


def test_is_the_linear_map() -> None:
    position, velocity, control = rows(50, 0)
    expected = np.hstack([position, velocity]) @ PHI.T + control @ GAMMA.T
    after = step(position, velocity, control)
    np.testing.assert_allclose(np.hstack([after[0], after[1]]), expected, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("count", [1, 2, 7, 64, 1000])
def test_a_row_alone_is_the_same_to_the_bit(count: int) -> None:
    states = rows(count, count)
    whole = step(*states)
    for row in {0, count // 2, count - 1}:
        alone = step(*(part[row : row + 1] for part in states))
        assert np.array_equal(alone[:, 0], whole[:, row])


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 20))
@settings(max_examples=20, deadline=None)
def test_order_of_rows_does_not_matter(seed: int, count: int) -> None:
    states = rows(count, seed)
    order = np.random.default_rng(seed).permutation(count)
    assert np.array_equal(step(*(part[order] for part in states)), step(*states)[:, order])


def test_in_place_and_inputs_otherwise_untouched() -> None:
    position, velocity, control = rows(5, 3)
    copies = position.copy(), velocity.copy(), control.copy()
    expected = step(position, velocity, control)
    for part, copy in zip((position, velocity, control), copies, strict=True):
        assert np.array_equal(part, copy)
    propagate(position, velocity, control, PHI, GAMMA, position, velocity)
    assert np.array_equal(np.stack([position, velocity]), expected)
    assert np.array_equal(control, copies[2])


def test_thousand_coasting_steps_are_one_long_one() -> None:
    position, velocity, _ = rows(4, 9)
    phi, _ = transition(0.001027, 12.0, 10_000.0)
    expected = np.hstack([position, velocity]) @ phi.T
    for _ in range(1000):
        propagate(position, velocity, np.zeros((4, 3)), PHI, GAMMA, position, velocity)
    np.testing.assert_allclose(np.hstack([position, velocity]), expected, rtol=1e-10, atol=1e-8)
