"""`build_config`: RLlib's `AlgorithmConfig` from checked settings. Importing this module loads Ray and Torch.

It also builds the RLlib objects that an experiment names: connectors, an RLModule and a replay buffer.
"""

from __future__ import annotations

import dataclasses
import inspect
import json
import warnings
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any, cast

from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
from ray.rllib.callbacks.callbacks import RLlibCallback
from ray.rllib.connectors.connector_v2 import ConnectorV2
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.rllib.core.rl_module.multi_rl_module import MultiRLModuleSpec
from ray.rllib.core.rl_module.rl_module import RLModule, RLModuleSpec
from ray.rllib.utils import replay_buffers
from ray.tune.registry import get_trainable_cls, register_env

from safe_inspect.config.elements import CONTROL_STEPS
from safe_inspect.config.experiment import build_experiment
from safe_inspect.config.keys.rllib_keys import CHANGING_KEYS, FRESH_KEYS, OWN_KEYS
from safe_inspect.config.spec import PolicySpec
from safe_inspect.errors import ConfigError, Problem, did_you_mean
from safe_inspect.experiments.learning.ppo_learner import THREADS, FastPPOLearner
from safe_inspect.experiments.modules.policy import frozen_spec, policy_spec
from safe_inspect.experiments.sampling.env_runners import BatchedEnvRunner, BatchedTeamRunner, RunCallbacks
from safe_inspect.experiments.sampling.environment import TeamMultiAgentEnv, TrainingEnv
from safe_inspect.experiments.settings.key_tables import TranslatedSettings
from safe_inspect.experiments.settings.objects import built_as, class_of
from safe_inspect.experiments.settings.policies import DEFAULT_MAKER, SINGLE, experiment_in, policy_info

#: Attributes of `AlgorithmConfig` whose names differ from those of the keys.
ATTRIBUTES = {"lambda": "lambda_"}

#: Keys that are not attributes of `AlgorithmConfig`, or are set by one of its methods.
_OWN = frozenset({*OWN_KEYS, "evaluation_config"})
#: The name under which the environment is registered in RLlib; checkpoints contain it too.
ENVIRONMENT = "safe_inspect"

_UNSET = -1  # RLlib's value of a removed attribute
_HOOKS = ("on_episode_created", "on_episode_start", "on_episode_step", "on_episode_end")


def _policy_of(by_agent: Mapping[str, str], agent: str, episode: Any = None, **kwargs: Any) -> str:
    """Return the name of an agent's policy; RLlib passes the arguments after the first."""
    return by_agent[agent]


def build_config(
    rllib: TranslatedSettings, env_config: Mapping[str, Any], policies: Mapping[str, PolicySpec] | None = None
) -> AlgorithmConfig:
    """Return the configuration of the algorithm, ready for Tune.

    Args:
        rllib: The settings of one trial, from `translate_rllib`, without problems.
        env_config: RLlib's environment configuration; see `environment_settings`.
        policies: The policies by name if there are several agents.

    Raises:
        ConfigError: The algorithm does not have a key, or rejects the combination of values.
        CheckpointError: A policy's checkpoint cannot be read.
    """
    settings = rllib.settings
    texts = {} if any(map(settings.get, CHANGING_KEYS)) else _policy_texts(env_config, policies or {})
    _check_decisions(settings, texts)
    config = default_config(settings["algorithm"])
    buffer = getattr(config, "replay_buffer_config", None)
    _apply(config, rllib)
    _set_connectors(config, settings)
    if buffer is not None:
        set_replay_buffer(config, {**buffer, **settings.get("replay_buffer_config", {})}, several=bool(policies))
    environments = {**env_config, "several": bool(policies)}
    if settings["algorithm"] == "DQN":
        environments["flat_actions"] = True  # RLlib's DQN supports only a single choice
    config.environment(ENVIRONMENT, env_config=environments, disable_env_checking=True)
    config.gym_env_vectorize_mode = "sync" if policies else "vector_entry_point"
    config.normalize_actions = config.clip_actions = False  # the environment clips a whole batch at once
    what, where = "a class of callbacks; derive it from ray.rllib's RLlibCallback", "rllib_configs.callbacks"
    callbacks = [class_of(RLlibCallback, what, name, where) for name in settings.get("callbacks") or ()]
    config.callbacks(callbacks_class=[RunCallbacks, *callbacks])
    specs = _set_policies(config, settings, policies or {}, texts)
    recurrent = [name for name, spec in specs.items() if cast(Any, spec.model_config).get("use_lstm")]
    learning = [name for name in recurrent if not policies or policies[name].trains]
    runner, learner = (f"the policy {names[0]} is recurrent" if names else "" for names in (recurrent, learning))
    if settings["env_runner"] == "batched" and not _needs_stock("runner samples", runner or _hook_of(callbacks)):
        config.env_runners(env_runner_cls=BatchedTeamRunner if policies else BatchedEnvRunner)
    if settings["learner"] == "fast" and not _needs_stock("learner learns", learner):
        own = {THREADS: settings["learner_threads"], **config.learner_config_dict}
        config.training(learner_class=FastPPOLearner, learner_config_dict=own)
    evaluation = settings.get("evaluation_config")
    if evaluation is not None:
        config.evaluation(evaluation_config={ATTRIBUTES.get(key, key): item for key, item in evaluation.items()})
    try:
        config.copy(copy_frozen=False).validate()
    except ValueError as error:
        raise ConfigError(Problem(str(error).split("\nTo suppress")[0], "rllib_configs")) from error
    return config


