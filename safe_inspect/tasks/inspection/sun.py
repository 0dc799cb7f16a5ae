"""Direction of the sun, and `Sun`, a component that moves it about the chief at a constant rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.base import NO_DISTURBANCE, DisturbanceBounds, MotionLimits
from safe_inspect.geometry.shadow import Shadow, earth_shadow, sunlight_row
from safe_inspect.simulators.component import Component, EntityParameter, RunningComponent
from safe_inspect.simulators.offers import OfTeam, OfView
from safe_inspect.simulators.state import State
from safe_inspect.simulators.world import World
from safe_inspect.types import ArraySpec, BoolArray, FloatArray
from safe_inspect.units import PositiveAngularRate, PositiveLength

#: The array of the direction of the light, with `Sun.eclipse`.
LIGHT = "light_direction"


def sun_directions(angle: FloatArray) -> FloatArray:
    """Return the unit vectors to the sun, ``[cos, -sin, 0]`` of the angles [rad], Hill frame, shape (..., 3)."""
    return np.stack((np.cos(angle), -np.sin(angle), np.zeros_like(angle)), axis=-1)


@njit
def sun_row(angle: float) -> tuple[float, float, float]:
    """Return the unit vector to the sun for one angle [rad]; see `sun_directions`."""
    return math.cos(angle), -math.sin(angle), 0.0


def light_directions(angle: FloatArray, world: World) -> FloatArray:
    """Return the unit vectors to the sun, with NaN where the Earth hides it and nothing is lit, shape (..., 3)."""
    found, shadow = sun_directions(angle), world.offers.world.get("shadow")
    if shadow is not None:
        found[found[..., 0] < shadow.edge] = np.nan
    return found


@njit
def turn_sun(turn: float, angle: FloatArray, direction: FloatArray) -> None:
    """Add an angle to each sun angle [rad], shape (N,), and write the unit vectors to the sun, shape (N, 3)."""
    for n in range(angle.shape[0]):
        angle[n] += turn
        direction[n, 0], direction[n, 1], direction[n, 2] = sun_row(angle[n])


@njit
def shade(shadow: Shadow, direction: FloatArray, sunlight: FloatArray, light: FloatArray) -> None:
    """Write the visible fraction of the sun, shape (N,), and the direction of the light, shape (N, 3); see `Sun`."""
    for n in range(sunlight.shape[0]):
        sunlight[n] = sunlight_row(direction[n, 0], shadow)
        for axis in range(3):
            light[n, axis] = direction[n, axis] if direction[n, 0] >= shadow.edge else math.nan


class Sun(Component):
    """Sun whose angle grows at a constant rate, clockwise about +z of Hill's frame; see `sun_directions`.

    Arrays: ``sun_angle``, not wrapped [rad], shape (N,), and ``sun_direction``, the unit vector from the chief to the
    sun, shape (N, 3). A reset takes the angle from the sampled state ``sun_angle``, or 0 if there is none.

    With `eclipse`, there are two more arrays: ``sunlight``, the fraction of the sun's disc that the Earth does not hide
    [-], shape (N,), see `sunlight_row`, and ``light_direction``, which is ``sun_direction`` while the centre of the
    disc is visible and NaN otherwise, so that no point is lit, shape (N, 3). The sun is in the orbital plane and the
    orbit is the circular one with the mean motion of the dynamics.

    Attributes:
        rate: Rate of the angle [rad/s].
        eclipse: Whether the Earth hides the sun.
        distance: Distance of the sun [m]; it determines the apparent size of the disc.
    """

    entity: ClassVar[Mapping[str, EntityParameter]] = {"theta": EntityParameter("rad", "sun_angle", "sun")}

    rate: PositiveAngularRate = 0.001027
    eclipse: bool = False
    distance: PositiveLength = 150e9

    def disturbance_bounds(self, limits: MotionLimits) -> DisturbanceBounds:
        """Return zero bounds: the sun does not affect the motion of deputies."""
        return NO_DISTURBANCE

    def __call__(self, world: World, num_envs: int) -> RunningComponent:
        """Return the running sun.

        Raises:
            ValueError: With `eclipse`, the orbit is not outside of the Earth.
        """
        shadow = earth_shadow(world.mean_motion, self.distance) if self.eclipse else None
        return _RunningSun(self.rate, world.step_size, shadow)


class _RunningSun(RunningComponent):
    def __init__(self, rate: float, step_size: float, shadow: Shadow | None) -> None:
        self._rate, self._turn, self._shadow = rate, rate * step_size, shadow
        self.arrays = {"sun_angle": ArraySpec(()), "sun_direction": ArraySpec((3,))}
        self.recorded = ("sun_angle",)
        if shadow is not None:
            self.arrays |= {"sunlight": ArraySpec(()), LIGHT: ArraySpec((3,))}
            self.recorded = ("sun_angle", "sunlight")

    def reset(self, state: State, values: Mapping[str, Any]) -> None:
        state["sun_angle"][:] = values.get("sun_angle", 0.0)
        turn_sun(0.0, state["sun_angle"], state["sun_direction"])
        self._shade(state)

    def step(self, state: State, running: BoolArray) -> None:
        bound = state.bound.get("sun")
        if bound is None:
            arguments = self._turn, state["sun_angle"], state["sun_direction"]
            bound = state.bound["sun"] = turn_sun.dispatcher, arguments
        bound[0](*bound[1])
        self._shade(state)

    def _shade(self, state: State) -> None:
        if self._shadow is not None:
            shade(self._shadow, state["sun_direction"], state["sunlight"], state[LIGHT])

    def of_world(self) -> Mapping[str, Any]:
        return {"sun_rate": self._rate} | ({} if self._shadow is None else {"shadow": self._shadow})

    def of_view(self) -> Mapping[str, Callable[[Any], Any]]:
        return {name: OfView(name) for name in self.arrays}

    def of_team(self) -> Mapping[str, Callable[[Any], Any]]:
        return {name: OfTeam(name) for name in self.arrays}

    def shared_state(self, team: Any) -> tuple[Any, ...]:
        return (team.sun_direction,)
