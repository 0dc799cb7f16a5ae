"""Environments: the batched core and its façades."""

from safe_inspect.environments.core import BatchedEnvironment
from safe_inspect.environments.registration import build_spec, load_spec, make, make_vec
from safe_inspect.environments.single import InspectionEnv
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition, Transition
from safe_inspect.environments.vector import InspectionVectorEnv

__all__ = [
    "BatchedEnvironment",
    "InspectionEnv",
    "InspectionVectorEnv",
    "TeamEnvironment",
    "TeamTransition",
    "Transition",
    "build_spec",
    "load_spec",
    "make",
    "make_vec",
]