def _policy_texts(environments: Mapping[str, Any], policies: Mapping[str, PolicySpec]) -> dict[str, Mapping[str, str]]:
    """Return the metadata of each policy's `PolicyInfo`, by the policy's name.

    Args:
        environments: RLlib's environment configuration, see `environment_settings`.
        policies: The policies by name if there are several agents; empty for a single agent.

    Returns:
        The metadata; empty if the environments are not this package's own.
    """
    if environments.get("maker", DEFAULT_MAKER) != DEFAULT_MAKER:
        return {}
    experiment = build_experiment(experiment_in(environments))
    agents = experiment.spec.controlled
    flown = {name: [agent for agent in agents if agent.name in policy.agents] for name, policy in policies.items()}
    return {name: policy_info(experiment, name, its).metadata() for name, its in (flown or {SINGLE: agents}).items()}


def _hook_of(callbacks: Iterable[type[Any]]) -> str:
    """Return why callbacks need RLlib's stock runner, which calls them for each episode; empty if they do not."""
    hooks = [hook for hook in _HOOKS for kind in callbacks if getattr(kind, hook) is not getattr(RLlibCallback, hook)]
    return f"a callback implements `{hooks[0]}`" if hooks else ""


def _needs_stock(part: str, reason: str) -> bool:
    """Return whether there is a reason for a stock part of RLlib, and warn that it is used."""
    if reason:
        warnings.warn(f"RLlib's stock {part}, because {reason}", stacklevel=3)
    return bool(reason)


def _check_decisions(settings: Mapping[str, Any], texts: Mapping[str, Mapping[str, str]]) -> None:
    """Check the algorithm, the runner and the learner of a task with decisions that last several steps.

    Raises:
        ConfigError: They are not PPO with the batched runner and the fast learner.
    """
    wanted = {"algorithm": "PPO", "env_runner": "batched", "learner": "fast"}
    lasts = any(json.loads(text["action"])[-1]["unit"] == CONTROL_STEPS for text in texts.values())
    wrong = [key for key, value in wanted.items() if settings[key] != value] if lasts else []
    if wrong:
        needs = ", ".join(f"`{key}: {value}`" for key, value in wanted.items())
        given = ", ".join(f"`{key}: {settings[key]}`" for key in wrong)
        message = f"decisions that last several steps (CoastGlue) need {needs}, not {given}"
        hint = "change it, or remove CoastGlue"
        raise ConfigError(Problem(message, f"rllib_configs.{wrong[0]}", hint=hint))


def claimed_resources(config: AlgorithmConfig) -> list[dict[str, float]]:
    """Return the resources, such as CPU and GPU, of each process of a trial."""
    trainable: Any = config.algo_class
    request = trainable.default_resource_request(config.copy(copy_frozen=False))
    return [dict(bundle) for bundle in request.bundles]


def register_environments(maker: str = DEFAULT_MAKER) -> None:
    """Register the environment in RLlib; needed in each process that builds or restores an algorithm.

    Args:
        maker: ``module:function`` that builds the environments; by default the package's own.
    """

    def create(config: Mapping[str, Any]) -> Any:
        """Create the environment for RLlib's stock runner; the batched runner builds its environments itself."""
        rest = {"maker": maker} | {key: value for key, value in config.items() if key != "num_envs"}
        if rest.get("several"):
            return TeamMultiAgentEnv(rest)
        return TrainingEnv(rest, int(config.get("num_envs", 1)))

    register_env(ENVIRONMENT, create)


def default_config(algorithm: str) -> AlgorithmConfig:
    """Return RLlib's default configuration of an algorithm, on the current API stack."""
    trainable: Any = get_trainable_cls(algorithm)  # type: ignore[no-untyped-call]
    config: AlgorithmConfig = trainable.get_default_config()
    return config


def attribute_names(config: AlgorithmConfig) -> set[str]:
    """Return the names of the public attributes and settable properties of a configuration, without removed ones."""
    names = {name for name, value in vars(config).items() if not (type(value) is int and value == _UNSET)}
    settable = inspect.getmembers(type(config), lambda item: isinstance(item, property) and item.fset is not None)
    names |= dict(settable).keys()
    return {name for name in names if not name.startswith("_")}


