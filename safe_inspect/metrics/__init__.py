"""Metrics, which measure the episodes of an evaluation. Importing the package registers them."""

from safe_inspect.metrics.base import BaseMetric, Metric, Reduce, TeamMetric
from safe_inspect.metrics.coverage import (
    DeltaVAfterLastPoint,
    DeltaVToCoverage,
    InspectedFraction,
    InspectedPoints,
    OwnInspectedPoints,
    TimeToCoverage,
)
from safe_inspect.metrics.flight import (
    ClosestDeputies,
    Decisions,
    DeltaV,
    EpisodeLength,
    EstimateError,
    Interventions,
    InterventionShare,
    LargestRange,
    LargestSpeed,
    ReadingError,
    SmallestPhi,
    SmallestRange,
    ThrustingSteps,
)

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
    "InterventionShare",
    "Interventions",
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
