"""`DecisionSampler`: a `Sampler` for decisions that last several steps; it calls a policy only for new decisions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition
from safe_inspect.experiments.sampling.decision_rollout import DecisionRollout, DecisionTrack
from safe_inspect.experiments.sampling.policy_net import LEAST_ROWS, PolicyNet
from safe_inspect.experiments.sampling.sampler import AgentSlot, Sampler
from safe_inspect.random.action_draws import DrawRows
from safe_inspect.types import AnyArray, BoolArray, IntArray


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

    def roll(self, steps: int, explore: bool = True, random: bool = False, lifetime: int = 0) -> Any:
        """Take a number of control steps in every environment; see `Sampler.roll`."""
        rollout = DecisionRollout(self._sizes, self._step.copy())
        for track, pending in zip(rollout.tracks, self._pending, strict=False):
            track.resume(pending)
        for time in range(steps):
            self._advance(rollout, time, explore, random, lifetime + time * self.environment.num_envs)
        for track, observation, starts in zip(rollout.tracks, self._observations, self._starting(), strict=True):
            _write(track.observations, starts, track.counts, observation.transpose(1, 0, 2))
        rollout.close(steps)
        self._pending = [track.pending() for track in rollout.tracks]
        return rollout

    def roll_episodes(self, count: int, explore: bool = True, random: bool = False, lifetime: int = 0) -> Any:
        """Sample whole episodes; see `Sampler.roll_episodes`."""
        self.reset()
        envs = self.environment.num_envs
        rollout = DecisionRollout(self._sizes, self._step.copy(), count // envs + (np.arange(envs) < count % envs))
        time = 0
        while rollout.missing:
            self._advance(rollout, time, explore, random, lifetime + time * envs)
            time += 1
        return rollout

    def _advance(self, rollout: Any, time: int, explore: bool, random: bool, lifetime: int) -> None:
        starting = self._starting()
        for track, observation, starts in zip(rollout.tracks, self._observations, starting, strict=True):
            track.reserve()
            _write(track.observations, starts, track.counts, observation.transpose(1, 0, 2))
        flags = np.concatenate(starting)
        self._decisions += flags
        self._rewards[flags], self._discounts[flags], self._elapsed[flags] = 0.0, 1.0, 0
        if random:
            self._draw_at_random(rollout, starting)
        else:
            self._decide(rollout, flags, explore, lifetime)
        transition = self.environment.step(self._actions)
        self._step += 1
        self._sums.add(transition)
        due = self.environment.due()
        self._elapsed += 1
        first = 0
        self._observations = []
        for track, where, again in zip(rollout.tracks, self._where, due, strict=True):
            found = transition.groups[where]
            self._observations.append(found.observation)
            mine = slice(first, first + len(track.rewards))
            self._rewards[mine] += self._discounts[mine] * found.reward.T
            self._discounts[mine] *= self._gamma
            ended = (found.terminated | found.truncated).T
            flying = self._flying[mine]
            self._keep(track, mine, flying & (again.T | ended))
            if np.count_nonzero(ended):
                rollout.end(first, found.terminated.T, found.truncated.T)
                _write(track.observations, ended, track.counts, found.observation.transpose(1, 0, 2))
                flying &= ~ended
            first += len(track.rewards)
        if np.count_nonzero(transition.over):
            self._begin_again(rollout, time, transition)

    def _starting(self) -> list[BoolArray]:
        """Return for each group a mask of the agents that decide now, shape (G, N)."""
        found, first = [], 0
        for due in self.environment.due():
            found.append(due.T & self._flying[first : first + due.shape[1]])
            first += due.shape[1]
        return found

    def _keep(self, track: DecisionTrack, mine: slice, closes: BoolArray) -> None:
        """Store the decisions of a group that end with this step, given as a mask of shape (G, N)."""
        _write(track.rewards, closes, track.counts, self._rewards[mine])
        _write(track.steps, closes, track.counts, self._elapsed[mine])
        track.counts += closes

    def _decide(self, rollout: DecisionRollout, starting: BoolArray, explore: bool, lifetime: int) -> None:
        episodes = self.environment.simulation.episodes
        for policy, indices in self._slots_by_policy.items():
            chosen = [np.flatnonzero(starting[index]) for index in indices]
            total = sum(map(len, chosen))
            if not total:
                continue
            net = self._net_for(policy, total)
            place = 0
            for index, rows in zip(indices, chosen, strict=True):
                slot = self.agent_slots[index]
                net.observations[place : place + len(rows)] = self._observations[slot.group][rows, slot.member]
                place += len(rows)
            inputs, place = net(explore, lifetime), 0
            for index, rows in zip(indices, chosen, strict=True):
                slot = self.agent_slots[index]
                track, member = rollout.tracks[slot.group], slot.member
                mine = inputs[place : place + len(rows)]
                place += len(rows)
                draws = DrawRows(
                    self._seed, self._slots[rows], episodes[rows], self._step[rows], self._deputies[index][rows]
                )
                action = np.empty((len(rows), track.actions.shape[3]), dtype=np.float32)
                log_probability = np.empty(len(rows), dtype=np.float32)
                self._distributions[slot.group].draw(mine, explore, draws, action, log_probability)
                at = (member, rows, track.counts[member, rows])
                track.actions[at], track.inputs[at], track.log_probabilities[at] = action, mine, log_probability
                self._actions[slot.group][rows, member] = action

    def _net_for(self, policy: str, rows: int) -> PolicyNet:
        """Return a policy's net for at least `rows` rows; its size is the next power of two."""
        size = LEAST_ROWS
        while size < rows:
            size *= 2
        if (policy, size) not in self._sized:
            self._sized[policy, size] = self._make_net(policy, size)
        return self._sized[policy, size]

    def _draw_at_random(self, rollout: DecisionRollout, starting: list[BoolArray]) -> None:
        rollout.random = True
        for group, track, starts, actions in zip(
            self.environment.acting, rollout.tracks, starting, self._actions, strict=True
        ):
            actions[...] = group.action_layout.draw(self._generator, actions.shape[:-1])
            _write(track.actions, starts, track.counts, actions.transpose(1, 0, 2))

    def _finish(self, rollout: Any, row: int, stop: int, episode: int) -> bool:
        return bool(rollout.finish(row, stop, episode))

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
