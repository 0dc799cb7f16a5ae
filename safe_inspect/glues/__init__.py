"""Glues, which map sensor readings to observations and actions to controllers. Importing the package registers them."""

from safe_inspect.glues import (  # noqa: F401
    attitude,
    coast_glue,
    controller_glue,
    derived,
    discrete_controller_glue,
    observe_sensor,
)
from safe_inspect.glues.base import ActionGlue, ObservationGlue
from safe_inspect.glues.normalizers import Normalizer

__all__ = ["ActionGlue", "Normalizer", "ObservationGlue"]
