"""`InspectionVectorEnv`: N environments that step together, with the interface of Gymnasium."""

from __future__ import annotations

import secrets
from numbers import Integral
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.core import BatchedEnvironment, require_one_agent
from safe_inspect.environments.decisions import DISCOUNT, decide
from safe_inspect.environments.episodes import current_infos
from safe_inspect.environments.facades.arguments import (
    action_array,
    checked_autoreset,
    checked_gamma,
    checked_slot,
    masked_rows,
)
from safe_inspect.environments.facades.rendering import RENDER_FPS, RENDER_MODE, Rendered, Rendering
from safe_inspect.environments.facades.spaces import action_space, box
from safe_inspect.environments.finite_checks import checked_seed
from safe_inspect.errors import ArgumentError, SafeInspectError
from safe_inspect.types import AnyArray, BoolArray, Observation

#: Non-zero values in the infos of a step for environments that the step resets.
_OF_RESETS = {"rta/phi_min": np.inf, DISCOUNT: 1.0}


class InspectionVectorEnv(Rendered, gymnasium.vector.VectorEnv[Observation, Observation, AnyArray]):
    """N environments that step together, each with one agent.

    Infos contain arrays of N rows: ``inspected_count``, ``inspected_fraction``, ``own_inspected_count``, ``delta_v``
    (of the episode [m/s]), ``status`` (`DoneStatus`, int8) and ``reward/NAME`` for every reward term; and for each of
    them ``_NAME``, the mask of the environments for which it is valid, shape (N,), bool.

    If actions set for how many control steps they hold (`CoastGlue`), a step is a decision of every environment; see
    `InspectionEnv`. Environments with short decisions are not stepped while they wait for the longest one.

    Args:
        spec: The task.
        num_envs: Number of environments, N.
        autoreset_mode: When to reset ended environments: at the next step (which ignores their action), within the same
            step (the last observation and info are then in ``final_obs`` and ``final_info``), or never automatically
            (call ``reset(options={"reset_mask": mask})``).
        seed: Seed of the first reset, unless that call gives one; default: a fresh seed, `np_random_seed`, is drawn.
        first_slot: Global index of the first environment slot.
        gamma: Discount per control step within a decision.
        render_mode: ``rgb_array``: `render` returns images; None: it raises an error.
    """

    def __init__(
        self,
        spec: EnvironmentSpec,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        seed: int | None = None,
        first_slot: int = 0,
        gamma: float = 1.0,
        render_mode: str | None = None,
    ) -> None:
        self._gamma = checked_gamma(gamma)
        require_one_agent(spec, "InspectionVectorEnv", "make_parallel_vec or make_parallel")
        self.num_envs = num_envs
        self.core = BatchedEnvironment(spec, num_envs, seed=seed, first_slot=checked_slot(first_slot, "first_slot"))
        self.autoreset_mode = checked_autoreset(autoreset_mode)
        self.metadata = {"render_modes": [RENDER_MODE], "render_fps": RENDER_FPS, "autoreset_mode": self.autoreset_mode}
        self.single_observation_space = box(self.core.observation_layout)
        self.single_action_space = action_space(self.core.action_layout)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._seed = seed
        self._begun = self._closed = False
        self._everyone = np.ones(num_envs, dtype=np.bool_)
        self._everyone.flags.writeable = False
        self._draw_as(render_mode, self.core.team)
        self._ended: BoolArray = np.ones(num_envs, dtype=np.bool_)
        self._observation = np.zeros(self.observation_space.shape or (), dtype=np.float32)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start new episodes in all environments, or in those of ``options["reset_mask"]``.

        Args:
            seed: Restart with the first episodes of this seed. A list must be of the form that Gymnasium makes of one
                seed, seed + index.
            options: ``reset_mask`` of shape (N,), bool.

        Raises:
            ArgumentError: An option is unknown, the mask has the wrong shape or type, or both a mask and a seed are
                given.
            SafeInspectError: A mask is given before the first reset.
        """
        one = _one(seed, self.num_envs)
        rows = masked_rows(options, self.num_envs, one, self._begun)
        if rows is None:
            if one is None and not self._begun:
                one = secrets.randbits(64) if self._seed is None else self._seed
            super().reset(seed=None if one is None else checked_seed(one))
            self._observation = self.core.reset(seed=one)[:, 0]
            self._ended = np.zeros(self.num_envs, dtype=np.bool_)
            self._begun, self._closed = True, False
            if self._view is not None:
                self._view.begin()
        else:
            self._begin(rows)
        began = self._everyone if rows is None else np.isin(np.arange(self.num_envs), rows)
        return self._observation.copy(), self._masked(self._now()) | self._drawn(began)

    def step(self, actions: Observation) -> tuple[Observation, AnyArray, BoolArray, BoolArray, dict[str, Any]]:
        """Hold the actions for one step; ended environments are reset as `autoreset_mode` says.

        Args:
            actions: Actions, shape (N, A); clipped to their bounds unless they are discrete.

        Raises:
            ArgumentError: A discrete action is a fraction or out of range, or the actions have the wrong shape.
            SafeInspectError: No episode has started, or an environment that has ended is stepped in the mode
                ``DISABLED``.
        """
        if not self._begun or self._closed:
            what = "the environments were closed" if self._closed else "no episode has begun"
            raise SafeInspectError(f"{what}; call reset() first")
        ended = self._ended.copy()  # a copy, since a reset below clears the flags in place
        if ended.any() and self.autoreset_mode is not AutoresetMode.NEXT_STEP:
            raise SafeInspectError(
                f"the episodes of the environments {np.flatnonzero(ended)[:8].tolist()} are over; reset them first"
            )
        actions, mistake = action_array(actions, self.action_space.shape)
        if mistake:
            raise ArgumentError(f"the array of actions {mistake}")
        if ended.any():
            actions = np.where(ended[:, None], np.float32(0.0), actions)  # their action is ignored
        follow = None if self._view is None else self._view.follow
        decided = decide(self.core.team, (actions[:, None],), self._gamma, ended, follow)
        (transition,), (info,) = decided.groups, decided.infos
        self._observation = transition.observation[:, 0]
        reward = transition.reward[:, 0]
        terminated, truncated = transition.terminated[:, 0].copy(), transition.truncated[:, 0].copy()
        if ended.any():  # NEXT_STEP: this step is their reset
            self._begin(np.flatnonzero(ended))
            reward[ended], terminated[ended], truncated[ended] = 0.0, False, False
            fresh = self._now()
            for name, array in info.items():
                array[ended] = fresh[name][ended] if name in fresh else _OF_RESETS.get(name, 0.0)
        infos = self._masked(info) | (self._drawn(ended) if ended.any() else {})
        self._ended = terminated | truncated
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            rows, mask = np.flatnonzero(self._ended), self._ended.copy()
            if len(rows):
                final = np.full(self.num_envs, None, dtype=object)
                for index in rows:
                    final[index] = self._observation[index].copy()
                infos = {"final_obs": final, "final_info": dict(infos), "_final_obs": mask, "_final_info": mask} | infos
                self._begin(rows)
                infos |= self._now()
            infos |= self._drawn(mask)  # TorchRL needs the names of the first reset in every step
        return self._observation.copy(), reward, terminated, truncated, infos

    def _pictures(self, view: Rendering) -> Any:
        return tuple(view.picture(row) for row in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """End the episodes."""
        self._closed = True

    def _now(self) -> dict[str, AnyArray]:
        """Return the infos of the current state."""
        (info,) = current_infos(self.core.team)
        return info

    def _masked(self, infos: dict[str, Any], rows: BoolArray | None = None) -> dict[str, Any]:
        """Return infos with a mask ``_NAME`` for each, as Gymnasium does: the environments for which it is valid."""
        mask = self._everyone if rows is None else rows.copy()
        return infos | {f"_{name}": mask for name in infos}

    def _drawn(self, rows: BoolArray) -> dict[str, AnyArray]:
        """Return the reset statistics of the current episodes of some environments, each of shape (N,)."""
        drawn = {name: array.copy() for name, array in self.core.simulation.reset_info.items()}
        return self._masked(drawn, rows)

    def _begin(self, rows: NDArray[np.int64]) -> None:
        if len(rows):
            self._observation[rows] = self.core.reset(rows)[:, 0]
            if self._view is not None:
                self._view.begin(rows)
            self._ended[rows] = False


def _one(seed: int | list[int | None] | tuple[int | None, ...] | AnyArray | None, num_envs: int) -> int | None:
    """Return the single seed of all environments.

    Raises:
        ArgumentError: A list is not of the form that Gymnasium makes of one seed.
    """
    if not isinstance(seed, list | tuple | np.ndarray):
        return seed
    if len(seed) != num_envs:
        raise ArgumentError(f"reset: {len(seed)} seeds are given for {num_envs} environments; give one number for all")
    first = seed[0]
    if not isinstance(first, Integral) or any(value != first + index for index, value in enumerate(seed)):
        raise ArgumentError(
            "reset: one seed serves all environments; give a number, from which each slot derives its own stream"
        )
    return int(first)
