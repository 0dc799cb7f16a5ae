"""Run-time assurance: constraints, the glue that applies them, the rejection sampler. Importing registers them."""

from safe_inspect.rta.base import SafetyGlue
from safe_inspect.rta.inspection import RTAGlueCWHInspection1v1
from safe_inspect.rta.rejection_sampler import RejectionSampler

__all__ = ["RTAGlueCWHInspection1v1", "RejectionSampler", "SafetyGlue"]
