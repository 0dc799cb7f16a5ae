"""Environments: the batched core and its façades. `InspectionParallelEnv` is imported on first use."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from safe_inspect.environments.core import BatchedEnvironment
from safe_inspect.environments.facades.flat_actions import FlatDiscreteActions
from safe_inspect.environments.facades.multi_vector import MultiAgentVectorEnv
from safe_inspect.environments.facades.single import InspectionEnv
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

if TYPE_CHECKING:
    from safe_inspect.environments.facades.parallel import InspectionParallelEnv

__all__ = [
    "BatchedEnvironment",
    "FlatDiscreteActions",
    "InspectionEnv",
    "InspectionParallelEnv",
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


def __getattr__(name: str) -> Any:
    if name != "InspectionParallelEnv":
        raise AttributeError(f"module 'safe_inspect.environments' has no attribute {name!r}")
    from safe_inspect.environments.facades.parallel import (
        InspectionParallelEnv,  # PettingZoo takes half a second to import
    )

    return InspectionParallelEnv
