"""What the components of tasks declare to simulations and safety filters."""

from __future__ import annotations

from typing import Any

import pytest

from safe_inspect.dynamics.base import NO_DISTURBANCE, MotionLimits
from safe_inspect.plugins.registry import registry

LIMITS = MotionLimits(step_size=10.0, mass=12.0, thrust=1.0, distance=800.0, speed=2.0)
#: Components by name: the bodies that they need, the radii that they define, whether they estimate, and whether they
#: disturb nothing (None: they state no bound).
DECLARED: dict[str, tuple[tuple[str, ...], dict[str, float], bool, bool | None]] = {
    "Actuators": ((), {}, False, None), "BoundedDisturbance": ((), {}, False, True),
    "ChiefRotation": (("chief",), {}, False, True), "FuelPriceSchedule": ((), {}, False, True),
    "InspectionPoints": (("chief",), {"chief": 10.0}, False, True), "KalmanFilter": ((), {}, True, None),
    "SolarPressure": ((), {}, False, False), "SpeedLimitMonitor": ((), {}, False, True),
    "Sun": ((), {}, False, True), "ThrusterModel": ((), {}, False, True),
}  # fmt: skip


@pytest.mark.parametrize("name", DECLARED)
def test_components_declare(name: str) -> None:
    component: Any = registry.get("component", name)()
    bodies, radii, estimates, nothing = DECLARED[name]
    assert (component.bodies, dict(component.radii), component.estimates) == (bodies, radii, estimates)
    bounds = component.disturbance_bounds(LIMITS)
    assert (None if bounds is None else bounds == NO_DISTURBANCE or bounds.bounds == NO_DISTURBANCE.bounds) is nothing
