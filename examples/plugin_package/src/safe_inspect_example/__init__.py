"""Plugins for safe_inspect. Importing the package registers them."""

from safe_inspect_example.constraints import Wall
from safe_inspect_example.dones import FuelSpentDone
from safe_inspect_example.rewards import SpeedLimitReward
from safe_inspect_example.sensors import RangeRateSensor

__all__ = ["FuelSpentDone", "RangeRateSensor", "SpeedLimitReward", "Wall"]
