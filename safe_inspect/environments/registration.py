"""Functions that make environments from an experiment file or from the id of a shipped task."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from safe_inspect.config.experiment import build_experiment, load_experiment
from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.facades.arguments import check_keywords, checked_overrides
from safe_inspect.environments.facades.multi_vector import MultiAgentVectorEnv
from safe_inspect.environments.facades.single import InspectionEnv
from safe_inspect.environments.facades.vector import InspectionVectorEnv

if TYPE_CHECKING:
    from safe_inspect.environments.facades.parallel import InspectionParallelEnv


def load_spec(cfg: str | os.PathLike[str], overrides: Iterable[str] = ()) -> EnvironmentSpec:
    """Return the task of an experiment file or of a registered id.

    Args:
        cfg: A file, or an id such as ``safe_inspect/TranslationalInspectionSeed-v0``.
        overrides: ``path.of.keys=value`` for each value of the file to replace.

    Raises:
        ConfigError: The configuration is invalid.
    """
    return load_experiment(cfg, checked_overrides(overrides)).spec


def build_spec(resolved: Mapping[str, Any]) -> EnvironmentSpec:
    """Return the task of a resolved configuration, see `Experiment.resolved`."""
    return build_experiment(resolved).spec


def make(cfg: str | os.PathLike[str], overrides: Iterable[str] = (), **kwargs: Any) -> InspectionEnv:
    """Make one environment from an experiment file or a registered id; see `InspectionEnv`."""
    check_keywords(InspectionEnv, kwargs, cfg, overrides)
    return InspectionEnv(load_spec(cfg, overrides), **kwargs)


def make_vec(
    cfg: str | os.PathLike[str], num_envs: int = 1, overrides: Iterable[str] = (), **kwargs: Any
) -> InspectionVectorEnv:
    """Make N environments that step together; see `InspectionVectorEnv`."""
    check_keywords(InspectionVectorEnv, kwargs, cfg, overrides)
    return InspectionVectorEnv(load_spec(cfg, overrides), num_envs, **kwargs)


def make_parallel(cfg: str | os.PathLike[str], overrides: Iterable[str] = (), **kwargs: Any) -> InspectionParallelEnv:
    """Make one PettingZoo environment with any number of agents; see `InspectionParallelEnv`."""
    from safe_inspect.environments.facades.parallel import InspectionParallelEnv  # PettingZoo takes half a second

    check_keywords(InspectionParallelEnv, kwargs, cfg, overrides)
    return InspectionParallelEnv(load_spec(cfg, overrides), **kwargs)


def make_parallel_vec(
    cfg: str | os.PathLike[str], num_envs: int = 1, overrides: Iterable[str] = (), **kwargs: Any
) -> MultiAgentVectorEnv:
    """Make N environments, with any number of agents, that step together; see `MultiAgentVectorEnv`."""
    check_keywords(MultiAgentVectorEnv, kwargs, cfg, overrides)
    return MultiAgentVectorEnv(load_spec(cfg, overrides), num_envs, **kwargs)
