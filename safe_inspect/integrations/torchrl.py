"""`team_env`: several deputies as an environment of TorchRL; one deputy needs no adapter.

Install with ``pip install 'safe_inspect[torchrl]'``. For one deputy, pass
``safe_inspect.make_vec(task, num_envs, autoreset_mode="Disabled")`` to TorchRL's `GymWrapper`, which resets by a mask,
as that mode requires.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from numbers import Number
from typing import Any

from pettingzoo.utils.wrappers import BaseParallelWrapper
from torchrl.envs import PettingZooWrapper

from safe_inspect.environments.facades.parallel import InspectionParallelEnv
from safe_inspect.environments.registration import load_spec

_ByAgent = dict[str, Any]


class _NumericInfos(BaseParallelWrapper[str, Any, Any]):  # type: ignore[misc]
    """A PettingZoo environment whose infos contain the same numbers after a reset and a step, and no other values.

    TorchRL converts infos to tensors, and takes their names from the first reset. Therefore an info contains the
    numbers of a reset, without statistics of its sampling.
    """

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[_ByAgent, _ByAgent]:
        """Start a new episode."""
        observations, infos = super().reset(seed=seed, options=options)
        self._names = {
            agent: [name for name, value in info.items() if isinstance(value, Number) and "/" not in name]
            for agent, info in infos.items()
        }
        return observations, self._numbers(infos)

    def step(self, actions: _ByAgent) -> tuple[_ByAgent, _ByAgent, _ByAgent, _ByAgent, _ByAgent]:
        """Apply the actions for one step."""
        observations, rewards, terminated, truncated, infos = super().step(actions)
        return observations, rewards, terminated, truncated, self._numbers(infos)

    def _numbers(self, infos: _ByAgent) -> _ByAgent:
        return {agent: {name: info[name] for name in self._names[agent]} for agent, info in infos.items()}


def team_env(
    cfg: str | os.PathLike[str], overrides: Iterable[str] = (), *, gamma: float = 1.0, **kwargs: Any
) -> PettingZooWrapper:
    """Return one environment with several deputies, grouped as by `PettingZooWrapper`.

    Args:
        cfg: Experiment file, or id of a task.
        overrides: ``path.of.keys=value`` for each value to replace.
        gamma: See `InspectionParallelEnv`.
        **kwargs: Arguments of `PettingZooWrapper`, such as `group_map`.

    Raises:
        ConfigError: The experiment has mistakes.
    """
    environment = _NumericInfos(InspectionParallelEnv(load_spec(cfg, overrides), gamma=gamma))
    return PettingZooWrapper(environment, **kwargs)
