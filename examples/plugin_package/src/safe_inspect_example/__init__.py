"""Plugins for safe_inspect, one of each kind. Importing the package registers them."""

from safe_inspect_example.constraints import Wall
from safe_inspect_example.dones import FuelSpentDone
from safe_inspect_example.glues import DirectionGlue, OnOffGlue
from safe_inspect_example.metrics import PathLength, TeamSpread
from safe_inspect_example.noise import ThrustNoise
from safe_inspect_example.normalizers import TanhNormalizer
from safe_inspect_example.orbits import SchweighartSedwick
from safe_inspect_example.platforms import CubeSat, ThrustUnit
from safe_inspect_example.policies import BrakingPolicy
from safe_inspect_example.resets import LogUniformParameter, RingInitializer
from safe_inspect_example.rewards import SpeedLimitReward
from safe_inspect_example.sensors import RangeRateSensor
from safe_inspect_example.simulators import FreeFlightSimulator
from safe_inspect_example.teams import CoastWhenClose, ScatteredDone

__all__ = [
    "BrakingPolicy",
    "CoastWhenClose",
    "CubeSat",
    "DirectionGlue",
    "FreeFlightSimulator",
    "FuelSpentDone",
    "LogUniformParameter",
    "OnOffGlue",
    "PathLength",
    "RangeRateSensor",
    "RingInitializer",
    "ScatteredDone",
    "SchweighartSedwick",
    "SpeedLimitReward",
    "TanhNormalizer",
    "TeamSpread",
    "ThrustNoise",
    "ThrustUnit",
    "Wall",
]
