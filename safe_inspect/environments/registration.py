"""Functions that make environments from an experiment file or from the id of a shipped task."""

from __future__ import annotations

import inspect
import os
import warnings
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from safe_inspect.config.experiment import build_experiment, load_experiment
from safe_inspect.config.keys.old_keys import OTHER_WORDS
from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.facades.multi_vector import MultiAgentVectorEnv
from safe_inspect.environments.facades.single import InspectionEnv
from safe_inspect.environments.facades.vector import InspectionVectorEnv
from safe_inspect.errors import ArgumentError, ConfigError, KeywordError, did_you_mean

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
    return load_experiment(cfg, _checked_overrides(overrides)).spec


def build_spec(resolved: Mapping[str, Any]) -> EnvironmentSpec:
    """Return the task of a resolved configuration, see `Experiment.resolved`."""
    return build_experiment(resolved).spec


def make(cfg: str | os.PathLike[str], overrides: Iterable[str] = (), **kwargs: Any) -> InspectionEnv:
    """Make one environment from an experiment file or a registered id; see `InspectionEnv`."""
    return InspectionEnv(_spec_for(InspectionEnv, cfg, overrides, kwargs), **kwargs)


def make_vec(
    cfg: str | os.PathLike[str], num_envs: int = 1, overrides: Iterable[str] = (), **kwargs: Any
) -> InspectionVectorEnv:
    """Make N environments that step together; see `InspectionVectorEnv`."""
    return InspectionVectorEnv(_spec_for(InspectionVectorEnv, cfg, overrides, kwargs), num_envs, **kwargs)


def make_parallel(cfg: str | os.PathLike[str], overrides: Iterable[str] = (), **kwargs: Any) -> InspectionParallelEnv:
    """Make one PettingZoo environment with any number of agents; see `InspectionParallelEnv`."""
    from safe_inspect.environments.facades.parallel import InspectionParallelEnv  # PettingZoo takes half a second

    return InspectionParallelEnv(_spec_for(InspectionParallelEnv, cfg, overrides, kwargs), **kwargs)


def make_parallel_vec(
    cfg: str | os.PathLike[str], num_envs: int = 1, overrides: Iterable[str] = (), **kwargs: Any
) -> MultiAgentVectorEnv:
    """Make N environments, with any number of agents, that step together; see `MultiAgentVectorEnv`."""
    return MultiAgentVectorEnv(_spec_for(MultiAgentVectorEnv, cfg, overrides, kwargs), num_envs, **kwargs)


def _checked_overrides(overrides: Any) -> list[str]:
    """Return overrides as a list.

    Raises:
        ArgumentError: The overrides are a single string or a mapping, or contain something other than strings.
    """
    hint = 'a list of strings is expected, such as ["horizon=600"]'
    if isinstance(overrides, str | Mapping) or not isinstance(overrides, Iterable):
        raise ArgumentError(f"overrides: {hint}, not {overrides!r}")
    given = list(overrides)
    wrong = next((override for override in given if not isinstance(override, str)), None)
    if wrong is not None:
        raise ArgumentError(f"overrides: {hint}; {wrong!r} is not a string")
    return given


def _spec_for(
    made: type[Any], cfg: str | os.PathLike[str], overrides: Iterable[str], given: Mapping[str, Any]
) -> EnvironmentSpec:
    """Return the task for an environment class, after a check that the class accepts the given keywords.

    Raises:
        KeywordError: A keyword is not accepted; for a key of the configuration, the message shows the override.
    """
    taken = [*list(inspect.signature(made).parameters)[1:], "overrides"]  # the first is the task
    problems = []
    for name in given:
        if name in taken:
            continue
        hint = did_you_mean(name, taken)
        override = f"{OTHER_WORDS.get(name, name)}={given[name]}"
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                load_experiment(cfg, [*overrides, override])
            hint = f"a value of the configuration is replaced by overrides=[{override!r}]"
        except ConfigError as error:
            if any(problem.ambiguous for problem in error.problems):
                hint = f"as an override, {error}"
        problems.append(f"{made.__name__}() got an unexpected keyword argument {name!r}; {hint}")
    if problems:
        raise KeywordError("\n".join(problems))
    return load_spec(cfg, overrides)
