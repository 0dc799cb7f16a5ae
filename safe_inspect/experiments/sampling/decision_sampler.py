"""`DecisionSampler`: a `Sampler` for decisions that last several steps; it calls a policy only for new decisions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition, Transition
from safe_inspect.experiments.sampling.policy_net import LEAST_ROWS, PolicyNet
from safe_inspect.experiments.sampling.rollout import DecisionRollout
from safe_inspect.experiments.sampling.sampler import AgentSlot, Rows, Sampler
from safe_inspect.types import AnyArray, BoolArray, IntArray

_ROOM = 32  # decisions of each agent for which a rollout has room at first


class DecisionSampler(Sampler):
    """Sampler that steps all environments at every control step and stores decisions: a semi-Markov process.

    The reward of a decision of k control steps is sum gamma^i r_i over them. The agents decide at different times. A
    decision that has not elapsed when a call ends is stored by the next call, once it has elapsed.

    Args:
        environment: See `Sampler`.
        slots: See `Sampler`.
        nets: See `Sampler`.
        gamma: Discount of a control step.
        seed: See `Sampler`.
        first_slot: See `Sampler`.
    """

    def __init__(
        self,
        environment: TeamEnvironment,
        slots: tuple[AgentSlot, ...],
        nets: Callable[[str, int], PolicyNet],
        *,
        gamma: float,
        seed: int,
        first_slot: int,
    ) -> None:
        super().__init__(environment, slots, nets, seed=seed, first_slot=first_slot)
        environment.observes_coasting = False
        self._gamma = gamma
        self._make_net = nets
        self._sized: dict[tuple[str, int], PolicyNet] = {}
        shape = (len(slots), environment.num_envs)
        self._rewards, self._discounts = np.zeros(shape), np.ones(shape)
        self._elapsed: IntArray = np.zeros(shape, dtype=np.int64)
        self._decisions: IntArray = np.zeros(shape, dtype=np.int64)
        self._pending: list[dict[str, AnyArray]] = []

    def reset(self) -> None:
        """Start a new episode in every environment."""
        super().reset()
        self._pending = []
        self._decisions[:] = 0

    def roll(self, steps: int, explore: bool = True) -> Any:
        """Take a number of control steps in every environment; see `Sampler.roll`."""
        rollout: Any = super().roll(steps, explore)
        self._pending = [track.pending() for track in rollout.tracks]
        return rollout

    def _rollout(self, steps: int, wanted: IntArray | None = None) -> DecisionRollout:
        rollout = DecisionRollout(self._sizes, _ROOM, self._step.copy(), self._flying.copy(), wanted)
        for track, pending in zip(rollout.tracks, self._pending, strict=False):
            track.resume(pending)
        return rollout

    def _advance(self, rollout: DecisionRollout, time: int, explore: bool) -> None:
        starting = self._starting()
        self._decisions += starting
        self._rewards[starting], self._discounts[starting], self._elapsed[starting] = 0.0, 1.0, 0
        super()._advance(rollout, time, explore)

    def _starting(self) -> BoolArray:
        """Return a mask of the agents that decide now, shape (K, N)."""
        return np.concatenate([due.T for due in self.environment.due()]) & self._flying

    def _observe(self, rollout: DecisionRollout, time: int) -> Sequence[Rows]:
        starting = self._starting()
        for track, observation, agents in zip(rollout.tracks, self._observations, self._members, strict=True):
            _write(track.observations, starting[agents], track.counts, observation.transpose(1, 0, 2))
        return [np.flatnonzero(own) for own in starting]

    def _store(self, rollout: DecisionRollout, group: int, time: int, found: Transition) -> None:
        """Store the decisions of a group that end with this step."""
        track, agents = rollout.tracks[group], self._members[group]
        self._rewards[agents] += self._discounts[agents] * found.reward.T
        self._discounts[agents] *= self._gamma
        self._elapsed[agents] += 1
        ended = (found.terminated | found.truncated).T
        closes = self._flying[agents] & (self.environment.due()[group].T | ended)
        _write(track.rewards, closes, track.counts, self._rewards[agents])
        _write(track.steps, closes, track.counts, self._elapsed[agents])
        track.counts += closes
        _write(track.observations, ended, track.counts, found.observation.transpose(1, 0, 2))
        self._flying[agents] &= ~ended

    def _net_for(self, policy: str, rows: int) -> PolicyNet:
        """Return a policy's net for at least `rows` rows; its size is the next power of two."""
        size = LEAST_ROWS
        while size < rows:
            size *= 2
        if (policy, size) not in self._sized:
            self._sized[policy, size] = self._make_net(policy, size)
        return self._sized[policy, size]

    def _time_of(self, track: Any, member: int, rows: Rows, time: int) -> IntArray:
        counts: IntArray = track.counts[member, rows]
        return counts

    def _begin_again(self, rollout: Any, time: int, transition: TeamTransition) -> list[int]:
        rows = np.flatnonzero(transition.over)
        decisions = self._decisions[:, rows].mean(axis=0)
        before = len(self.reports)
        kept = super()._begin_again(rollout, time, transition)
        for report, mean in zip(self.reports[before:], decisions[np.isin(rows, kept)].tolist(), strict=True):
            report["decisions"] = mean
        self._decisions[:, rows] = 0
        return kept


def _write(target: AnyArray, mask: BoolArray, index: IntArray, values: AnyArray) -> None:
    """Write target[g, n, index[g, n]] = values[g, n] where a mask of shape (G, N) is true."""
    agents, rows = np.nonzero(mask)
    target[agents, rows, index[agents, rows]] = values[agents, rows]
