"""`KalmanFilter`: estimates of the deputies' states from noisy measurements of their positions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from pydantic import Field

from safe_inspect.compiling import njit
from safe_inspect.dynamics.cwh import transition
from safe_inspect.errors import ArgumentError
from safe_inspect.random.splitmix import normal_at
from safe_inspect.simulators import Component, OwnOfView, RunningComponent, State, World
from safe_inspect.types import AnyArray, ArraySpec, BoolArray, FloatArray, IntArray
from safe_inspect.units import PositiveLength, PositiveSpeed

#: Number of the first sample of a deputy; other components use those below 3,000.
_FIRST_DRAW = 3_000
_POSITION, _VELOCITY = "estimated_position", "estimated_velocity"


class KalmanFilter(Component):
    """Kalman filter of each deputy's position and velocity, for a `disturbance` of a simulator.

    At every step the position is measured with white Gaussian noise. The filter predicts by the Clohessy-Wiltshire
    equations under the commanded thrust, with white noise of the acceleration as the only error. Sensors of the
    deputy's own position and velocity, and safety filters, read the estimates; rewards, done functions and metrics read
    the real state. The errors have no bound: safety filters are rejected, or guarantee nothing with
    `undeclared: warn`. Samples are functions of the seed, the slot, the episode and the step.

    Arrays: ``estimated_position`` [m] and ``estimated_velocity`` [m/s], Hill frame, shape (N, D, 3).

    Source:
        Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, section 5.2.3;
        section 6.3.2 for the noise of the acceleration.

    Attributes:
        measurement: Standard deviation of each element of a measured position [m].
        acceleration: Standard deviation of the change of velocity by the noise of the acceleration in a second
            [m/s^1.5].
        initial_position: Standard deviation of each element of the first estimate's position [m].
        initial_velocity: Standard deviation of each element of the first estimate's velocity [m/s].
    """

    measurement: PositiveLength = 0.1
    acceleration: float = Field(default=1e-4, gt=0.0, allow_inf_nan=False)
    initial_position: PositiveLength = 1.0
    initial_velocity: PositiveSpeed = 0.01

    @property
    def estimates(self) -> bool:
        """True."""
        return True

    def __call__(self, world: World, num_envs: int) -> RunningComponent:
        """Return the running filters.

        Raises:
            ArgumentError: The deputies turn.
        """
        if "turning_body" in world.offers.world:
            raise ArgumentError("KalmanFilter is for point masses, whose thrust is along Hill's axes; remove it")
        return _RunningFilter(self, world)

    def gains(self, phi: FloatArray, step_size: float) -> tuple[FloatArray, FloatArray]:
        """Return the gain of each step until it converges, and the covariances of the errors after these steps.

        Args:
            phi: Transition matrix of a step, shape (6, 6).
            step_size: Length of the step [s].

        Returns:
            Gains, shape (K, 6, 3), and covariances, shape (K + 1, 6, 6), the first one of the first estimate.
        """
        t, q, one = step_size, self.acceleration**2, np.eye(3)
        noise = q * np.block([[t**3 / 3.0 * one, t**2 / 2.0 * one], [t**2 / 2.0 * one, t * one]])
        covariance = np.diag([self.initial_position**2] * 3 + [self.initial_velocity**2] * 3)
        gains: list[FloatArray] = []
        covariances = [covariance]
        while len(gains) < 2 or not np.allclose(gains[-1], gains[-2], rtol=1e-10, atol=1e-15):
            predicted = phi @ covariance @ phi.T + noise
            gain = predicted[:, :3] @ np.linalg.inv(predicted[:3, :3] + self.measurement**2 * one)
            kept = np.eye(6) - np.hstack((gain, np.zeros((6, 3))))
            covariance = kept @ predicted @ kept.T + self.measurement**2 * gain @ gain.T
            gains.append(gain)
            covariances.append(covariance)
        return np.array(gains), np.array(covariances)


class _Maps(NamedTuple):
    """Matrices of the filter.

    Attributes:
        phi: Transition matrix of a step, shape (6, 6).
        gamma: Effect of the thrust of each deputy, shape (D, 6, 3).
        gains: Gain of each step, the last one of all later steps, shape (K, 6, 3).
        sigma: Standard deviation of a measured position [m].
    """

    phi: FloatArray
    gamma: FloatArray
    gains: FloatArray
    sigma: float


class _RunningFilter(RunningComponent):
    def __init__(self, plugin: KalmanFilter, world: World) -> None:
        self._plugin, self._deputies = plugin, world.num_deputies
        self.arrays = {name: ArraySpec((self._deputies, 3)) for name in (_POSITION, _VELOCITY)}
        self.offered = dict.fromkeys(self.arrays, OwnOfView)
        maps = [transition(world.mean_motion, mass, world.step_size) for mass in world.masses]
        phi, gamma = maps[0][0], np.array([gamma for _, gamma in maps])
        self._maps = _Maps(phi, gamma, plugin.gains(phi, world.step_size)[0], plugin.measurement)
        self._first = np.array([plugin.initial_position, plugin.initial_velocity])

    def reset(self, state: State, values: Mapping[str, Any]) -> None:
        truth = state["position"][:, : self._deputies], state["velocity"][:, : self._deputies]
        _start(state["key"], self._first, *truth, state[_POSITION], state[_VELOCITY])

    def step(self, state: State, running: BoolArray) -> None:
        truth = state["position"][:, : self._deputies]
        estimates = state[_POSITION], state[_VELOCITY]
        _filter(self._maps, state["key"], state["step"], state["control"], truth, *estimates)


@njit
def _start(
    key: AnyArray, sigma: FloatArray, position: FloatArray, velocity: FloatArray, p: FloatArray, v: FloatArray
) -> None:
    """Write the first estimates p and v of positions and velocities, shape (N, D, 3)."""
    for i in range(p.shape[0]):
        for j in range(p.shape[1]):
            for k in range(3):
                pick = _FIRST_DRAW + 9 * j + k
                p[i, j, k] = position[i, j, k] + sigma[0] * normal_at(key[i], 0, pick + 3)
                v[i, j, k] = velocity[i, j, k] + sigma[1] * normal_at(key[i], 0, pick + 6)


@njit
def _filter(
    maps: _Maps, key: AnyArray, step: IntArray, control: FloatArray, position: FloatArray, p: FloatArray, v: FloatArray
) -> None:  # fmt: skip
    """Update the estimates p and v, shape (N, D, 3).

    Args:
        maps: Matrices of the filter.
        key: Key of each episode, shape (N,).
        step: Steps since the reset, shape (N,).
        control: Commanded controls, the first three elements in N, shape (N, D, C).
        position: Real positions [m], shape (N, D, 3).
        p: Estimated positions [m].
        v: Estimated velocities [m/s].
    """
    phi, gamma, gains, sigma = maps
    x, surprise = np.empty(6), np.empty(3)
    for i in range(p.shape[0]):
        gain = gains[min(max(step[i] - 1, 0), gains.shape[0] - 1)]
        for j in range(p.shape[1]):
            for k in range(6):
                x[k] = 0.0
                for other in range(3):
                    x[k] += phi[k, other] * p[i, j, other] + phi[k, 3 + other] * v[i, j, other]
                    x[k] += gamma[j, k, other] * control[i, j, other]
            for k in range(3):
                noise = sigma * normal_at(key[i], step[i], _FIRST_DRAW + 9 * j + k)
                surprise[k] = position[i, j, k] + noise - x[k]
            for k in range(3):
                p[i, j, k], v[i, j, k] = x[k], x[3 + k]
                for other in range(3):
                    p[i, j, k] += gain[k, other] * surprise[other]
                    v[i, j, k] += gain[3 + k, other] * surprise[other]
