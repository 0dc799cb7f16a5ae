"""Metrics: what an evaluation measures of every episode. Importing it registers them."""

from safe_inspect.metrics.base import BaseMetric, Metric, Reduce, TeamMetric
from safe_inspect.metrics.coverage import (
    DeltaVAfterLastPoint,
    DeltaVToCoverage,
    InspectedFraction,
    InspectedPoints,
    InspectedScore,
    OwnInspectedPoints,
    TimeToCoverage,
)
from safe_inspect.metrics.flight import (
    DeltaV,
    EpisodeLength,
    LargestRange,
    LargestSpeed,
    SmallestRange,
    ThrustingSteps,
)
from safe_inspect.metrics.safety import ClosestDeputies, Interventions, InterventionShare, InvalidActions, SmallestPhi

__all__ = [
    "BaseMetric",
    "ClosestDeputies",
    "DeltaV",
    "DeltaVAfterLastPoint",
    "DeltaVToCoverage",
    "EpisodeLength",
    "InspectedFraction",
    "InspectedPoints",
    "InspectedScore",
    "InterventionShare",
    "Interventions",
    "InvalidActions",
    "LargestRange",
    "LargestSpeed",
    "Metric",
    "OwnInspectedPoints",
    "Reduce",
    "SmallestPhi",
    "SmallestRange",
    "TeamMetric",
    "ThrustingSteps",
    "TimeToCoverage",
]
