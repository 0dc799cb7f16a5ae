"""The chaser's true motion: actuators, translation and rotation, compiled over rows of missions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.rigid_body import rotation_row
from safe_inspect.dynamics.tide import inertial_transition
from safe_inspect.types import FloatArray


@dataclass(frozen=True)
class Actuator:
    """Errors and limits of what moves the chaser.

    Attributes:
        force: Largest force along each axis of W [N].
        torque: Largest torque about each axis of B [N m].
        scale_error: Relative error of all forces and torques.
        lag: Time constant of the response [s]; 0 follows at once.
        force_noise: Half width of the uniform error of each force, drawn anew for every command [N].
        torque_noise: The same of each torque [N m].
    """

    force: float = 0.30
    torque: float = 0.025
    scale_error: float = 0.0
    lag: float = 0.0
    force_noise: float = 0.0
    torque_noise: float = 0.0


class ChaserState(NamedTuple):
    """States of R chasers.

    Attributes:
        translation: Position [m] and velocity [m/s] in W, shape (R, 6).
        orientation: Quaternion q_WB [x, y, z, w], shape (R, 4).
        angular_velocity: In B [rad/s], shape (R, 3).
        wrench: Force in W [N] and torque in B [N m] that act, shape (R, 6).
    """

    translation: FloatArray
    orientation: FloatArray
    angular_velocity: FloatArray
    wrench: FloatArray


class _Constants(NamedTuple):
    """What the kernel needs: maps of one step, moments, scale of the wrench, response, step, mean motion."""

    phi: FloatArray
    gamma: FloatArray
    inertia: FloatArray
    gain: float
    response: float
    dt: float
    mean_motion: float


class ChaserDynamics:
    """Moves chasers: ``p'' = f / m``, on an orbit with the tide of `dynamics.tide`, and ``J w' = torque - w x J w``.

    Args:
        mass: Mass [kg].
        inertia: Principal moments along the axes of B [kg m^2], shape (3,).
        actuator: The actuators.
        step: The step [s]. Translation is exact for a held force, rotation a step of the Runge-Kutta method.
        mean_motion: Mean motion of the target's orbit [rad/s]; 0 for free space.
    """

    def __init__(
        self, mass: float, inertia: FloatArray, actuator: Actuator, step: float, mean_motion: float = 0.0
    ) -> None:
        phi, gamma = inertial_transition(mean_motion, mass, step)
        response = 1.0 if actuator.lag == 0.0 else -math.expm1(-step / actuator.lag)
        moments = np.array(inertia, dtype=np.float64)
        self._constants = _Constants(phi, gamma, moments, 1.0 + actuator.scale_error, response, step, mean_motion)
        self._largest = np.repeat([actuator.force, actuator.torque], 3)
        self._noise = np.repeat([actuator.force_noise, actuator.torque_noise], 3)

    def advance(
        self, state: ChaserState, command: FloatArray, error: FloatArray, ticks: int, time: float = 0.0
    ) -> ChaserState:
        """Return the states after each of some steps, a further axis of length `ticks` behind the rows.

        Args:
            state: The states before.
            command: Force in W [N] and torque in B [N m], held over all steps and cut at the limits, shape (R, 6).
            error: Uniform numbers in [-1, 1] that scale the noise, shape (R, 6).
            ticks: Number of steps.
            time: The time of the states [s], which counts on an orbit.
        """
        rows = len(command)
        wanted = np.clip(command, -self._largest, self._largest)
        out = ChaserState(*(np.empty((rows, ticks, width)) for width in (6, 4, 3, 6)))
        _advance(self._constants, state, wanted, error * self._noise, float(time), out)
        return out


def last(history: ChaserState) -> ChaserState:
    """Return the states at the end of a history."""
    return ChaserState(*(np.ascontiguousarray(array[:, -1]) for array in history))


@njit
def _turn(vector: FloatArray, cosine: float, sine: float, out: FloatArray) -> None:
    """Write a vector that is turned about z into `out`."""
    out[0] = cosine * vector[0] - sine * vector[1]
    out[1] = sine * vector[0] + cosine * vector[1]
    out[2] = vector[2]


@njit
def _advance(
    constants: _Constants, state: ChaserState, command: FloatArray, noise: FloatArray, time: float, out: ChaserState
) -> None:
    """Write the states after each step into `out`."""
    rows, ticks = out.translation.shape[0], out.translation.shape[1]
    phi, gamma, j = constants.phi, constants.gamma, constants.inertia
    moments = (j[0], j[1], j[2])
    x, y, z = np.empty(6), np.empty(6), np.empty(6)
    acts, held, push = np.empty(6), np.empty(6), np.empty(3)
    for row in range(rows):
        q, w = state.orientation[row], state.angular_velocity[row]
        turn = (q[0], q[1], q[2], q[3], w[0], w[1], w[2])
        for i in range(6):
            x[i] = state.translation[row, i]
            acts[i] = state.wrench[row, i]
            held[i] = constants.gain * command[row, i] + noise[row, i]
        for tick in range(ticks):
            for i in range(6):
                acts[i] += constants.response * (held[i] - acts[i])
                out.wrench[row, tick, i] = acts[i]
            angle = constants.mean_motion * (time + tick * constants.dt)
            cosine, sine = math.cos(angle), math.sin(angle)
            _turn(x[:3], cosine, -sine, z[:3])
            _turn(x[3:], cosine, -sine, z[3:])
            middle = angle + 0.5 * constants.mean_motion * constants.dt  # the force does not turn in W
            _turn(acts[:3], math.cos(middle), -math.sin(middle), push)
            for i in range(6):
                total = 0.0
                for k in range(6):
                    total += phi[i, k] * z[k]
                for k in range(3):
                    total += gamma[i, k] * push[k]
                y[i] = total
            _turn(y[:3], cosine, sine, x[:3])
            _turn(y[3:], cosine, sine, x[3:])
            for i in range(6):
                out.translation[row, tick, i] = x[i]
            turn = rotation_row(moments, turn, (acts[3], acts[4], acts[5]), constants.dt)
            for i in range(4):
                out.orientation[row, tick, i] = turn[i]
            for i in range(3):
                out.angular_velocity[row, tick, i] = turn[4 + i]
