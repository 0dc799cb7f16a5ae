"""The CWH map against exact arithmetic, an integrator, closed forms and invariants."""

from __future__ import annotations

import math
from decimal import Decimal, localcontext

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from safe_inspect.dynamics.cwh import transition

from ..reference.hill import system_matrices

N = 0.001027
MASS = 12.0
PERIOD = 2.0 * math.pi / N

# Where a case takes one, a state of a real episode's size: tens of metres, tenths of a metre a second.
STATE = np.array([60.0, -35.0, 20.0, 0.11, -0.07, 0.05])
THRUST = np.array([0.8, -1.0, 0.3])

motions = st.floats(1e-5, 0.1)
steps = st.floats(-600.0, 600.0)


def taylor(n: float, mass: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Sum the exponential's Taylor series in 60 digits."""
    with localcontext() as context:
        context.prec = 60
        a = [[Decimal(0)] * 9 for _ in range(9)]
        nd, t, m = Decimal(n), Decimal(step), Decimal(mass)
        for i in range(3):
            a[i][3 + i] = t
            a[3 + i][6 + i] = t / m
        a[3][0], a[3][4], a[4][3], a[5][2] = 3 * nd * nd * t, 2 * nd * t, -2 * nd * t, -nd * nd * t
        total = [[Decimal(int(i == j)) for j in range(9)] for i in range(9)]
        term = [row[:] for row in total]
        for order in range(1, 60):
            term = [
                [sum((term[i][k] * a[k][j] for k in range(9)), Decimal(0)) / order for j in range(9)] for i in range(9)
            ]
            total = [[total[i][j] + term[i][j] for j in range(9)] for i in range(9)]
        result = np.array([[float(value) for value in row] for row in total])
    return result[:6, :6], result[:6, 6:]


def test_matrices_give_hills_accelerations() -> None:
    a, b = system_matrices(N, MASS)
    x, _, z, vx, vy, vz = STATE
    rate = a @ STATE + b @ THRUST
    expected = [
        vx,
        vy,
        vz,
        3 * N**2 * x + 2 * N * vy + THRUST[0] / MASS,
        -2 * N * vx + THRUST[1] / MASS,
        -(N**2) * z + THRUST[2] / MASS,
    ]
    np.testing.assert_allclose(rate, expected, rtol=1e-15)


@pytest.mark.parametrize("step", [1e-3, 1.0, 10.0, 60.0, 900.0, -10.0])
def test_every_entry_is_right_to_its_last_digits(step: float) -> None:
    phi, gamma = transition(N, MASS, step)
    exact_phi, exact_gamma = taylor(N, MASS, step)
    np.testing.assert_allclose(phi, exact_phi, rtol=2e-15, atol=0.0)
    np.testing.assert_allclose(gamma, exact_gamma, rtol=2e-15, atol=0.0)


@given(n=motions, step=steps, mass=st.floats(0.5, 500.0))
@settings(max_examples=30, deadline=None)
def test_agrees_with_the_matrix_exponential(n: float, step: float, mass: float) -> None:
    a, b = system_matrices(n, mass)
    both = np.zeros((9, 9))
    both[:6, :6], both[:6, 6:] = a * step, b * step
    whole = expm(both)
    phi, gamma = transition(n, mass, step)
    scale = np.abs(whole).max()
    np.testing.assert_allclose(phi, whole[:6, :6], rtol=1e-10, atol=1e-12 * scale)
    np.testing.assert_allclose(gamma, whole[:6, 6:], rtol=1e-10, atol=1e-12 * scale)


@pytest.mark.parametrize("step", [10.0, 600.0, PERIOD])
def test_agrees_with_an_integrator(step: float) -> None:
    a, b = system_matrices(N, MASS)
    run = solve_ivp(lambda _, y: a @ y + b @ THRUST, (0.0, step), STATE, method="DOP853", rtol=3e-14, atol=1e-12)
    phi, gamma = transition(N, MASS, step)
    np.testing.assert_allclose(phi @ STATE + gamma @ THRUST, run.y[:, -1], rtol=1e-10, atol=1e-10)


@given(first=steps, second=steps, n=motions)
@settings(max_examples=50, deadline=None)
def test_two_steps_are_one(first: float, second: float, n: float) -> None:
    phi_a, gamma_a = transition(n, MASS, first)
    phi_b, gamma_b = transition(n, MASS, second)
    phi, gamma = transition(n, MASS, first + second)
    size = 1.0 + abs(first) + abs(second)
    np.testing.assert_allclose(phi_b @ phi_a, phi, rtol=1e-9, atol=1e-11 * size)
    np.testing.assert_allclose(phi_b @ gamma_a + gamma_b, gamma, rtol=1e-9, atol=1e-11 * size * size)


def test_no_step_changes_nothing() -> None:
    phi, gamma = transition(N, MASS, 0.0)
    assert np.array_equal(phi, np.eye(6))
    assert not gamma.any()


def test_free_space_is_a_double_integrator() -> None:
    phi, gamma = transition(0.0, MASS, 10.0)
    eye = np.eye(3)
    assert np.array_equal(phi, np.block([[eye, 10.0 * eye], [np.zeros((3, 3)), eye]]))
    np.testing.assert_allclose(gamma, np.vstack([50.0 * eye, 10.0 * eye]) / MASS, rtol=1e-15)


@given(fraction=st.floats(0.0, 3.0), size=st.floats(1.0, 500.0), phase=st.floats(0.0, 2.0 * math.pi))
@settings(max_examples=50, deadline=None)
def test_natural_motion_ellipse(fraction: float, size: float, phase: float) -> None:
    # x = b sin(nt + f), y = 2 b cos(nt + f) is the closed orbit without drift: an ellipse with the axes 1 : 2.
    start = [size * math.sin(phase), 2 * size * math.cos(phase), 0.0]
    start += [size * N * math.cos(phase), -2 * size * N * math.sin(phase), 0.0]
    phi, _ = transition(N, MASS, fraction * PERIOD)
    x, y, z = (phi @ np.array(start))[:3]
    angle = phase + fraction * 2.0 * math.pi
    np.testing.assert_allclose([x, y, z], [size * math.sin(angle), 2 * size * math.cos(angle), 0.0], atol=1e-11 * size)
    assert (x / size) ** 2 + (y / (2 * size)) ** 2 == pytest.approx(1.0, abs=1e-11)


def test_an_orbit_drifts_along_track_only() -> None:
    # After a whole period only y has moved, by -6 pi (2 x + y'/n) of the starting state.
    phi, _ = transition(N, MASS, PERIOD)
    moved = phi @ STATE - STATE
    expected = np.zeros(6)
    expected[1] = -6.0 * math.pi * (2.0 * STATE[0] + STATE[4] / N)
    np.testing.assert_allclose(moved, expected, atol=1e-9)


def energy(state: np.ndarray) -> float:
    return float(0.5 * (state[3:] ** 2).sum() - 1.5 * N**2 * state[0] ** 2 + 0.5 * N**2 * state[2] ** 2)


@given(st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6), steps)
@settings(max_examples=50, deadline=None)
def test_coasting_conserves_energy_and_drift(values: list[float], step: float) -> None:
    state = np.array(values) * np.array([100.0, 100.0, 100.0, 0.5, 0.5, 0.5])
    after = transition(N, MASS, step)[0] @ state
    assert energy(after) == pytest.approx(energy(state), rel=1e-10, abs=1e-14)
    assert after[4] + 2 * N * after[0] == pytest.approx(state[4] + 2 * N * state[0], rel=1e-11, abs=1e-13)


@given(step=steps, n=motions)
@settings(max_examples=30, deadline=None)
def test_phase_volume_is_kept(step: float, n: float) -> None:
    assert np.linalg.det(transition(n, MASS, step)[0]) == pytest.approx(1.0, abs=1e-6)
