"""Metrics, which measure the episodes of an evaluation. Importing the package registers them."""

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
    Decisions,
    DeltaV,
    EpisodeLength,
    LargestRange,
    LargestSpeed,
    SmallestRange,
    ThrustingSteps,
)
from safe_inspect.metrics.safety import ClosestDeputies, Interventions, InterventionShare, InvalidActions, SmallestPhi
from safe_inspect.metrics.sensing import EstimateError, ReadingError

__all__ = [
    "BaseMetric",
    "ClosestDeputies",
    "Decisions",
    "DeltaV",
    "DeltaVAfterLastPoint",
    "DeltaVToCoverage",
    "EpisodeLength",
    "EstimateError",
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
    "ReadingError",
    "Reduce",
    "SmallestPhi",
    "SmallestRange",
    "TeamMetric",
    "ThrustingSteps",
    "TimeToCoverage",
]
