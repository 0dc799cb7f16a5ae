"""Build RLlib's `AlgorithmConfig` from checked settings. Importing this module loads Ray and Torch."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from safe_inspect.errors import ConfigError, Problem, did_you_mean
from safe_inspect.experiments.environment import ENVIRONMENT
from safe_inspect.experiments.translation import Translation
from safe_inspect.experiments.values import GRID, is_searched

if TYPE_CHECKING:
    from ray.rllib.algorithms.algorithm_config import AlgorithmConfig

#: Attribute of `AlgorithmConfig` for a key whose name is another.
ATTRIBUTES = {"lambda": "lambda_"}

_OWN = ("algorithm", "model_config", "torch_num_threads", "evaluation_config")
_UNSET = -1  # RLlib's mark of a removed attribute


def build_config(rllib: Translation, env_config: Mapping[str, Any]) -> AlgorithmConfig:
    """Return the configuration of the algorithm, ready for Tune.

    Args:
        rllib: The settings, from `translate_rllib`, without problems.
        env_config: What the environments are built from; see `environment_settings`.

    Raises:
        ConfigError: A key that the algorithm does not have, or values that it refuses together.
    """
    from safe_inspect.experiments.callbacks import RunCallbacks

    settings = rllib.settings
    config = default_config(settings["algorithm"])
    _check_names(config, rllib)
    _apply(config, settings)
    config.environment(ENVIRONMENT, env_config=dict(env_config))
    config.gym_env_vectorize_mode = "vector_entry_point"
    config.normalize_actions = config.clip_actions = False  # the environment clips a whole batch at once
    config.callbacks(callbacks_class=RunCallbacks)
    _set_policies(config, settings["model_config"])
    evaluation = settings.get("evaluation_config")
    if evaluation is not None:
        config.evaluation(evaluation_config={ATTRIBUTES.get(key, key): item for key, item in evaluation.items()})
    try:
        first_choice(config, settings).validate()
    except ValueError as error:
        raise ConfigError(Problem(str(error).split("\nTo suppress")[0], "rllib_configs")) from error
    return config


def first_choice(config: AlgorithmConfig, settings: Mapping[str, Any]) -> AlgorithmConfig:
    """Return a copy in which each value that Tune searches is the first of its list."""
    chosen = config.copy(copy_frozen=False)
    for name, value in settings.items():
        if is_searched(value):
            setattr(chosen, ATTRIBUTES.get(name, name), value[GRID][0])
    return chosen


def claimed_processors(config: AlgorithmConfig, settings: Mapping[str, Any]) -> float:
    """Return how many logical processors a trial claims."""
    trainable: Any = config.algo_class
    request = trainable.default_resource_request(first_choice(config, settings))
    return float(sum(bundle.get("CPU", 0.0) for bundle in request.bundles))


def environment_settings(experiment: Mapping[str, Any], rllib: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    """Return what RLlib hands to the environments: the resolved configuration, the seed, and the run's own."""
    return {
        "experiment": dict(experiment),
        "seed": int(rllib.get("seed") or 0),
        "torch_num_threads": rllib["torch_num_threads"],
        **more,
    }


def default_config(algorithm: str) -> AlgorithmConfig:
    """Return RLlib's own defaults of an algorithm, on the current API stack."""
    import ray.rllib  # registers its algorithms with Tune  # noqa: F401
    from ray.tune.registry import get_trainable_cls

    trainable: Any = get_trainable_cls(algorithm)  # type: ignore[no-untyped-call]
    config: AlgorithmConfig = trainable.get_default_config()
    return config


def attribute_names(config: AlgorithmConfig) -> set[str]:
    """Return the public attributes and settable properties of a configuration, removed ones left out."""
    names = {name for name, value in vars(config).items() if not (type(value) is int and value == _UNSET)}
    names |= {
        name
        for name, member in inspect.getmembers(type(config), lambda item: isinstance(item, property))
        if member.fset is not None
    }
    return {name for name in names if not name.startswith("_")}


def _check_names(config: AlgorithmConfig, rllib: Translation) -> None:
    names = attribute_names(config)
    problems = []
    for name in dict.fromkeys((*rllib.unchecked, *sorted(rllib.given))):
        attribute = ATTRIBUTES.get(name, name)
        if name in _OWN or attribute in names:
            continue
        message = f"{rllib.settings['algorithm']} has no key `{name}`"
        problems.append(Problem(message, f"rllib_configs.{name}", hint=did_you_mean(name, names)))
    if problems:
        raise ConfigError(problems)


def _apply(config: AlgorithmConfig, settings: Mapping[str, Any]) -> None:
    names = attribute_names(config)
    for name, value in settings.items():
        attribute = ATTRIBUTES.get(name, name)
        if name not in _OWN and attribute in names:  # a default of ours may not concern this algorithm
            setattr(config, attribute, value)


def _set_policies(config: AlgorithmConfig, model: Mapping[str, Any]) -> None:
    """Give the one agent its policy; several agents will get theirs here."""
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

    config.rl_module(model_config=DefaultModelConfig(**model))
