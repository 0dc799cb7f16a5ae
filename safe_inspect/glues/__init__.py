"""Glues, which map sensor readings to observations and actions to controllers. Importing the package registers them."""

from safe_inspect.glues import actions, attitude, observations  # noqa: F401
from safe_inspect.glues.base import ActionGlue, ObservationGlue
from safe_inspect.glues.normalizers import Normalizer

__all__ = ["ActionGlue", "Normalizer", "ObservationGlue"]
