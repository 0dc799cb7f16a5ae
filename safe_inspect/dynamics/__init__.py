"""How vehicles move. Importing it registers the plugins."""

from safe_inspect.dynamics.attitude.clohessy_wiltshire_attitude import ClohessyWiltshireAttitude
from safe_inspect.dynamics.base import Dynamics
from safe_inspect.dynamics.clohessy_wiltshire import ClohessyWiltshire
from safe_inspect.dynamics.double_integrator import DoubleIntegrator

__all__ = ["ClohessyWiltshire", "ClohessyWiltshireAttitude", "DoubleIntegrator", "Dynamics"]
