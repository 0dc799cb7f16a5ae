"""Direction of the sun, and `Sun`, a component that moves it about the chief at a constant rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.base import NO_DISTURBANCE, DisturbanceBounds, MotionLimits
from safe_inspect.simulators.component import Component, EntityParameter, RunningComponent
from safe_inspect.simulators.offers import OfTeam, OfView
from safe_inspect.simulators.state import State
from safe_inspect.simulators.world import World
from safe_inspect.types import ArraySpec, BoolArray, FloatArray
from safe_inspect.units import PositiveAngularRate


def sun_directions(angle: FloatArray) -> FloatArray:
    """Return the unit vectors to the sun, ``[cos, -sin, 0]`` of the angles [rad], Hill frame, shape (..., 3)."""
    return np.stack((np.cos(angle), -np.sin(angle), np.zeros_like(angle)), axis=-1)


@njit
def sun_row(angle: float) -> tuple[float, float, float]:
    """Return the unit vector to the sun for one angle [rad]; see `sun_directions`."""
    return math.cos(angle), -math.sin(angle), 0.0


@njit
def turn_sun(turn: float, angle: FloatArray, direction: FloatArray) -> None:
    """Add an angle to each sun angle [rad], shape (N,), and write the unit vectors to the sun, shape (N, 3)."""
    for n in range(angle.shape[0]):
        angle[n] += turn
        direction[n, 0], direction[n, 1], direction[n, 2] = sun_row(angle[n])


class Sun(Component):
    """Sun whose angle grows at a constant rate, clockwise about +z of Hill's frame; see `sun_directions`.

    Arrays: ``sun_angle``, not wrapped [rad], shape (N,), and ``sun_direction``, the unit vector from the chief to the
    sun, shape (N, 3). A reset takes the angle from the sampled state ``sun_angle``, or 0 if there is none.

    Attributes:
        rate: Rate of the angle [rad/s].
    """

    entity: ClassVar[Mapping[str, EntityParameter]] = {"theta": EntityParameter("rad", "sun_angle", "sun")}

    rate: PositiveAngularRate = 0.001027

    def disturbance_bounds(self, limits: MotionLimits) -> DisturbanceBounds:
        """Return zero bounds: the sun does not affect the motion of deputies."""
        return NO_DISTURBANCE

    def __call__(self, world: World, num_envs: int) -> RunningComponent:
        """Return the running sun."""
        return _RunningSun(self.rate, world.step_size)


class _RunningSun(RunningComponent):
    arrays = {"sun_angle": ArraySpec(()), "sun_direction": ArraySpec((3,))}  # noqa: RUF012 - never written
    recorded = ("sun_angle",)

    def __init__(self, rate: float, step_size: float) -> None:
        self._rate, self._turn = rate, rate * step_size

    def reset(self, state: State, values: Mapping[str, Any]) -> None:
        state["sun_angle"][:] = values.get("sun_angle", 0.0)
        turn_sun(0.0, state["sun_angle"], state["sun_direction"])

    def step(self, state: State, running: BoolArray) -> None:
        bound = state.bound.get("sun")
        if bound is None:
            arguments = self._turn, state["sun_angle"], state["sun_direction"]
            bound = state.bound["sun"] = turn_sun.dispatcher, arguments
        bound[0](*bound[1])

    def of_world(self) -> Mapping[str, Any]:
        return {"sun_rate": self._rate}

    def of_view(self) -> Mapping[str, Callable[[Any], Any]]:
        return {name: OfView(name) for name in self.arrays}

    def of_team(self) -> Mapping[str, Callable[[Any], Any]]:
        return {name: OfTeam(name) for name in self.arrays}

    def shared_state(self, team: Any) -> tuple[Any, ...]:
        return (team.sun_direction,)
