"""`ThrusterModel`, six thrusters that round, err, fail and use propellant, and `Actuators`, thrusters and wheels."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from pydantic import Field

from safe_inspect.compiling import njit
from safe_inspect.dynamics.base import DisturbanceBounds, MotionLimits
from safe_inspect.errors import ArgumentError
from safe_inspect.random.splitmix import uniform_at
from safe_inspect.simulators import Component, OfView, RunningComponent, State, World
from safe_inspect.types import AnyArray, ArraySpec, BoolArray, FloatArray, IntArray
from safe_inspect.units import (
    NonNegativeDuration,
    NonNegativeForce,
    NonNegativeImpulse,
    NonNegativeMass,
    NonNegativeTorque,
    PositiveDuration,
    PositiveForce,
    PositiveTorque,
    SmallAngle,
)

#: Numbers of the samples of a deputy, for an episode; other components use those below 2,000.
_FIRST_DRAW, _DRAWS = 2_000, 32
_FAILS, _FAILED, _FAILS_AT = 18, 19, 20
#: Standard gravity [m/s^2], which relates specific impulse and exhaust speed.
_STANDARD_GRAVITY = 9.80665
_PROPELLANT = "propellant"


class _Rule(NamedTuple):
    """Constants of the kernel: the fields of `ThrusterModel`, and the length of a step [s]."""

    minimum: float
    resolution: float
    gain: float
    tilt: float
    failure: float
    failure_time: float
    exhaust_speed: float
    propellant: float
    step_size: float


class ThrusterModel(Component):
    """Six thrusters, one for each direction along the axes of the control, for a `disturbance` of a simulator.

    A thruster fires once in a step; its impulse is that of the commanded thrust, rounded first to the resolution of the
    pulses, then to the smallest pulse or none. Its thrust is constant during the step. Gain and direction of each
    thruster are constant in an episode. With propellant, the mass falls as it is used: a thrust F accelerates the
    deputy by ``F / (m - used)``, and there is no thrust once it is used up. Infos, rewards and the state's ``control``
    contain the commanded thrust. Samples are functions of the seed, the slot and the episode.

    The loss of a thrust has no bound: with failures or propellant, safety filters are rejected, or guarantee nothing
    with `undeclared: warn`.

    Array, with `propellant`: ``propellant``, the remaining propellant [kg], shape (N, D).

    Attributes:
        minimum_impulse: Impulse of the shortest pulse [N s].
        impulse_resolution: Difference between two possible impulses, as of on-off thrusters [N s]; 0 for any impulse.
        gain_error: Largest relative error of a thruster's thrust [-]; uniform within it.
        misalignment: Largest angle between a thruster and its axis [rad]; uniform within it.
        failure_probability: Probability that one of the six, drawn at random, fails in an episode: it then stays off.
        failure_time: The failure occurs at a time that is uniform between the reset and this [s].
        propellant: Propellant at the reset, a part of the deputy's mass [kg]; 0: the mass is constant.
        specific_impulse: Specific impulse [s].
    """

    minimum_impulse: NonNegativeImpulse = 0.0  # type: ignore[valid-type]
    impulse_resolution: NonNegativeImpulse = 0.0  # type: ignore[valid-type]
    gain_error: float = Field(default=0.0, ge=0.0, lt=1.0)
    misalignment: SmallAngle = 0.0
    failure_probability: float = Field(default=0.0, ge=0.0, le=1.0)
    failure_time: NonNegativeDuration = 0.0
    propellant: NonNegativeMass = 0.0  # type: ignore[valid-type]
    specific_impulse: PositiveDuration = 220.0

    def disturbance_bounds(self, limits: MotionLimits) -> DisturbanceBounds:
        """Return bounds of the velocity by which pulses are rounded, and of the error of the thrust.

        Raises:
            ValueError: A thruster may fail or run out of propellant, or the error may exceed the thrust.
        """
        if self.failure_probability > 0.0 or self.propellant > 0.0:
            raise ValueError("the error of thrusters that may fail or run out of propellant has no bound")
        step, least = self.impulse_resolution, self.minimum_impulse
        rounding = 0.5 * (step + (least if least > step else 0.0))
        # |F' - F| / |F|: the gain, and the chord of the tilt of each of the three thrusters that fire.
        error = self.gain_error + (1.0 + self.gain_error) * 2.0 * math.sqrt(3.0) * math.sin(0.5 * self.misalignment)
        if not error < 1.0:
            raise ValueError("the error of the thrust may exceed the thrust")
        flown = (1.0 + error) * math.sqrt(3.0) * rounding / limits.mass
        return DisturbanceBounds(velocity=flown, thrust_gain=error, thrust_direction=math.asin(error))

    def __call__(self, world: World, num_envs: int) -> RunningComponent:
        """Return the running thrusters.

        Raises:
            ArgumentError: The propellant is not less than the mass of a deputy.
        """
        if not np.all(world.masses > self.propellant):
            raise ArgumentError(
                f"`propellant` is {self.propellant:g} kg, which must be less than the deputy's mass of "
                f"{world.masses.min():g} kg; it is a part of this mass"
            )
        return _RunningThrusters(self, world)


class _RunningThrusters(RunningComponent):
    def __init__(self, plugin: ThrusterModel, world: World) -> None:
        self._masses = world.masses
        self._rule = _Rule(
            plugin.minimum_impulse, plugin.impulse_resolution, plugin.gain_error, plugin.misalignment,
            plugin.failure_probability, plugin.failure_time, plugin.specific_impulse * _STANDARD_GRAVITY,
            plugin.propellant, world.step_size,
        )  # fmt: skip
        self._used: FloatArray = np.zeros((0, len(world.masses)))
        if plugin.propellant > 0.0:
            self.arrays = {_PROPELLANT: ArraySpec((len(world.masses),))}
            self.recorded = (_PROPELLANT,)
            self.offered = {_PROPELLANT: OfView}

    def reset(self, state: State, values: Mapping[str, Any]) -> None:
        if self.arrays:
            state[_PROPELLANT][:] = self._rule.propellant

    def actuate(self, state: State, control: FloatArray) -> FloatArray:
        flown, used = control.copy(), np.zeros(control.shape[:2])
        left = state[_PROPELLANT] if self.arrays else used
        _fire(self._rule, state["key"], state["step"], state["time"], self._masses, left, flown, used)
        self._used = used
        return flown

    def step(self, state: State, running: BoolArray) -> None:
        if self.arrays:
            state.arrays[_PROPELLANT][...] -= self._used


@njit
def _rounded(rule: _Rule, impulse: float) -> float:
    """Return the impulse of a pulse [N s], for a commanded impulse."""
    if rule.resolution > 0.0:
        impulse = rule.resolution * math.floor(impulse / rule.resolution + 0.5)
    if impulse < rule.minimum:
        impulse = rule.minimum if 2.0 * impulse >= rule.minimum else 0.0
    return impulse


@njit
def _fire(
    rule: _Rule, key: AnyArray, step: IntArray, time: FloatArray, masses: FloatArray, left: FloatArray,
    control: FloatArray, used: FloatArray,
) -> None:  # fmt: skip
    """Write the thrust that a deputy of constant mass would need for the same acceleration, and the used propellant.

    Args:
        rule: The constants.
        key: Key of each episode, shape (N,).
        step: Steps since the reset, shape (N,).
        time: Time since the reset [s], shape (N,).
        masses: Mass of each deputy at the reset [kg], shape (D,).
        left: Remaining propellant [kg], shape (N, D).
        control: Controls, the first three elements in N, shape (N, D, C); overwritten.
        used: Output: propellant that is used in the step [kg], shape (N, D).
    """
    for i in range(control.shape[0]):
        for j in range(control.shape[1]):
            first = _FIRST_DRAW + _DRAWS * j
            failed = -1
            fails = uniform_at(key[i], 0, first + _FAILS) < rule.failure
            if fails and time[i] >= rule.failure_time * uniform_at(key[i], 0, first + _FAILS_AT):
                failed = int(6.0 * uniform_at(key[i], 0, first + _FAILED))
            x, total = np.zeros(3), 0.0
            for axis in range(3):
                thrust = _rounded(rule, abs(control[i, j, axis]) * rule.step_size) / rule.step_size
                sign = -1.0 if control[i, j, axis] < 0.0 else 1.0
                thruster = 2 * axis + (1 if sign < 0.0 else 0)
                if thruster == failed or thrust == 0.0:
                    continue
                pick = first + 3 * thruster
                thrust *= 1.0 + rule.gain * (2.0 * uniform_at(key[i], 0, pick) - 1.0)
                tilt = rule.tilt * uniform_at(key[i], 0, pick + 1)
                around = 2.0 * math.pi * uniform_at(key[i], 0, pick + 2)
                x[axis] += sign * thrust * math.cos(tilt)
                x[(axis + 1) % 3] += thrust * math.sin(tilt) * math.cos(around)
                x[(axis + 2) % 3] += thrust * math.sin(tilt) * math.sin(around)
                total += thrust
            share, mass = 1.0, masses[j]
            if rule.propellant > 0.0:
                mass -= rule.propellant - left[i, j]
                used[i, j] = total * rule.step_size / rule.exhaust_speed
                if used[i, j] > left[i, j]:
                    share, used[i, j] = left[i, j] / used[i, j], left[i, j]
            for axis in range(3):
                control[i, j, axis] = share * x[axis] * masses[j] / mass


#: Number of the first sample of a deputy; other components use those from 0.
_FIRST_NOISE = 1_000


class Actuators(Component):
    """Limits and errors of a control of forces and torques: ``(1 + scale_error) clip(u) + noise`` is applied.

    The noise is uniform and sampled at every step of the agents. The state's ``control`` is the commanded one.

    Attributes:
        force: Largest force along each axis [N].
        torque: Largest torque about each axis [N m].
        scale_error: Relative error of all forces and torques.
        force_noise: Half width of the uniform error of a force [N].
        torque_noise: Half width of the uniform error of a torque [N m].
    """

    force: PositiveForce = 0.30
    torque: PositiveTorque = 0.025
    scale_error: float = Field(default=0.0, gt=-1.0, lt=1.0)
    force_noise: NonNegativeForce = 0.0
    torque_noise: NonNegativeTorque = 0.0

    def __call__(self, world: World, num_envs: int) -> RunningComponent:
        """Return the running actuators."""
        return _RunningActuators(self)


class _RunningActuators(RunningComponent):
    def __init__(self, plugin: Actuators) -> None:
        self._gain = 1.0 + plugin.scale_error
        self._limits, self._noise = (plugin.force, plugin.torque), (plugin.force_noise, plugin.torque_noise)

    def actuate(self, state: State, control: FloatArray) -> FloatArray:
        flown = control.copy()
        _actuate(state["key"], state["step"], self._gain, self._limits, self._noise, flown)
        return flown


@njit
def _actuate(
    key: AnyArray,
    step: IntArray,
    gain: float,
    limits: tuple[float, float],
    noise: tuple[float, float],
    control: FloatArray,
) -> None:
    """Write the applied control for each control, shape (N, D, C), in place; limits, noise: of forces, of torques."""
    size = control.shape[2]
    for i in range(control.shape[0]):
        for j in range(control.shape[1]):
            for k in range(size):
                part = 0 if k < 3 else 1
                error = 2.0 * uniform_at(key[i], step[i], _FIRST_NOISE + size * j + k) - 1.0
                held = min(max(control[i, j, k], -limits[part]), limits[part])
                control[i, j, k] = gain * held + error * noise[part]
