"""`BoundedDisturbance`: disturbs deputies, their thrusters and their state estimates within bounds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

from safe_inspect.compiling import njit
from safe_inspect.dynamics.base import DisturbanceBounds, MotionLimits
from safe_inspect.random.splitmix import draw_in_ball, uniform_at
from safe_inspect.simulators import Component, OwnOfView, RunningComponent, State, World
from safe_inspect.types import AnyArray, ArraySpec, BoolArray, FloatArray, IntArray


class BoundedDisturbance(DisturbanceBounds, Component):
    """Disturbance that is sampled at every step, for use as the `disturbance` of a simulator.

    The velocity is added at the end of a step. Thrusts are applied with their error; infos, rewards and the state's
    ``control`` contain the commanded thrusts. Sensors of the deputy's own position and velocity, and safety filters,
    read the estimates. Rewards, done functions, metrics and scripted policies read the real state, unless they read a
    sensor. Samples are functions of the seed, the slot, the episode and the step.

    Arrays, if there is an estimation error: ``estimated_position`` [m] and ``estimated_velocity`` [m/s], Hill frame,
    shape (N, D, 3).

    Attributes:
        distribution: ``uniform`` within the bounds: velocities and estimation errors in balls, the thrust's gain and
            angle in intervals. ``extreme``: each on its bound, in a random direction.
    """

    distribution: Literal["uniform", "extreme"] = "uniform"

    @property
    def estimates(self) -> bool:
        """Whether estimated states have errors."""
        return bool(self.position_error or self.velocity_error)

    def disturbance_bounds(self, limits: MotionLimits) -> DisturbanceBounds:
        """Return the fields of this plugin."""
        return self

    def __call__(self, world: World, num_envs: int) -> RunningComponent:
        """Return the running disturbance."""
        return _Disturbed(self, world.num_deputies)


class _Disturbed(RunningComponent):
    def __init__(self, plugin: BoundedDisturbance, deputies: int) -> None:
        self._plugin, self._deputies = plugin, deputies
        self._extreme = plugin.distribution == "extreme"
        self._errors = (plugin.position_error, plugin.velocity_error)
        if plugin.estimates:
            self.arrays = {name: ArraySpec((deputies, 3)) for name in ("estimated_position", "estimated_velocity")}
            self.offered = dict.fromkeys(self.arrays, OwnOfView)

    def reset(self, state: State, values: Mapping[str, Any]) -> None:
        if self.arrays:
            truth = state["position"][:, : self._deputies], state["velocity"][:, : self._deputies]
            estimates = state["estimated_position"], state["estimated_velocity"]
            write_estimates(state["key"], state["step"], self._errors, self._extreme, truth, estimates)

    def actuate(self, state: State, control: FloatArray) -> FloatArray:
        plugin = self._plugin
        if plugin.thrust_gain or plugin.thrust_direction:
            control, bounds = control.copy(), (plugin.thrust_gain, plugin.thrust_direction)
            turn_thrust(state["key"], state["step"], *bounds, self._extreme, control)
        return control

    def step(self, state: State, running: BoolArray) -> None:
        if self._plugin.velocity:
            velocity = state["velocity"][:, : self._deputies]
            add_velocity(state["key"], state["step"], self._plugin.velocity, self._extreme, velocity)
        self.reset(state, {})


#: Indices of the samples of one deputy.
_DRAWS = 4
_VELOCITY, _POSITION_ERROR, _VELOCITY_ERROR, _THRUST = range(_DRAWS)


@njit
def add_velocity(key: AnyArray, step: IntArray, bound: float, extreme: bool, velocity: FloatArray) -> None:
    """Add a random velocity within a bound [m/s] to the velocity of each deputy, shape (N, D, 3)."""
    for i in range(velocity.shape[0]):
        for j in range(velocity.shape[1]):
            w = draw_in_ball(key[i], step[i], _DRAWS * j + _VELOCITY, bound, extreme)
            for axis in range(3):
                velocity[i, j, axis] += w[axis]


@njit
def write_estimates(
    key: AnyArray, step: IntArray, bounds: tuple[float, float], extreme: bool,
    truth: tuple[FloatArray, FloatArray], estimates: tuple[FloatArray, FloatArray],
) -> None:  # fmt: skip
    """Write estimates of positions and velocities, shape (N, D, 3) each, with errors within two bounds [m], [m/s]."""
    for i in range(key.shape[0]):
        for j in range(truth[0].shape[1]):
            e = draw_in_ball(key[i], step[i], _DRAWS * j + _POSITION_ERROR, bounds[0], extreme)
            f = draw_in_ball(key[i], step[i], _DRAWS * j + _VELOCITY_ERROR, bounds[1], extreme)
            for axis in range(3):
                estimates[0][i, j, axis] = truth[0][i, j, axis] + e[axis]
                estimates[1][i, j, axis] = truth[1][i, j, axis] + f[axis]


@njit
def turn_thrust(
    key: AnyArray, step: IntArray, gain: float, direction: float, extreme: bool, control: FloatArray
) -> None:  # fmt: skip
    """Change the size and the direction of each deputy's thrust, the first three elements of its control.

    Args:
        key: Key of each episode, shape (N,).
        step: Steps since the reset, shape (N,).
        gain: Bound of the relative error of the size.
        direction: Bound of the angle [rad].
        extreme: Whether the errors are on their bounds; otherwise they are uniform within them.
        control: Controls, shape (N, D, C), written in place.
    """
    for i in range(control.shape[0]):
        for j in range(control.shape[1]):
            x, y, z = control[i, j, 0], control[i, j, 1], control[i, j, 2]
            size = math.sqrt(x * x + y * y + z * z)
            if not size > 0.0:
                continue
            pick = 4 * (_DRAWS * j + _THRUST)
            share = 2.0 * uniform_at(key[i], step[i], pick) - 1.0
            angle = direction
            if extreme:
                share = -1.0 if share < 0.0 else 1.0
            else:
                angle *= uniform_at(key[i], step[i], pick + 1)
            around = 2.0 * math.pi * uniform_at(key[i], step[i], pick + 2)
            x, y, z = x / size, y / size, z / size
            # Two directions perpendicular to the thrust: one perpendicular also to the axis that is farthest from the
            # thrust, and their cross product.
            if abs(x) <= min(abs(y), abs(z)):
                ax, ay, az = 0.0, z, -y
            elif abs(y) <= abs(z):
                ax, ay, az = -z, 0.0, x
            else:
                ax, ay, az = y, -x, 0.0
            length = math.sqrt(ax * ax + ay * ay + az * az)
            ax, ay, az = ax / length, ay / length, az / length
            bx, by, bz = y * az - z * ay, z * ax - x * az, x * ay - y * ax
            flown = size * (1.0 + gain * share)
            along, across = flown * math.cos(angle), flown * math.sin(angle)
            p, q = across * math.cos(around), across * math.sin(around)
            control[i, j, 0] = along * x + p * ax + q * bx
            control[i, j, 1] = along * y + p * ay + q * by
            control[i, j, 2] = along * z + p * az + q * bz
