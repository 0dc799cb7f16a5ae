"""Metrics, which measure the episodes of an evaluation. Importing the package registers them."""

from safe_inspect.metrics.base import BaseMetric, Metric, Reduce, TeamMetric
from safe_inspect.metrics.coverage import DeltaVAfterLastPoint, DeltaVToCoverage, TimeToCoverage
from safe_inspect.metrics.flight import (
    Decisions,
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
    "Decisions",
    "DeltaVAfterLastPoint",
    "DeltaVToCoverage",
    "EstimateError",
    "InterventionShare",
    "Interventions",
    "LargestRange",
    "LargestSpeed",
    "Metric",
    "ReadingError",
    "Reduce",
    "SmallestPhi",
    "SmallestRange",
    "TeamMetric",
    "ThrustingSteps",
    "TimeToCoverage",
]
