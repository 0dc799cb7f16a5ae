"""RLlib objects that an experiment names: connectors, an RLModule and a replay buffer. Importing this loads Ray."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ray.rllib.connectors.connector_v2 import ConnectorV2
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.rllib.core.rl_module.rl_module import RLModule, RLModuleSpec
from ray.rllib.utils import replay_buffers

from safe_inspect.config.keys.rllib_keys import FRESH_KEYS
from safe_inspect.errors import ConfigError, Problem, did_you_mean
from safe_inspect.experiments.settings.objects import built_as, mistake, named

if TYPE_CHECKING:
    from ray.rllib.algorithms.algorithm_config import AlgorithmConfig


class ConnectorsOf:
    """Function that creates connectors, for RLlib, which passes the environment or the spaces.

    Args:
        entries: The entry `{functor: ..., config: ...}` of each connector.
        where: Path of the key, for messages.
    """

    def __init__(self, entries: Sequence[Mapping[str, Any]], where: str) -> None:
        self._entries, self._where = list(entries), where

    def __call__(self, *args: Any, **kwargs: Any) -> list[ConnectorV2]:
        """Return the connectors, in their order.

        Raises:
            ConfigError: There is no such class, it rejects its `config`, or it is not a connector.
        """
        kind: Any = ConnectorV2
        return [built_as(kind, "a ConnectorV2 of RLlib", entry, self._where) for entry in self._entries]


def set_connectors(config: AlgorithmConfig, settings: Mapping[str, Any]) -> None:
    """Set the connectors that an experiment names in RLlib's configuration.

    Raises:
        ConfigError: See `ConnectorsOf`.
    """
    receivers: dict[str, Any] = {
        "env_to_module_connector": config.env_runners,
        "module_to_env_connector": config.env_runners,
        "learner_connector": config.learners,
    }
    for key, receive in receivers.items():
        if settings.get(key):
            connectors = ConnectorsOf(settings[key], f"rllib_configs.{key}")
            connectors()  # raises errors here and not in RLlib's processes
            receive(**{key: connectors})


def own_module(entry: Mapping[str, Any], model: Mapping[str, Any]) -> RLModuleSpec:
    """Return RLlib's specification of a policy of the user's own class.

    Args:
        entry: `{functor: ..., config: ...}`; the class receives the `config` in its `model_config`.
        model: The other keys of `model_config`.

    Raises:
        ConfigError: There is no such class, or it is not an `RLModule`.
    """
    where = "rllib_configs.rl_module"
    kind = named(entry["functor"], where)
    if not isinstance(kind, type) or not issubclass(kind, RLModule):
        raise mistake(f"{entry['functor']!r} is not an RLModule of RLlib", where)
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
