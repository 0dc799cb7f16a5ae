"""Run-time assurance: constraints, filters that enforce them, and the rejection sampler. Importing registers them."""

from safe_inspect.rta.base import SafetyGlue, TeamSafety
from safe_inspect.rta.docking import RTAGlueCWHDocking3d
from safe_inspect.rta.inspection import RTACWHInspectionTeam, RTAGlueCWHInspection1v1
from safe_inspect.rta.rejection_sampler import RejectionSampler
from safe_inspect.rta.tumbling import RTAGlueTumblingTarget

__all__ = [
    "RTACWHInspectionTeam",
    "RTAGlueCWHDocking3d",
    "RTAGlueCWHInspection1v1",
    "RTAGlueTumblingTarget",
    "RejectionSampler",
    "SafetyGlue",
    "TeamSafety",
]
