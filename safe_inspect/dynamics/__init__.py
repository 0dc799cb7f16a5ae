"""How vehicles move. Importing it registers the plugins."""

from safe_inspect.dynamics.base import Dynamics
from safe_inspect.dynamics.clohessy_wiltshire import ClohessyWiltshire

__all__ = ["ClohessyWiltshire", "Dynamics"]
