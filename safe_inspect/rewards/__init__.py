"""Reward functors. Importing the package registers them."""

from safe_inspect.rewards.base import Reward
from safe_inspect.rewards.delta_v import DockingDeltaVReward, InspectionDeltaVReward
from safe_inspect.rewards.docking import (
    DockingDistanceExponentialChangeReward,
    DockingFailureReward,
    DockingSuccessReward,
    DockingVelocityConstraintReward,
)
from safe_inspect.rewards.mating import ContactReward, MatingProgressReward, MatingSuccessReward
from safe_inspect.rewards.pointing import GaussianDecayFromTargetValue
from safe_inspect.rewards.points import InspectionSuccessReward, ObservedPointsReward, SafeInspectionSuccessReward
from safe_inspect.rewards.safety import InspectionCrashReward, InspectionRTAReward
from safe_inspect.rewards.timely import LiveTimestepReward, WinLoseDoneReward

__all__ = [
    "ContactReward",
    "DockingDeltaVReward",
    "DockingDistanceExponentialChangeReward",
    "DockingFailureReward",
    "DockingSuccessReward",
    "DockingVelocityConstraintReward",
    "GaussianDecayFromTargetValue",
    "InspectionCrashReward",
    "InspectionDeltaVReward",
    "InspectionRTAReward",
    "InspectionSuccessReward",
    "LiveTimestepReward",
    "MatingProgressReward",
    "MatingSuccessReward",
    "ObservedPointsReward",
    "Reward",
    "SafeInspectionSuccessReward",
    "WinLoseDoneReward",
]
