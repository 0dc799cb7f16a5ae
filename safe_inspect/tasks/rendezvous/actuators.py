"""`Actuators`: effect of thrusters and reaction wheels on a command."""

from __future__ import annotations

from pydantic import Field

from safe_inspect.compiling import njit
from safe_inspect.random.balls import uniform_at
from safe_inspect.simulators import Component, RunningComponent, State, World
from safe_inspect.types import AnyArray, FloatArray, IntArray
from safe_inspect.units import NonNegativeForce, NonNegativeTorque, PositiveForce, PositiveTorque

#: Number of the first sample of a deputy; other components use those from 0.
_FIRST_DRAW = 1_000


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
                error = 2.0 * uniform_at(key[i], step[i], _FIRST_DRAW + size * j + k) - 1.0
                held = min(max(control[i, j, k], -limits[part]), limits[part])
                control[i, j, k] = gain * held + error * noise[part]
