from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from safe_inspect.dynamics.cwh import transition
from safe_inspect.dynamics.quaternion import exp
from safe_inspect.dynamics.tide import inertial_transition, largest_tide, tidal_acceleration, to_hill
from safe_inspect.rendezvous.chaser import Actuator, ChaserDynamics, ChaserState, last

_MASS = 9.583788668
_INERTIA = np.array([0.153427995, 0.14271405, 0.162302759])


def _start(rows: int = 1) -> ChaserState:
    generator = np.random.default_rng(0)
    return ChaserState(
        generator.normal(size=(rows, 6)),
        exp(generator.normal(size=(rows, 3))),
        0.1 * generator.normal(size=(rows, 3)),
        np.zeros((rows, 6)),
    )


def test_a_held_command_moves_the_chaser_exactly() -> None:
    dynamics = ChaserDynamics(_MASS, _INERTIA, Actuator(), 0.008)
    start = _start()
    command = np.array([[0.1, -0.2, 0.05, 0.01, -0.02, 0.015]])
    history = dynamics.advance(start, command, np.zeros((1, 6)), 2000)
    phi, gamma = transition(0.0, _MASS, 16.0)
    np.testing.assert_allclose(
        history.translation[0, -1], phi @ start.translation[0] + gamma @ command[0, :3], rtol=1e-12
    )

    def rates(_: float, x: np.ndarray) -> np.ndarray:
        q, w = x[:4], x[4:]
        turned = np.array(
            [
                q[3] * w[0] + q[1] * w[2] - q[2] * w[1],
                q[3] * w[1] - q[0] * w[2] + q[2] * w[0],
                q[3] * w[2] + q[0] * w[1] - q[1] * w[0],
                -q[:3] @ w,
            ]
        )
        return np.concatenate([0.5 * turned, (command[0, 3:] - np.cross(w, _INERTIA * w)) / _INERTIA])

    begin = np.concatenate([start.orientation[0], start.angular_velocity[0]])
    exact = solve_ivp(rates, (0.0, 16.0), begin, rtol=1e-12, atol=1e-13, method="DOP853").y[:, -1]
    np.testing.assert_allclose(history.orientation[0, -1], exact[:4], atol=1e-8)
    np.testing.assert_allclose(history.angular_velocity[0, -1], exact[4:], atol=1e-8)


def test_actuators_saturate_scale_lag_and_err() -> None:
    actuator = Actuator(scale_error=0.1, lag=0.1, force_noise=0.003, torque_noise=1e-4)
    dynamics = ChaserDynamics(_MASS, _INERTIA, actuator, 0.008)
    command = np.array([[5.0, -5.0, 0.1, 1.0, 0.0, -1.0]])
    error = np.array([[1.0, -1.0, 0.5, 0.0, 1.0, 0.0]])
    wrench = dynamics.advance(_start(), command, error, 500).wrench[0]
    final = 1.1 * np.array([0.3, -0.3, 0.1, 0.025, 0.0, -0.025]) + error[0] * np.repeat([0.003, 1e-4], 3)
    np.testing.assert_allclose(wrench[-1], final, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(wrench[0], final * -np.expm1(-0.08), rtol=1e-9, atol=1e-12)


def test_a_row_alone_and_in_a_batch_agree_to_the_bit() -> None:
    dynamics = ChaserDynamics(_MASS, _INERTIA, Actuator(lag=0.05), 0.008, mean_motion=1e-3)
    start, command = _start(5), np.random.default_rng(1).normal(size=(5, 6))
    together = last(dynamics.advance(start, command, np.zeros((5, 6)), 25, 700.0))
    for row in range(5):
        one = slice(row, row + 1)
        alone = last(dynamics.advance(ChaserState(*(a[one] for a in start)), command[one], np.zeros((1, 6)), 25, 700.0))
        for batch, single in zip(together, alone, strict=True):
            assert batch[one].tobytes() == single.tobytes()


@pytest.mark.parametrize("ticks", [1, 25])
def test_the_history_has_the_state_after_each_tick(ticks: int) -> None:
    dynamics = ChaserDynamics(_MASS, _INERTIA, Actuator(), 0.008)
    command = np.full((1, 6), 0.01)
    state = start = _start()
    history = dynamics.advance(start, command, np.zeros((1, 6)), ticks)
    for tick in range(ticks):
        state = last(dynamics.advance(state, command, np.zeros((1, 6)), 1))
        for one, many in zip(state, history, strict=True):
            assert one[0].tobytes() == many[0, tick].tobytes()


@pytest.mark.parametrize("began", [0.0, 1234.5])
def test_on_an_orbit_the_chaser_moves_as_in_hills_frame_and_as_gravity_pulls(began: float) -> None:
    n, mass, seconds = 1.0454e-3, 1600.0, 600.0
    dynamics = ChaserDynamics(mass, np.array([1500.0, 1500.0, 1200.0]), Actuator(force=88.0), 0.2, mean_motion=n)
    start = ChaserState(
        np.array([[5.0, -30.0, 8.0, 0.02, 0.01, -0.03]]), np.array([[0.0, 0.0, 0.0, 1.0]]), np.zeros((1, 3)),
        np.zeros((1, 6)),
    )  # fmt: skip
    coasting = dynamics.advance(start, np.zeros((1, 6)), np.zeros((1, 6)), 3000, began).translation[0, -1]
    phi, _ = transition(n, mass, seconds)
    expected = phi @ to_hill(n, began, start.translation[0])
    np.testing.assert_allclose(to_hill(n, began + seconds, coasting), expected, rtol=1e-9, atol=1e-9)

    # Two satellites about the Earth, with a constant force in inertial axes; the difference is linear up to |p| / r.
    mu = 3.986004418e14
    r = (mu / n**2) ** (1.0 / 3.0)
    force = np.array([0.1, -0.2, 0.05])

    def fall(t: float, x: np.ndarray) -> np.ndarray:
        target = r * np.array([np.cos(n * t), np.sin(n * t), 0.0])
        whole = target + x[:3]
        pull = -mu * whole / np.linalg.norm(whole) ** 3 + n**2 * target
        return np.concatenate([x[3:], pull + force / mass])

    exact = solve_ivp(fall, (began, began + seconds), start.translation[0], rtol=1e-12, atol=1e-12, method="DOP853").y[
        :, -1
    ]
    command = np.concatenate([force, np.zeros(3)])[None]
    pushed = dynamics.advance(start, command, np.zeros((1, 6)), 3000, began).translation[0, -1]
    np.testing.assert_allclose(pushed, exact, rtol=0.0, atol=3e-3)
    straight = start.translation[0, :3] + seconds * start.translation[0, 3:] + 0.5 * seconds**2 * force / mass
    assert np.linalg.norm(exact[:3] - straight) > 5.0  # what the tide makes of it is far more than the tolerance


def test_the_tide_is_the_acceleration_of_the_motion_on_an_orbit() -> None:
    n, position = 1.0454e-3, np.array([[5.0, -30.0, 8.0]])
    phi, _ = inertial_transition(n, 1.0, 1e-2)
    after = phi @ np.concatenate([position[0], np.zeros(3)])
    np.testing.assert_allclose(after[3:] / 1e-2, tidal_acceleration(n, np.zeros(1), position)[0], rtol=1e-4, atol=1e-12)
    assert np.linalg.norm(tidal_acceleration(n, np.arange(9.0), position), axis=1).max() <= largest_tide(n, 32.0)
