"""`SolarPressure`: acceleration of deputies relative to the chief by the pressure of sunlight."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from safe_inspect.dynamics.base import DisturbanceBounds, MotionLimits
from safe_inspect.errors import InitialStateError
from safe_inspect.simulators import Component, RunningComponent, State, World
from safe_inspect.types import BoolArray
from safe_inspect.units import NonNegativeAreaPerMass

#: Pressure of sunlight on an absorbing surface at 1 au [N/m^2]: 1361 W/m^2 over the speed of light.
_PRESSURE = 1361.0 / 299_792_458.0


class SolarPressure(Component):
    """Pressure of sunlight on spheres, for a `disturbance` of a simulator with the component `Sun`.

    A deputy is accelerated by ``-P f (k_deputy - k_chief) s`` relative to the chief, with P = 4.54e-6 N/m^2, the
    visible fraction f of the sun's disc (1 without eclipses) and the direction s to the sun, at the start of a step.

    Source:
        Vallado, "Fundamentals of Astrodynamics and Applications", 4th edition, 2013, section 8.6.4.

    Attributes:
        deputy: Reflectivity coefficient times area over mass of a deputy, k = C_R A / m [m^2/kg].
        chief: The same of the chief [m^2/kg].
    """

    deputy: NonNegativeAreaPerMass = 0.02  # type: ignore[valid-type]
    chief: NonNegativeAreaPerMass = 0.01  # type: ignore[valid-type]

    @property
    def _largest(self) -> float:
        return float(_PRESSURE * (self.deputy - self.chief))

    def disturbance_bounds(self, limits: MotionLimits) -> DisturbanceBounds:
        """Return the velocity that a step adds in full sunlight."""
        return DisturbanceBounds(velocity=abs(self._largest) * limits.step_size)

    def __call__(self, world: World, num_envs: int) -> RunningComponent:
        """Return the running component."""
        return _RunningPressure(self._largest, world)


class _RunningPressure(RunningComponent):
    def __init__(self, largest: float, world: World) -> None:
        self._largest, self._deputies, self._step_size = largest, world.num_deputies, world.step_size

    def reset(self, state: State, values: Mapping[str, Any]) -> None:
        if "sun_direction" not in state.arrays:
            raise InitialStateError(
                "SolarPressure needs the component `Sun`; add it to the simulator, or remove this one"
            )

    def step(self, state: State, running: BoolArray) -> None:
        # Components of the disturbance precede the sun, whose arrays are still those of the start of the step.
        acceleration = -self._largest * state["sun_direction"]
        if "sunlight" in state.arrays:
            acceleration *= state["sunlight"][:, None]
        dt = self._step_size
        state.position[:, : self._deputies] += 0.5 * dt * dt * acceleration[:, None]
        state.velocity[:, : self._deputies] += dt * acceleration[:, None]
