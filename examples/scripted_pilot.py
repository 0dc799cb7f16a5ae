"""A pilot without a network: onto an ellipse that follows the sun round the chief, and one turn of its plane.

Without thrust, a deputy can circle the chief for ever on the ellipse

    x = b cos(a),  y = -2 b sin(a),  z = c sin(a + p),  a = n t + a0,

with the mean motion n (so v_x = n y / 2 and v_y = -2 n x). The sun turns at the same rate the same way: with its angle
for a, the deputy stays on the sunlit side and sees every point as it comes into the light, within one orbit; all but
those near a pole that are in the light only while the deputy is below their horizon. So the pilot mirrors the plane of
the ellipse, z -> -z, at the first crossing of z = 0 after half an orbit.

The pilot chooses its transfer at the first step, the cheapest of a grid of flight times and ellipses, from what a
policy may know: the observation of the shipped task. Each of the three burns lasts one step.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from safe_inspect.dynamics.cwh import transition
from safe_inspect.evaluation import Flight

Array = NDArray[Any]

POSITION_SCALE, VELOCITY_SCALE = 100.0, 0.5  # of the observation: m and m/s for 1, see agent.yml
FLIGHT_STEPS = range(10, 151, 5)
RADIAL = (20.0, 25.0, 30.0)  # b [m]
CROSS_TRACK = (30.0, 40.0, 60.0)  # c [m]
PHASES = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)  # p [rad]
MIRROR_AFTER = 0.5  # orbits on the ellipse
KEEP_OUT = 14.0  # least range on the way [m]


class ScriptedPilot:
    """The pilot of this module's first lines; a policy for `safe_inspect.evaluation.rollout`."""

    def begin(self, flight: Flight) -> None:
        """Take note of the task; the plans are made at the first observation."""
        self._dt, self._n, self._mass = flight.step_size, flight.mean_motion, float(flight.masses[0])
        self._columns = {
            sensor: [index for index, name in enumerate(flight.observation.names) if name.startswith(f"{sensor}.")]
            for sensor in ("Sensor_Position", "Sensor_Velocity", "Sensor_SunAngle")
        }
        self._limit = flight.action.high[0]
        self._maps = {
            steps: transition(self._n, self._mass, steps * self._dt) for steps in range(max(FLIGHT_STEPS) + 1)
        }
        self._stay = round(MIRROR_AFTER * 2.0 * np.pi / self._n / self._dt)
        self._mirrored: set[int] = set()
        self._step = 0

    def __call__(self, observation: NDArray[np.float32]) -> Array:
        """Return the thrust [N], shape (N, 3)."""
        told = observation.astype(np.float64)
        position = told[:, self._columns["Sensor_Position"]] * POSITION_SCALE
        velocity = told[:, self._columns["Sensor_Velocity"]] * VELOCITY_SCALE
        sun = told[:, self._columns["Sensor_SunAngle"]][:, 0]
        states = np.concatenate((position, velocity), axis=1)
        if self._step == 0:
            self._plans = [self._plan(state, angle) for state, angle in zip(states, sun, strict=True)]
        thrust = np.zeros((len(states), 3))
        for row, (first, arrival, shape) in enumerate(self._plans):
            if self._step == 0:
                thrust[row] = first
            elif self._step == arrival:
                thrust[row] = self._insertion(states[row], sun[row], shape)
            elif row not in self._mirrored and self._step >= arrival + self._stay and self._at_node(states[row]):
                thrust[row, 2] = -2.0 * self._mass * states[row, 5] / self._dt
                self._mirrored.add(row)
        self._step += 1
        return np.clip(thrust, -self._limit, self._limit)

    def _ellipse(self, angle: float, shape: tuple[float, float, float]) -> Array:
        """Return position and velocity at the angle a on the ellipse (b, c, p), shape (6,)."""
        b, c, p = shape
        x, y, z = b * np.cos(angle), -2.0 * b * np.sin(angle), c * np.sin(angle + p)
        return np.array([x, y, z, self._n * y / 2.0, -2.0 * self._n * x, self._n * c * np.cos(angle + p)])

    def _insertion(self, state: Array, angle: float, shape: tuple[float, float, float]) -> Array:
        """Return the thrust of one step after which the deputy is on a closed ellipse [N], shape (3,)."""
        phi, gamma = self._maps[1]
        closed = np.zeros((3, 3))  # velocity over position in the plane of a closed ellipse about the chief
        closed[0, 1], closed[1, 0] = self._n / 2.0, -2.0 * self._n
        cross_track = np.array([0.0, 0.0, self._ellipse(angle + self._n * self._dt, shape)[5]])
        coasting = phi @ state
        return np.linalg.solve(gamma[3:] - closed @ gamma[:3], cross_track - coasting[3:] + closed @ coasting[:3])

    def _at_node(self, state: Array) -> bool:
        """Return whether the deputy coasts through z = 0 in the coming step."""
        ahead = state[2] + state[5] * self._dt / 2.0
        return bool(abs(ahead) <= abs(state[5]) * self._dt / 2.0)

    def _plan(self, state: Array, sun: float) -> tuple[Array, int, tuple[float, float, float]]:
        """Return the first thrust [N], the step of arrival and the ellipse of the cheapest transfer."""
        best, cost = (np.zeros(3), 0, (RADIAL[0], CROSS_TRACK[0], 0.0)), np.inf
        shapes = [(b, c, p) for b in RADIAL for c in CROSS_TRACK for p in PHASES]
        phi, gamma = self._maps[1]
        for steps in FLIGHT_STEPS:
            angle = float(sun + self._n * steps * self._dt)
            goals = np.array([self._ellipse(angle, shape) for shape in shapes])
            later = self._maps[steps - 1][0]
            # The first burn holds over one step, then the deputy coasts to the goal.
            lead = later @ gamma
            thrust = np.linalg.solve(lead[:3], (goals - later @ phi @ state)[:, :3].T).T
            arrival = later @ phi @ state + thrust @ lead.T
            spent = np.abs(thrust).sum(axis=1) * self._dt / self._mass + np.abs(goals - arrival)[:, 3:].sum(axis=1)
            spent[np.abs(thrust).max(axis=1) > self._limit] = np.inf
            for index in np.argsort(spent):
                if spent[index] >= cost:
                    break
                after = phi @ state + gamma @ thrust[index]
                way = np.array([self._maps[k][0][:3] @ after for k in range(0, steps, 2)])
                if np.sqrt(np.square(way).sum(axis=1)).min() > KEEP_OUT:
                    best, cost = (thrust[index], steps, shapes[index]), spent[index]
                    break
        return best
