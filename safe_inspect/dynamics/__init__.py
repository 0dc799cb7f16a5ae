"""Dynamics of vehicles. Importing the package registers the plugins."""

from safe_inspect.dynamics.attitude.clohessy_wiltshire_attitude import ClohessyWiltshireAttitude
from safe_inspect.dynamics.base import NO_DISTURBANCE, DisturbanceBounds, Dynamics, MotionLimits
from safe_inspect.dynamics.clohessy_wiltshire import ClohessyWiltshire
from safe_inspect.dynamics.double_integrator import DoubleIntegrator
from safe_inspect.dynamics.free_flyer import FreeFlyer
from safe_inspect.dynamics.orbit.relative_orbit import Drag, RelativeOrbit

__all__ = [
    "NO_DISTURBANCE",
    "ClohessyWiltshire",
    "ClohessyWiltshireAttitude",
    "DisturbanceBounds",
    "DoubleIntegrator",
    "Drag",
    "Dynamics",
    "FreeFlyer",
    "MotionLimits",
    "RelativeOrbit",
]
