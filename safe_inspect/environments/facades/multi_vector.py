"""`MultiAgentVectorEnv`: façade of the batch with all controlled agents, as dictionaries of arrays."""

from __future__ import annotations

import secrets
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.decisions import decide
from safe_inspect.environments.episodes import current_infos, team_info
from safe_inspect.environments.facades.arguments import (
    checked_autoreset,
    checked_gamma,
    checked_slot,
    masked_rows,
)
from safe_inspect.environments.facades.spaces import AgentsByName, checked_actions
from safe_inspect.environments.finite_checks import checked_seed
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.errors import SafeInspectError
from safe_inspect.types import AnyArray, BoolArray

ByAgent: TypeAlias = dict[str, AnyArray]


class MultiAgentVectorEnv:
    """N environments of one or more agents that step together.

    Inputs and outputs are dictionaries by agent of arrays with N rows. The agents are the controlled ones, whose
    actions the caller gives. An agent that has ended while other agents of its environment continue remains in the
    arrays. Its row is then meaningless: its reward is 0, it does not end a second time, and its action may be anything.
    When an episode is over for all agents, the environment is reset as `autoreset_mode` says.

    Infos contain:

    - ``active``, by agent, shape (N,): whether the agent acts in the next step;
    - the values of `InspectionEnv` under the same names, each by agent, shape (N,), with ``status`` as a number
      (`DoneStatus`);
    - ``team/NAME`` for each value of `team_info`, shape (N,), and the statistics of the reset that started the
      episodes;
    - in the mode ``SAME_STEP``, in a step in which episodes were over: ``final_obs``, by agent, and ``final_info``,
      both from before the reset, and the masks ``_final_obs`` and ``_final_info`` of these environments, shape (N,).

    If actions set for how many control steps they hold, a step lasts in each environment until one of its agents needs
    a new decision; see `InspectionParallelEnv`.

    Args:
        spec: The task.
        num_envs: Number of environments, N.
        autoreset_mode: When to reset environments whose episode is over for all agents: within the same step
            (``SAME_STEP``), or never automatically (``DISABLED``; call ``reset(options={"reset_mask": mask})``).
        seed: Seed of the first reset, unless that call gives one; default: a fresh seed is drawn.
        first_slot: Global index of the first environment slot.
        gamma: Discount per control step within a decision.

    Attributes:
        agents: Names of the agents, in order.
        single_observation_spaces: Space of one observation, by agent.
        single_action_spaces: Space of one action, by agent.
        observation_spaces: Space of the observations of N environments, by agent.
        action_spaces: Space of the actions of N environments, by agent.
        np_random_seed: The seed of the episodes; None before the first reset.
    """

    def __init__(
        self,
        spec: EnvironmentSpec,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        seed: int | None = None,
        first_slot: int = 0,
        gamma: float = 1.0,
    ) -> None:
        self._gamma = checked_gamma(gamma)
        self.autoreset_mode = checked_autoreset(autoreset_mode)
        if self.autoreset_mode is AutoresetMode.NEXT_STEP:
            raise ValueError("environments with several agents support the autoreset modes SAME_STEP and DISABLED only")
        self.core = TeamEnvironment(spec, num_envs, seed=seed, first_slot=checked_slot(first_slot, "first_slot"))
        self.num_envs = num_envs
        self._seed = seed
        self.np_random_seed: int | None = None
        self.metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": self.autoreset_mode}
        self._controlled = AgentsByName(self.core)
        self.agents = tuple(self._controlled.places)
        self.single_observation_spaces = self._controlled.observation_spaces
        self.single_action_spaces = self._controlled.action_spaces
        self.observation_spaces = {
            agent: batch_space(space, num_envs) for agent, space in self.single_observation_spaces.items()
        }
        self.action_spaces = {agent: batch_space(space, num_envs) for agent, space in self.single_action_spaces.items()}
        self._shapes = {agent: (num_envs, *space.shape) for agent, space in self.single_action_spaces.items()}
        self._observations: list[AnyArray] = []
        self._over: BoolArray = np.zeros(num_envs, dtype=np.bool_)

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[ByAgent, dict[str, Any]]:
        """Start new episodes in all environments, or in those of ``options["reset_mask"]``.

        Args:
            seed: Restart with the first episodes of this seed.
            options: ``reset_mask`` of shape (N,), bool.

        Returns:
            Observations by agent, float32, each of shape (N, O), and infos.

        Raises:
            ArgumentError: An option is unknown, the mask has the wrong shape or type, or both a mask and a seed are
                given.
            SafeInspectError: A mask is given before the first reset.
        """
        rows = masked_rows(options, self.num_envs, seed, bool(self._observations))
        if rows is None:
            if seed is None and self.np_random_seed is None:
                seed = secrets.randbits(64) if self._seed is None else self._seed
            if seed is not None:
                self.np_random_seed = checked_seed(seed)
            self._observations = list(self.core.reset(seed=seed))
            self._over = np.zeros(self.num_envs, dtype=np.bool_)
        else:
            self._begin(rows)
        return self._controlled.split(self._observations), self._now()

    def step(self, actions: Mapping[str, AnyArray]) -> tuple[ByAgent, ByAgent, ByAgent, ByAgent, dict[str, Any]]:
        """Hold the actions for one step.

        Args:
            actions: Actions of all agents, each of shape (N, A); clipped to their bounds unless they are discrete.

        Returns:
            Observations (N, O), rewards (N,), terminations (N,) and truncations (N,), each by agent, and infos.

        Raises:
            ArgumentError: A discrete action is a fraction or out of range.
            SafeInspectError: No episode has started; an environment that is over is stepped in the mode ``DISABLED``;
                or an action is missing, has the wrong shape, or is for an agent that does not act.
        """
        if not self._observations:
            raise SafeInspectError("no episode has begun; call reset() first")
        if np.count_nonzero(self._over):
            rows = np.flatnonzero(self._over)[:8].tolist()
            raise SafeInspectError(f"the episodes of the environments {rows} are over; reset them first")
        stacked = self._stacked(checked_actions(actions, self.agents, self._shapes))
        decided, split = decide(self.core, stacked, self._gamma), self._controlled.split
        found, over, infos = decided.groups, decided.over, self._infos(decided.infos)
        self._observations, self._over = [group.observation for group in found], over
        if self.autoreset_mode is AutoresetMode.SAME_STEP and np.count_nonzero(over):
            final = {"final_obs": split(self._observations), "final_info": infos}
            self._begin(np.flatnonzero(over))
            infos = infos | self._now() | final | {"_final_obs": over, "_final_info": over.copy()}
        return (
            split(self._observations),
            split([group.reward for group in found]),
            split([group.terminated for group in found]),
            split([group.truncated for group in found]),
            infos,
        )

    def close(self) -> None:
        """End the episodes; there is nothing to release."""
        self._observations = []

    def _stacked(self, actions: Mapping[str, AnyArray]) -> list[AnyArray]:
        """Return the actions of every acting group, shape (N, G, A), 0 for agents that have ended."""
        active = self.core.state.finished == 0
        everyone = np.count_nonzero(active) == active.size
        stacked = []
        for group in self.core.acting:
            array = np.stack([actions[agent] for agent in group.agents], axis=1)
            if not everyone:
                array = np.where(active[:, group.members, None], array, 0.0)
            stacked.append(array)
        return stacked

    def _begin(self, rows: NDArray[np.int64]) -> None:
        """Start new episodes in some rows; arrays that were returned to the caller are not changed."""
        self._observations = [observation.copy() for observation in self._observations]
        self._over = self._over.copy()
        if len(rows):
            for observation, fresh in zip(self._observations, self.core.reset(rows), strict=True):
                observation[rows] = fresh
            self._over[rows] = False

    def _now(self) -> dict[str, Any]:
        """Return the infos of the current state."""
        return self._infos(current_infos(self.core))

    def _infos(self, groups: Sequence[Mapping[str, AnyArray]]) -> dict[str, Any]:
        active = self.core.state.finished == 0
        split = self._controlled.split
        infos: dict[str, Any] = {"active": split([active[:, group.members] for group in self.core.acting])}
        for group, found in zip(self.core.acting, groups, strict=True):
            for name, array in found.items():
                rows = array.reshape(self.num_envs, group.size)
                infos.setdefault(name, {}).update({agent: rows[:, k] for k, agent in enumerate(group.agents)})
        infos |= {f"team/{name}": array for name, array in team_info(self.core).items()}
        return infos | {name: array.copy() for name, array in self.core.simulation.reset_info.items()}
