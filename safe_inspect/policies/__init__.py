"""Scripted policies, which control deputies without training. Importing this package registers them.

Plans of inspection flights are made on arrays, apart from environments and policies: `burn_search` plans for a deputy,
also among others, and plans again when necessary; `plan_refinement` reduces the fuel of a plan by linear programmes.
The motion follows `safe_inspect.dynamics.step_maps`.
"""

from safe_inspect.policies.base import SCRIPTED_POLICY, ScriptedPolicy, ThrustLimits
from safe_inspect.policies.docking import DockingAutopilot, DockingController
from safe_inspect.policies.inspector import NaturalMotionInspector, SixDofInspector
from safe_inspect.policies.open_loop import RandomThrust, ZeroThrust

#: Deprecated name of `SCRIPTED_POLICY`; it will be removed in the next release.
PILOT = SCRIPTED_POLICY

__all__ = [
    "PILOT",
    "SCRIPTED_POLICY",
    "DockingAutopilot",
    "DockingController",
    "NaturalMotionInspector",
    "RandomThrust",
    "ScriptedPolicy",
    "SixDofInspector",
    "ThrustLimits",
    "ZeroThrust",
]
