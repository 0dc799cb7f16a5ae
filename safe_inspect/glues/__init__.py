"""Glues, which map sensor readings to observations and actions to controllers. Importing the package registers them."""

from safe_inspect.glues.attitude import (
    AngleToUnitVector,
    CoordinateAxisGlue,
    DotProductGlue,
    MagNorm3DGlue,
    RotateVectorToLocalRef3d,
)
from safe_inspect.glues.base import ActionGlue, Glue, ObservationGlue
from safe_inspect.glues.coast_glue import CoastGlue
from safe_inspect.glues.controller_glue import ControllerGlue
from safe_inspect.glues.derived import DerivedGlue, SimsMagnitudeGlue, VelocityLimitGlue
from safe_inspect.glues.discrete_controller_glue import DiscreteControllerGlue
from safe_inspect.glues.normalization import Normalization
from safe_inspect.glues.normalizers import LinearNormalizer, Normalizer, StandardNormalNormalizer
from safe_inspect.glues.observe_sensor import ObserveSensor

__all__ = [
    "ActionGlue",
    "AngleToUnitVector",
    "CoastGlue",
    "ControllerGlue",
    "CoordinateAxisGlue",
    "DerivedGlue",
    "DiscreteControllerGlue",
    "DotProductGlue",
    "Glue",
    "LinearNormalizer",
    "MagNorm3DGlue",
    "Normalization",
    "Normalizer",
    "ObservationGlue",
    "ObserveSensor",
    "RotateVectorToLocalRef3d",
    "SimsMagnitudeGlue",
    "StandardNormalNormalizer",
    "VelocityLimitGlue",
]
