"""How RLlib knows the environments by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ray.tune.registry import register_env

from safe_inspect.experiments.adapters.environment import DEFAULT_MAKER
from safe_inspect.experiments.adapters.multi_agent_env import TeamMultiAgentEnv
from safe_inspect.experiments.adapters.training_env import TrainingEnv

#: The name under which RLlib knows the environment, in checkpoints too.
ENVIRONMENT = "safe_inspect"


def register_environments(maker: str = DEFAULT_MAKER) -> None:
    """Tell RLlib how to create the environment; needed in each process that builds or restores an algorithm."""

    def create(config: Mapping[str, Any]) -> Any:
        """Create what RLlib's stock runner takes; the batched runner builds its environments itself."""
        rest = {"maker": maker} | {key: value for key, value in config.items() if key != "num_envs"}
        if rest.get("several"):
            return TeamMultiAgentEnv(rest)
        return TrainingEnv(rest, int(config.get("num_envs", 1)))

    register_env(ENVIRONMENT, create)