def _apply(config: AlgorithmConfig, rllib: TranslatedSettings) -> None:
    """Set the attributes of a configuration.

    Raises:
        ConfigError: The algorithm does not have a key that the experiment gives.
    """
    names, settings = attribute_names(config), rllib.settings
    problems = [
        Problem(f"{settings['algorithm']} has no key `{name}`", f"rllib_configs.{name}", hint=did_you_mean(name, names))
        for name in sorted(rllib.given)
        if name not in _OWN and ATTRIBUTES.get(name, name) not in names
    ]
    if problems:
        raise ConfigError(problems)
    for name, value in settings.items():
        attribute = ATTRIBUTES.get(name, name)
        if name not in _OWN and attribute in names:  # not every algorithm has the keys of this package's defaults
            setattr(config, attribute, value)


def _set_policies(
    config: AlgorithmConfig,
    settings: Mapping[str, Any],
    policies: Mapping[str, PolicySpec],
    texts: Mapping[str, Mapping[str, str]],
) -> dict[str, RLModuleSpec]:
    """Set the policies in RLlib's configuration, with their agents and their own settings; return them by name."""
    model, algorithm = settings["model_config"], settings["algorithm"]
    entry = settings.get("rl_module")
    if not policies:
        spec = _own_module(entry, model) if entry else policy_spec(model, algorithm, texts.get(SINGLE))
        config.rl_module(rl_module_spec=spec)
        return {SINGLE: spec}
    specs = {}
    for name, policy in policies.items():
        if policy.trains:
            own = {**model, **policy.config.get("model_config", {})}
            specs[name] = _own_module(entry, own) if entry else policy_spec(own, algorithm, texts.get(name))
        else:
            specs[name] = frozen_spec(policy)
    config.rl_module(rl_module_spec=MultiRLModuleSpec(rl_module_specs=specs))
    overrides = {
        name: {ATTRIBUTES.get(key, key): value for key, value in policy.config.items() if key not in _OWN}
        for name, policy in policies.items()
    }
    by_agent = {agent: policy.name for policy in policies.values() for agent in policy.agents}
    config.multi_agent(
        policies=set(policies),
        policy_mapping_fn=cast(Any, partial(_policy_of, by_agent)),
        policies_to_train=[name for name, policy in policies.items() if policy.trains],
        algorithm_config_overrides_per_module={name: own for name, own in overrides.items() if own},
    )
    return specs


def _connectors(entries: Sequence[Mapping[str, Any]], where: str, *args: Any, **kwargs: Any) -> list[ConnectorV2]:
    """Return connectors, in their order; RLlib passes the environment or the spaces as the further arguments.

    Args:
        entries: The entry `{functor: ..., config: ...}` of each connector.
        where: Path of the key, for messages.
        *args: Not used.
        **kwargs: Not used.

    Raises:
        ConfigError: There is no such class, it rejects its `config`, or it is not a connector.
    """
    kind: Any = ConnectorV2
    return [built_as(kind, "a ConnectorV2 of RLlib", entry, where) for entry in entries]


def _set_connectors(config: AlgorithmConfig, settings: Mapping[str, Any]) -> None:
    """Set the connectors that an experiment names in RLlib's configuration.

    Raises:
        ConfigError: See `_connectors`.
    """
    receivers: dict[str, Any] = {
        "env_to_module_connector": config.env_runners,
        "module_to_env_connector": config.env_runners,
        "learner_connector": config.learners,
    }
    for key, receive in receivers.items():
        if settings.get(key):
            connectors = partial(_connectors, settings[key], f"rllib_configs.{key}")
            connectors()  # raises errors here and not in RLlib's processes
            receive(**{key: connectors})


def _own_module(entry: Mapping[str, Any], model: Mapping[str, Any]) -> RLModuleSpec:
    """Return RLlib's specification of a policy of the user's own class.

    Args:
        entry: `{functor: ..., config: ...}`; the class receives the `config` in its `model_config`.
        model: The other keys of `model_config`.

    Raises:
        ConfigError: There is no such class, or it is not an `RLModule`.
    """
    kind = class_of(RLModule, "an RLModule of RLlib", entry["functor"], "rllib_configs.rl_module")
    known = DefaultModelConfig(**{key: value for key, value in model.items() if key not in FRESH_KEYS})
    return RLModuleSpec(module_class=kind, model_config={**dataclasses.asdict(known), **model, **entry["config"]})


def set_replay_buffer(config: AlgorithmConfig, buffer: Mapping[str, Any], *, several: bool) -> None:
    """Set the replay buffer of SAC or DQN, whose class is a different one for several policies.

    Args:
        config: RLlib's configuration.
        buffer: The settings of the buffer, including RLlib's defaults.
        several: Whether several policies learn.

    Raises:
        ConfigError: RLlib has no such buffer.
    """
    known = [name for name in replay_buffers.__all__ if name.endswith("EpisodeReplayBuffer")]
    kind = str(buffer["type"])
    if kind not in known:
        message, where = f"RLlib has no replay buffer of episodes `{kind}`", "rllib_configs.replay_buffer_config"
        raise ConfigError(Problem(message, where, hint=did_you_mean(kind, known)))
    if several and not kind.startswith("MultiAgent"):
        kind = f"MultiAgent{kind}"
    setattr(config, "replay_buffer_config", {**buffer, "type": kind})  # noqa: B010 - not every algorithm has it
