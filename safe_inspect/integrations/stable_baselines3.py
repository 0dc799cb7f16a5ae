"""`BatchedVecEnv`: the batch as a vector environment of Stable-Baselines3, ``pip install 'safe_inspect[sb3]'``."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices

from safe_inspect.environments.episodes import info_row
from safe_inspect.environments.facades.vector import InspectionVectorEnv
from safe_inspect.environments.registration import load_spec
from safe_inspect.types import AnyArray


class BatchedVecEnv(VecEnv):
    """N environments that step together as arrays, for Stable-Baselines3.

    Seeds and episodes are those of `safe_inspect.make_vec`. The info of an environment is empty except at the end of an
    episode, where it contains the info of the last step, ``episode`` (return ``r``, length ``l``, as from SB3's
    Monitor), ``is_success``, ``terminal_observation`` and ``TimeLimit.truncated``; therefore VecMonitor is not needed.

    Args:
        cfg: Experiment file, or id of a task, for one agent.
        num_envs: Number of environments, N.
        overrides: ``path.of.keys=value`` for each value to replace.
        seed: Seed of the first reset, unless `seed` sets one. Default: a random seed.
        gamma: See `InspectionVectorEnv`.
        render_mode: See `InspectionVectorEnv`.

    Raises:
        ConfigError: The experiment has mistakes.
        SafeInspectError: The task has several agents.
    """

    def __init__(
        self,
        cfg: str | os.PathLike[str],
        num_envs: int = 64,
        overrides: Iterable[str] = (),
        *,
        seed: int | None = None,
        gamma: float = 1.0,
        render_mode: str | None = None,
    ) -> None:
        mode = AutoresetMode.SAME_STEP
        self.environment = InspectionVectorEnv(
            load_spec(cfg, overrides), num_envs, autoreset_mode=mode, seed=seed, gamma=gamma, render_mode=render_mode
        )
        self.render_mode = render_mode
        self._actions: AnyArray = np.zeros(0)
        self._return, self._length = np.zeros(num_envs), np.zeros(num_envs, dtype=np.int64)
        super().__init__(num_envs, self.environment.single_observation_space, self.environment.single_action_space)

    def reset(self) -> AnyArray:
        """Start new episodes; return the observations, float32, shape (N, O)."""
        observations, infos = self.environment.reset(seed=self._seeds[0])
        self.reset_infos = [info_row(_values(infos), index) for index in range(self.num_envs)]
        self._return[:], self._length[:] = 0.0, 0
        self._reset_seeds()
        return observations

    def step_async(self, actions: AnyArray) -> None:
        """Store the actions of the next step, shape (N, A)."""
        self._actions = actions

    def step_wait(self) -> tuple[AnyArray, AnyArray, AnyArray, list[dict[str, Any]]]:
        """Step; return observations (N, O), rewards (N,), ends (N,) and infos."""
        observations, rewards, terminated, truncated, found = self.environment.step(self._actions)
        self._return += rewards
        self._length += 1
        done = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for index in np.flatnonzero(done).tolist():
            last = info_row(_values(found["final_info"]), index)
            infos[index] = last | {
                "episode": {"r": float(self._return[index]), "l": int(self._length[index])},
                "is_success": last["status"] == "win",
                "terminal_observation": found["final_obs"][index],
                "TimeLimit.truncated": bool(truncated[index] and not terminated[index]),
            }
        self._return[done], self._length[done] = 0.0, 0
        return observations, rewards.astype(np.float32), done, infos

    def close(self) -> None:
        """Close the batch."""
        self.environment.close()

    def get_images(self) -> Sequence[AnyArray | None]:
        """Return an image of each environment, if `render_mode` is ``rgb_array``."""
        return self.environment.render() or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of the batch, once for each environment."""
        return [getattr(self.environment, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Raise NotImplementedError, because the environments are rows of one batch."""
        raise NotImplementedError("the environments are rows of one batch; give overrides when it is made")

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **kwargs: Any
    ) -> list[Any]:
        """Raise NotImplementedError, because the environments are rows of one batch."""
        raise NotImplementedError("the environments are rows of one batch; call the method of `environment`")

    def env_is_wrapped(self, wrapper_class: type[Any], indices: VecEnvIndices = None) -> list[bool]:
        """Return False for each environment, because rows of a batch have no wrappers."""
        return [False] * len(list(self._get_indices(indices)))


def _values(infos: dict[str, Any]) -> dict[str, AnyArray]:
    """Return the infos without Gymnasium's masks."""
    return {name: array for name, array in infos.items() if not name.startswith("_")}
