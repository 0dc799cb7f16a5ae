"""Attitude control in closed loop with the exact rotation of a rigid body."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from safe_inspect.geometry.pointing import R_BC
from safe_inspect.rendezvous.control.attitude import AttitudeCommand, AttitudeController, CameraPointing

INERTIA = np.array([0.153427995, 0.14271405, 0.162302759])
REST = np.zeros(3)
IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])
PERIOD = 0.2


def turn(q: np.ndarray, w: np.ndarray, torque: np.ndarray, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Return attitude and angular velocity after a torque that is held."""

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        (x, yy, z, s), omega = y[:4], y[4:]
        a, b, c = omega
        dq = 0.5 * np.array(
            [s * a + yy * c - z * b, s * b - x * c + z * a, s * c + x * b - yy * a, -x * a - yy * b - z * c]
        )
        return np.concatenate((dq, (torque - np.cross(omega, INERTIA * omega)) / INERTIA))

    y = solve_ivp(rate, (0.0, seconds), np.concatenate((q, w)), rtol=1e-9, atol=1e-11).y[:, -1]
    return y[:4] / np.linalg.norm(y[:4]), y[4:]


def angle(a: np.ndarray, b: np.ndarray) -> float:
    """Return the angle between two attitudes [degrees]."""
    return float(np.rad2deg((Rotation.from_quat(a).inv() * Rotation.from_quat(b)).magnitude()))


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.3, -0.9, 0.2), (0.5, 0.6, 0.7)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_sixty_degrees_are_corrected_in_seven_seconds(axis, sign):
    start = sign * Rotation.from_rotvec(np.deg2rad(60.0) * np.array(axis) / np.linalg.norm(axis)).as_quat()
    controller, command = AttitudeController(INERTIA), AttitudeCommand(IDENTITY, REST)
    q, w, largest = start, REST, 0.0
    for _ in range(35):
        torque = controller(q, w, command)
        assert np.abs(torque).max() <= 0.025
        q, w = turn(q, w, torque, PERIOD)
        largest = max(largest, angle(q, IDENTITY))
    assert angle(q, IDENTITY) < 1.0
    assert largest <= 60.0  # the short way round


def test_both_signs_of_a_quaternion_give_the_same_torque():
    generator = np.random.default_rng(0)
    q = Rotation.random(50, random_state=1).as_quat()
    w = generator.normal(scale=0.1, size=(50, 3))
    controller = AttitudeController(INERTIA, torque=1.0)
    command = AttitudeCommand(Rotation.random(random_state=2).as_quat(), np.array([0.02, -0.01, 0.03]))
    np.testing.assert_array_equal(controller(q, w, command), controller(-q, w, command))
    opposite = AttitudeCommand(-command.orientation, command.angular_velocity)
    np.testing.assert_allclose(controller(q, w, command), controller(q, w, opposite), atol=1e-15)


def test_at_the_command_only_the_gyroscopic_torque_is_left():
    q, w = Rotation.random(random_state=3).as_quat(), np.array([0.1, -0.05, 0.08])
    torque = AttitudeController(INERTIA)(q, w, AttitudeCommand(q, w))
    np.testing.assert_allclose(torque, np.cross(w, INERTIA * w), atol=1e-15)


def test_a_moving_target_is_followed():
    """A chaser that flies a quarter circle about a point in 30 s keeps its camera on it."""
    pointing = CameraPointing(IDENTITY)
    controller = AttitudeController(INERTIA)
    q, w = IDENTITY, REST
    worst = 0.0
    for k in range(200):
        phase = 0.25 * np.pi * (1.0 - np.cos(np.pi * min(k * PERIOD, 30.0) / 30.0))
        position = 1.5 * np.array([-np.cos(phase), -np.sin(phase), 0.0])
        command = pointing.step(position, np.zeros(3), PERIOD)
        forward = Rotation.from_quat(command.orientation).as_matrix() @ R_BC[:, 2]
        np.testing.assert_allclose(forward, -position / 1.5, atol=1e-12)
        q, w = turn(q, w, controller(q, w, command), PERIOD)
        if k > 25:
            worst = max(worst, angle(q, command.orientation))
    assert worst < 1.5  # the command of a step is compared with the attitude at its end: 0.2 s x 4.5 deg/s at most
    assert angle(q, command.orientation) < 0.03


def test_commanded_rates_are_limited():
    pointing = CameraPointing(IDENTITY, largest_rate=0.1, largest_acceleration=0.05)
    assert not pointing.step(np.array([-1.0, 0.0, 0.0]), REST, PERIOD).angular_velocity.any()
    last = REST
    for k in range(40):
        command = pointing.step(np.array([-np.cos(0.2 * k), np.sin(0.2 * k), 0.0]), REST, PERIOD)
        assert np.linalg.norm(command.angular_velocity) <= 0.1 + 1e-12
        assert np.linalg.norm(command.angular_velocity - last) <= 0.05 * PERIOD + 1e-12
        last = command.angular_velocity
    assert np.linalg.norm(last) > 0.09


def test_commanded_attitudes_do_not_jump_in_sign():
    pointing = CameraPointing(IDENTITY)
    last = IDENTITY
    for phase in np.linspace(0.0, 4.0 * np.pi, 400):
        command = pointing.step(np.array([-np.cos(phase), np.sin(phase), 0.0]), REST, PERIOD)
        assert command.orientation @ last > 0.9
        last = command.orientation
