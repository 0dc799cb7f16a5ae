"""Reward functors. Importing it registers them."""

from safe_inspect.rewards.base import Reward
from safe_inspect.rewards.crash import InspectionCrashReward
from safe_inspect.rewards.delta_v import InspectionDeltaVReward
from safe_inspect.rewards.points import InspectionSuccessReward, ObservedPointsReward
from safe_inspect.rewards.rta import InspectionRTAReward

__all__ = [
    "InspectionCrashReward",
    "InspectionDeltaVReward",
    "InspectionRTAReward",
    "InspectionSuccessReward",
    "ObservedPointsReward",
    "Reward",
]
