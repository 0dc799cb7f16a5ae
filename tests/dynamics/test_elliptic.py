"""Elliptic integrals and functions against SciPy's, the regulator against its equation, and the grid of coasting."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.special import ellipj, ellipkinc, ellipkm1, elliprf, elliprj

from safe_inspect.dynamics import elliptic
from safe_inspect.dynamics.coasting import CELL, closed_motion_state, coasting_position, grid
from safe_inspect.dynamics.cwh import transition
from safe_inspect.dynamics.regulator import regulator

amplitude, complete_first, incomplete_third = (
    np.vectorize(function) for function in (elliptic.amplitude, elliptic.complete_first, elliptic.incomplete_third)
)
COMPLEMENTS = np.array([1e-30, 1e-12, 1e-3, 0.2, 0.7, 1.0])
ANGLES = np.array([-9.0, -1.6, -0.3, 0.0, 0.5, 1.5, 3.0, 4.8, 11.0])


def test_the_complete_integral_also_where_the_modulus_is_one_but_for_rounding() -> None:
    np.testing.assert_allclose(complete_first(COMPLEMENTS), ellipkm1(COMPLEMENTS), rtol=1e-13)


@pytest.mark.parametrize("m1", [0.05, 0.3, 0.9, 1.0])
def test_the_incomplete_integrals_and_the_amplitude(m1: float) -> None:
    given = np.full(len(ANGLES), m1)
    first = incomplete_third(0.0, ANGLES, m1)
    np.testing.assert_allclose(first, ellipkinc(ANGLES, 1.0 - m1), rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(amplitude(first, given), ANGLES, rtol=1e-10, atol=1e-12)
    sn, cn, _, _ = ellipj(first, 1.0 - m1)
    np.testing.assert_allclose(np.sin(amplitude(first, given)), sn, atol=1e-10)
    np.testing.assert_allclose(np.cos(amplitude(first, given)), cn, atol=1e-10)
    for nu in (0.0, 0.4, 3.0):
        expected = [
            quad(lambda t: 1 / ((1 + nu * np.sin(t) ** 2) * np.sqrt(1 - (1 - m1) * np.sin(t) ** 2)), 0.0, angle)[0]  # noqa: B023
            for angle in ANGLES
        ]
        found = incomplete_third(np.full(len(ANGLES), nu), ANGLES, given)
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9)
        part = (np.abs(ANGLES) < 0.5 * np.pi) & (ANGLES != 0.0)
        sine, cosine = np.sin(ANGLES[part]), np.cos(ANGLES[part])
        arguments = cosine**2, cosine**2 + m1 * sine**2, 1.0
        third = sine**3 * elliprj(*arguments, 1.0 + nu * sine**2)
        np.testing.assert_allclose(found[part], sine * elliprf(*arguments) - nu / 3.0 * third, rtol=1e-14)


def test_the_amplitude_turns_at_the_quarter_periods() -> None:
    for m1 in (1e-20, 1e-6, 0.5):
        quarter = complete_first(np.array([m1]))
        np.testing.assert_allclose(amplitude(np.array([1.0, 2.0, -4.0]) * quarter, np.full(3, m1)),
                                   np.pi * np.array([0.5, 1.0, -2.0]), rtol=1e-7)  # fmt: skip


def test_the_regulator_lets_no_other_gain_cost_less() -> None:
    phi, gamma = transition(0.001027, 12.0, 10.0)
    q, r = np.diag([1e-4, 2e-4, 3e-4, 1.0, 2.0, 3.0]), np.diag([1.0, 2.0, 3.0])
    gain = regulator(phi, gamma, q, r)
    assert gain.shape == (3, 6)

    def cost(k: np.ndarray) -> float:
        closed, total, power = phi - gamma @ k, np.zeros((6, 6)), np.eye(6)
        for _ in range(3000):
            total += power.T @ (q + k.T @ r @ k) @ power
            power = closed @ power
        return float(np.trace(total))

    least, generator = cost(gain), np.random.default_rng(0)
    for _ in range(12):
        assert cost(gain * (1.0 + 0.01 * generator.normal(size=gain.shape))) > least


@pytest.mark.parametrize(
    ("horizon", "cell", "cells"),
    [(1.0, 0.1, 4), (400.0, 0.1, 4), (500.0, 0.1, 5), (1000.0, 0.1, 10), (1000.0, 0.05, 20)],
)
def test_the_grid_of_coasting_has_cells_of_equal_angles(horizon: float, cell: float, cells: int) -> None:
    table = grid(0.001, horizon, cell)
    time = np.linspace(0.0, horizon, cells + 1)
    np.testing.assert_allclose(table, np.stack((time, np.sin(0.001 * time), np.cos(0.001 * time)), axis=1), atol=1e-15)
    assert not table.flags.writeable
    assert CELL == 0.1
    np.testing.assert_array_equal(grid(0.001, 1000.0), grid(0.001, 1000.0, 0.1))


@pytest.mark.parametrize("angle", [-0.7, 0.0, 0.3, 2.0, 5.0])
def test_positions_and_closed_motions_are_the_matrix_exponential(angle: float) -> None:
    n, generator = 0.002, np.random.default_rng(1)
    equations = np.zeros((6, 6))
    equations[:3, 3:] = np.eye(3)
    equations[3, 0], equations[3, 4], equations[4, 3], equations[5, 2] = 3.0 * n * n, 2.0 * n, -2.0 * n, -n * n
    whole = expm(equations * angle / n)
    x = np.concatenate((generator.normal(size=3) * 50.0, generator.normal(size=3) * 0.1))
    found = coasting_position(n, tuple(x.tolist()), angle, np.cos(angle), np.sin(angle))
    np.testing.assert_allclose(found, (whole @ x)[:3], rtol=1e-10, atol=1e-10)
    x[4] = -2.0 * n * x[0]
    closed = closed_motion_state(n, tuple(x.tolist()), np.cos(angle), np.sin(angle))
    np.testing.assert_allclose(closed, whole @ x, rtol=1e-10, atol=1e-10)
