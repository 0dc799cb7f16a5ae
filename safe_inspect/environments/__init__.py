"""Environments: the batched core and its façades, except that of PettingZoo, which takes half a second to import."""

from safe_inspect.environments.core import BatchedEnvironment
from safe_inspect.environments.facades.multi_vector import MultiAgentVectorEnv
from safe_inspect.environments.facades.single import InspectionEnv
from safe_inspect.environments.facades.spaces import FlatDiscreteActions
from safe_inspect.environments.facades.vector import InspectionVectorEnv
from safe_inspect.environments.registration import (
    build_spec,
    load_spec,
    make,
    make_parallel,
    make_parallel_vec,
    make_vec,
)
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition, Transition

__all__ = [
    "BatchedEnvironment",
    "FlatDiscreteActions",
    "InspectionEnv",
    "InspectionVectorEnv",
    "MultiAgentVectorEnv",
    "TeamEnvironment",
    "TeamTransition",
    "Transition",
    "build_spec",
    "load_spec",
    "make",
    "make_parallel",
    "make_parallel_vec",
    "make_vec",
]
