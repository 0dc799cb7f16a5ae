"""The batched environment as RLlib's stock runner sees it: the only place where RLlib meets the simulator.

RLlib asks a registered creator for a `gymnasium.vector.VectorEnv` and hands it the number of
environments, but not the index of the runner. So the environment is placed afterwards, by
`TrainingEnv.place` in a callback, and then takes the slots of its runner.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from gymnasium.vector import VectorEnv as _VectorEnv

from safe_inspect.errors import SafeInspectError
from safe_inspect.types import AnyArray, FloatArray

#: The name under which RLlib knows the environment, in checkpoints too.
ENVIRONMENT = "safe_inspect"

VectorEnv: TypeAlias = _VectorEnv[Any, Any, Any]

#: Builds the environments from the resolved configuration, the number, the seed and the first slot.
EnvironmentMaker: TypeAlias = Callable[[Mapping[str, Any], int, int, int], VectorEnv]

#: The maker of this package's own environments.
DEFAULT_MAKER = "safe_inspect.experiments.environment:make_environment"

_TERM = "reward/"
_FACTS = ("delta_v", "inspected_count", "inspected_fraction", "interventions")
_WIN, _LOSE = 1, 2


def make_environment(experiment: Mapping[str, Any], num_envs: int, seed: int, first_slot: int) -> VectorEnv:
    """Build the batched environment of a resolved configuration."""
    from safe_inspect.environments import InspectionVectorEnv, build_spec

    return InspectionVectorEnv(
        build_spec(experiment), num_envs, seed=seed, first_slot=first_slot, autoreset_mode=AutoresetMode.NEXT_STEP
    )


def find_maker(path: str) -> EnvironmentMaker:
    """Return the function that ``module:function`` names."""
    module, _, function = path.partition(":")
    maker: EnvironmentMaker = getattr(importlib.import_module(module), function)
    return maker


def first_slot(worker_index: int, num_envs: int) -> int:
    """Return the global index of a runner's first environment slot.

    Remote runners count from 1, and runner w has the slots (w - 1) M to w M - 1; a local runner, which
    samples only where there is no remote one, has the first slots.
    """
    return max(worker_index - 1, 0) * num_envs


def stream_seed(seed: int, attempt: int = 0, evaluation: bool = False) -> int:
    """Return the seed of the environments, 0 to 2**64 - 1.

    The first attempt trains with the seed of the run. Episodes of the evaluation and of a resumed
    run, whose slots count their episodes from 0 again, come from other seeds.
    """
    number = 2 * attempt + int(evaluation)
    if number == 0:
        return seed % 2**64
    # The finaliser of SplitMix64, so that neighbouring runs do not share seeds.
    mixed = (seed + number * 0x9E3779B97F4A7C15) % 2**64
    mixed = ((mixed ^ (mixed >> 30)) * 0xBF58476D1CE4E5B9) % 2**64
    mixed = ((mixed ^ (mixed >> 27)) * 0x94D049BB133111EB) % 2**64
    return mixed ^ (mixed >> 31)


class TrainingEnv(_VectorEnv[Any, Any, Any]):
    """A batched environment that reports each episode once, at its end.

    RLlib turns infos into one dict for each environment and step, which costs more than the
    physics. So the infos hold one key, ``episode``, only in a step in which an episode ends:
    a row of the values that `episode_fields` names.

    Args:
        config: RLlib's environment configuration, see `safe_inspect.experiments.algorithm`.
        num_envs: Number of environments.
    """

    def __init__(self, config: Mapping[str, Any], num_envs: int) -> None:
        self._config = dict(config)
        self._maker = find_maker(self._config.get("maker", DEFAULT_MAKER))
        self._where = (0, False)
        self.env = self._make(num_envs, *self._where)
        mode = self.env.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.NEXT_STEP:
            raise ValueError(f"RLlib's runner wants environments that reset in the next step, not {mode}")
        self.num_envs = num_envs
        self.metadata = self.env.metadata
        self.single_observation_space = self.env.single_observation_space
        self.single_action_space = self.env.single_action_space
        self.observation_space = self.env.observation_space
        self.action_space = self.env.action_space
        if not isinstance(self.single_action_space, Box):
            raise ValueError(f"the action space is to be a Box, not {self.single_action_space}")
        self._low, self._high = self.single_action_space.low, self.single_action_space.high
        self._known = False
        self._facts: tuple[str, ...] = ()
        self._terms: tuple[str, ...] = ()
        self._sums: FloatArray = np.zeros((0, num_envs))
        self._ended = np.zeros(num_envs, dtype=bool)

    def place(self, worker_index: int, evaluation: bool) -> None:
        """Take the slots of a runner; call it before the first reset."""
        where = (first_slot(worker_index, self.num_envs), evaluation)
        if where != self._where:
            self.env.close()
            self._where = where
            self.env = self._make(self.num_envs, *where)

    @property
    def episode_fields(self) -> tuple[str, ...]:
        """Names of the values in a row of ``infos["episode"]``; known after the first step."""
        return ("success", "lost", *self._facts, *self._terms)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[AnyArray, dict[str, Any]]:
        """Begin a new episode in every slot.

        RLlib's seed is not used: the episodes are functions of the run's seed, the slot and the episode.
        """
        with _Reported(self._config):
            observations, _ = self.env.reset(options=options)
        self._sums[:] = 0.0
        self._ended[:] = False
        return observations, {}

    def step(self, actions: AnyArray) -> tuple[AnyArray, FloatArray, AnyArray, AnyArray, dict[str, Any]]:
        """Clip the actions and take a step."""
        actions = np.clip(np.asarray(actions, dtype=self.single_action_space.dtype), self._low, self._high)
        with _Reported(self._config):
            observations, rewards, terminated, truncated, infos = self.env.step(actions)
        if not self._known:
            self._known = True
            self._facts = tuple(name for name in _FACTS if name in infos)
            self._terms = tuple(sorted(key for key in infos if key.startswith(_TERM)))
            self._sums = np.zeros((len(self._terms), self.num_envs))
        for row, term in zip(self._sums, self._terms, strict=True):
            row += infos[term]
        self._sums[:, self._ended] = 0.0  # this step was the reset after an episode's end
        self._ended = terminated | truncated
        if not self._ended.any():
            return observations, rewards, terminated, truncated, {}
        return observations, rewards, terminated, truncated, {"episode": self._rows(infos), "_episode": self._ended}

    def close_extras(self, **kwargs: Any) -> None:
        """Close the environments."""
        if hasattr(self, "env"):  # not when their building has failed
            self.env.close(**kwargs)

    def _make(self, num_envs: int, slot: int, evaluation: bool) -> VectorEnv:
        seed = stream_seed(self._config.get("seed", 0), self._config.get("attempt", 0), evaluation)
        with _Reported(self._config):
            return self._maker(self._config["experiment"], num_envs, seed, slot)

    def _rows(self, infos: Mapping[str, Any]) -> FloatArray:
        status = np.asarray(infos["status"])
        columns = [status == _WIN, status == _LOSE, *(infos[key] for key in self._facts), *self._sums]
        return np.array([np.asarray(column, dtype=np.float64) for column in columns]).T.copy()


def register(maker: str = DEFAULT_MAKER) -> None:
    """Tell RLlib how to create the environment; needed in each process that builds or restores an algorithm."""
    from ray.tune.registry import register_env

    def create(config: Mapping[str, Any]) -> VectorEnv:
        rest = {key: value for key, value in config.items() if key != "num_envs"}
        return TrainingEnv({"maker": maker, **rest}, int(config.get("num_envs", 1)))

    register_env(ENVIRONMENT, create)


class _Reported:
    """Leaves a user's error in a file, because RLlib's remote runners end without passing it on."""

    def __init__(self, config: Mapping[str, Any]) -> None:
        self._file = config.get("failure_file")

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        if self._file and isinstance(error, SafeInspectError):
            Path(self._file).write_text(json.dumps({"error": type(error).__name__, "message": str(error)}))
