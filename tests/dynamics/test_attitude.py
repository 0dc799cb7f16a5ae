"""`ClohessyWiltshireAttitude` against an independent integrator, and what it must keep."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from safe_inspect.dynamics import ClohessyWiltshire, ClohessyWiltshireAttitude
from safe_inspect.dynamics.base import advance_kernel
from safe_inspect.dynamics.cwh import propagate
from safe_inspect.dynamics.quaternion import conjugate, log, multiply, rotate

STEP, MASS, N, LIMIT = 10.0, 12.0, 0.001027, 0.034907
ASYMMETRIC = (0.02, 0.05, 0.06)
FREE = {"rate_limit": None, "acceleration_limit": None}


def advanced(states, control, dynamics, steps=1):
    """Return position, velocity, attitude and angular velocity of rows after some holds of a control."""
    p, v, q, w = (np.ascontiguousarray(array[:, None].copy()) for array in states)
    rows = len(p)
    spent, time, step = np.zeros((rows, 1)), np.zeros(rows), np.zeros(rows, dtype=np.int64)
    arguments = dynamics(STEP), (p, v, q, w), control[:, None].copy(), np.full(1, MASS)
    parameters, arrays, held, masses = arguments
    advance_kernel(dynamics, STEP)(*parameters, *arrays, held, masses, STEP, steps, spent, time, step)
    return p[:, 0], v[:, 0], q[:, 0], w[:, 0], spent[:, 0]


def drawn(rows, seed=0, rate=0.03):
    generator = np.random.default_rng(seed)
    q = Rotation.random(rows, random_state=seed).as_quat()
    p, v = generator.uniform(-100, 100, (rows, 3)), generator.uniform(-0.3, 0.3, (rows, 3))
    w = generator.uniform(-rate, rate, (rows, 3))
    control = generator.uniform(-1, 1, (rows, 6)) * np.repeat([1.0, 0.001], 3)
    return (p, v, q, w), control


def reference(state, control, dynamics):
    """Integrate one row by DOP853 from event to event: an axis that reaches its limit is held there from then on."""
    inertia, n = np.array(dynamics.inertia), dynamics.mean_motion
    turn = n if dynamics.rate_against == "inertial" else 0.0
    limit = dynamics.rate_limit or np.inf
    most = dynamics.acceleration_limit or np.inf
    held = np.zeros(3)

    def rates(_, x):
        p, v, q, w = x[:3], x[3:6], x[6:10], x[10:]
        matrix = Rotation.from_quat(q).as_matrix()
        force = matrix @ control[:3] if dynamics.body_frame_thrust else control[:3]
        a = force / MASS + [3 * n * n * p[0] + 2 * n * v[1], -2 * n * v[0], -n * n * p[2]]
        relative = w - matrix.T @ [0.0, 0.0, turn]
        dw = np.clip((control[3:] - np.cross(w, inertia * w)) / inertia, -most, most)
        dw = np.where(held * dw > 0.0, 0.0, dw)
        return np.concatenate((v, a, 0.5 * multiply(q, np.append(relative, 0.0)), dw))

    def reaches(axis, sign):
        def event(_, x):
            return x[10 + axis] * sign - limit if held[axis] != sign else -1.0

        event.terminal, event.direction = True, 1.0
        return event

    x, time = np.concatenate(state), 0.0
    corners = [(axis, sign) for axis in range(3) for sign in (1, -1)] if np.isfinite(limit) else []
    while time < STEP:
        events = [reaches(*corner) for corner in corners]
        found = solve_ivp(rates, (time, STEP), x, "DOP853", rtol=1e-12, atol=1e-13, events=events or None)
        x, time = found.y[:, -1], found.t[-1]
        for corner, hits in zip(corners, found.t_events or [], strict=True):
            if len(hits):
                held[corner[0]] = corner[1]
                x[10 + corner[0]] = corner[1] * limit
    return x[:3], x[3:6], x[6:10], x[10:]


@pytest.mark.parametrize(
    "dynamics",
    [
        ClohessyWiltshireAttitude(),
        ClohessyWiltshireAttitude(rate_against="hill"),
        ClohessyWiltshireAttitude(body_frame_thrust=False),
        ClohessyWiltshireAttitude(inertia=ASYMMETRIC, acceleration_limit=None),
        ClohessyWiltshireAttitude(inertia=(0.2, 0.5, 0.6), **FREE),
    ],
    ids=["as shipped", "rate against Hill's frame", "thrust in Hill's frame", "asymmetric", "without limits"],
)
def test_a_hold_agrees_with_an_independent_integrator(dynamics):
    states, control = drawn(12)
    control[0], control[1, 3:] = 0.0, 0.0
    states[3][2] = [LIMIT, -LIMIT, 0.0]
    p, v, q, w, _ = advanced(states, control, dynamics)
    saturated = 0
    for row in range(12):
        expected = reference([array[row] for array in states], control[row], dynamics)
        assert np.abs(p[row] - expected[0]).max() < 3e-5
        assert np.abs(v[row] - expected[1]).max() < 3e-6
        assert np.linalg.norm(log(multiply(conjugate(expected[2]), q[row]))) < 2e-6
        assert np.abs(w[row] - expected[3]).max() < 1e-8
        saturated += (np.abs(w[row]) == LIMIT).any()
    assert saturated > 5 or dynamics.rate_limit is None


def test_a_body_without_torque_keeps_energy_and_momentum():
    states, control = drawn(20, rate=0.03)
    dynamics = ClohessyWiltshireAttitude(inertia=ASYMMETRIC, rate_against="hill", **FREE)
    inertia = np.array(ASYMMETRIC)
    _, _, q, w, _ = advanced(states, 0.0 * control, dynamics, steps=60)
    energy, first = ((inertia * rates**2).sum(axis=1) for rates in (w, states[3]))
    np.testing.assert_allclose(energy, first, rtol=1e-7)
    momentum = rotate(q, inertia * w) - rotate(states[2], inertia * states[3])
    assert np.abs(momentum).max() < 1e-7 * 0.0018
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, rtol=1e-14)


def test_a_symmetric_body_without_torque_turns_evenly():
    states, control = drawn(20, rate=0.03)
    _, _, q, w, _ = advanced(states, 0.0 * control, ClohessyWiltshireAttitude(), steps=30)
    np.testing.assert_allclose(w, states[3], atol=1e-16)
    turned = Rotation.from_rotvec([0.0, 0.0, -N * 300.0]) * Rotation.from_quat(states[2])
    expected = (turned * Rotation.from_rotvec(300.0 * states[3])).as_quat()
    assert np.abs(np.abs((q * expected).sum(axis=1)) - 1.0).max() < 1e-13


def test_a_body_at_rest_in_hills_frame_stays_so_and_coasts_as_a_point():
    states, control = drawn(10)
    states[2][:], states[3][:] = [0, 0, 0, 1], [0, 0, N]
    p, v, q, w, spent = advanced(states, 0.0 * control, ClohessyWiltshireAttitude(), steps=100)
    assert (q == [0, 0, 0, 1]).all()
    assert (w == [0, 0, N]).all()
    assert (spent == 0.0).all()
    phi, gamma = ClohessyWiltshire()(STEP)
    expected = [states[0].copy(), states[1].copy()]
    for _ in range(100):
        propagate(*expected, np.zeros((10, 3)), phi, gamma, *expected)
    assert (p == expected[0]).all()
    assert (v == expected[1]).all()


def test_a_step_does_the_same_for_both_signs_of_a_quaternion():
    states, control = drawn(20)
    one = advanced(states, control, ClohessyWiltshireAttitude())
    states[2][:] *= -1.0
    other = advanced(states, control, ClohessyWiltshireAttitude())
    assert (one[2] == -other[2]).all()
    for index in (0, 1, 3, 4):
        assert (one[index] == other[index]).all()


def test_rates_keep_within_their_limit_whatever_is_commanded():
    states, control = drawn(50)
    control[:, 3:] *= 100.0
    states[3][0] = 0.2  # an initial state beyond the limit is brought back to it
    dynamics = ClohessyWiltshireAttitude(inertia=ASYMMETRIC)
    _, _, _, w, spent = advanced(states, control, dynamics, steps=5)
    assert np.abs(w).max() <= LIMIT
    # At most 0.017453 rad/s^2: from rest the limit is reached after two seconds.
    states[3][:] = 0.0
    short = ClohessyWiltshireAttitude().model_copy(update={"inertia": (1e-9,) * 3})
    _, _, q, w, _ = advanced(states, np.tile([0.0, 0, 0, 1, 0, 0], (50, 1)), short)
    np.testing.assert_allclose(w[:, 0], LIMIT)
    turn = log(multiply(conjugate(states[2]), q))
    assert np.abs(np.linalg.norm(turn, axis=1) - LIMIT * (STEP - 1.0)).max() < 0.011  # Hill's frame turns meanwhile
    np.testing.assert_allclose(spent, 5 * STEP * np.abs(control[:, :3]).sum(axis=1) / MASS)


@pytest.mark.parametrize("half_turn", np.eye(3))
def test_the_limits_are_the_same_for_both_directions_of_an_axis(half_turn):
    """Turning the body's axes by half a turn about one of them changes signs only, also of rates at their limit."""
    states, control = drawn(60)
    states[3][:40] = LIMIT * np.sign(states[3][:40])  # an axis at its limit is held there, or leaves it
    states[3][:20, 0] *= 0.5
    control[:, 3:] *= 20.0
    signs = 2.0 * half_turn - 1.0
    dynamics = ClohessyWiltshireAttitude(inertia=ASYMMETRIC, body_frame_thrust=False)
    one = advanced(states, control, dynamics, steps=3)
    turned = (*states[:2], multiply(states[2], np.append(half_turn, 0.0)), states[3] * signs)
    other = advanced(turned, control * np.concatenate((np.ones(3), signs)), dynamics, steps=3)
    np.testing.assert_allclose(other[3], one[3] * signs, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(other[2], multiply(one[2], np.append(half_turn, 0.0)), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(other[0], one[0], rtol=0.0, atol=1e-9)


def test_a_row_gives_the_same_bits_in_a_batch_of_any_size():
    states, control = drawn(9)
    together = advanced(states, control, ClohessyWiltshireAttitude())
    for row in range(9):
        alone = advanced(
            [array[row : row + 1] for array in states], control[row : row + 1], ClohessyWiltshireAttitude()
        )
        for one, other in zip(together, alone, strict=True):
            assert one[row : row + 1].tobytes() == other.tobytes()
