"""`search_space`: the trials of a search as Tune takes them. Importing this module loads Ray."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ray import tune

from safe_inspect.experiments.settings.values import GRID

if TYPE_CHECKING:
    from ray.rllib.algorithms.algorithm_config import AlgorithmConfig

#: Key of the environment's configuration that holds the number of the trial.
TRIAL_KEY = "trial"


class OfTrial:
    """Tune's function from the configuration of a trial to one of its values.

    Args:
        values: The value of each trial.
    """

    def __init__(self, values: Sequence[Any]) -> None:
        self._values = list(values)

    def __call__(self, config: Mapping[str, Any]) -> Any:
        """Return the value of the trial."""
        return self._values[config["env_config"][TRIAL_KEY]]


def search_space(configs: Sequence[AlgorithmConfig]) -> dict[str, Any]:
    """Return a space in which Tune finds each configuration once, in their order.

    The only thing that Tune searches is the number of the trial; every other value is a function of it.
    """
    trees = [config.to_dict() for config in configs]
    environments = [tree.pop("env_config") for tree in trees]
    space = _functions(trees)
    space["env_config"] = {**_functions(environments), TRIAL_KEY: {GRID: list(range(len(configs)))}}
    return space


def _functions(trees: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {key: tune.sample_from(OfTrial([tree[key] for tree in trees])) for key in trees[0]}
