"""`BoundedDisturbance`: disturbs deputies, their thrusters and their state estimates within bounds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal

from safe_inspect.dynamics.base import DisturbanceBounds, MotionLimits
from safe_inspect.simulators.component import Component, RunningComponent
from safe_inspect.simulators.offers import OfTeam, OwnOfView
from safe_inspect.simulators.state import State
from safe_inspect.simulators.world import World
from safe_inspect.tasks.disturbances.rows import add_velocity, turn_thrust, write_estimates
from safe_inspect.types import ArraySpec, BoolArray, FloatArray


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
        cls = _Estimated if self.estimates else _Disturbed
        return cls(self, world.num_deputies)


class _Disturbed(RunningComponent):
    def __init__(self, plugin: BoundedDisturbance, deputies: int) -> None:
        self._plugin, self._deputies = plugin, deputies
        self._extreme = plugin.distribution == "extreme"

    def actuate(self, state: State, control: FloatArray) -> FloatArray:
        plugin = self._plugin
        if plugin.thrust_gain or plugin.thrust_direction:
            control = control.copy()
            turn_thrust(
                state["key"], state["step"], plugin.thrust_gain, plugin.thrust_direction, self._extreme, control
            )  # fmt: skip
        return control

    def step(self, state: State, running: BoolArray) -> None:
        if self._plugin.velocity:
            velocity = state["velocity"][:, : self._deputies]
            add_velocity(state["key"], state["step"], self._plugin.velocity, self._extreme, velocity)


class _Estimated(_Disturbed):
    def __init__(self, plugin: BoundedDisturbance, deputies: int) -> None:
        super().__init__(plugin, deputies)
        self.arrays = {name: ArraySpec((deputies, 3)) for name in ("estimated_position", "estimated_velocity")}
        self._errors = (plugin.position_error, plugin.velocity_error)

    def reset(self, state: State, values: Mapping[str, Any]) -> None:
        truth = state["position"][:, : self._deputies], state["velocity"][:, : self._deputies]
        estimates = state["estimated_position"], state["estimated_velocity"]
        write_estimates(state["key"], state["step"], self._errors, self._extreme, truth, estimates)

    def step(self, state: State, running: BoolArray) -> None:
        super().step(state, running)
        self.reset(state, {})

    def of_view(self) -> Mapping[str, Callable[[Any], Any]]:
        return {name: OwnOfView(name) for name in self.arrays}

    def of_team(self) -> Mapping[str, Callable[[Any], Any]]:
        return {name: OfTeam(name) for name in self.arrays}
