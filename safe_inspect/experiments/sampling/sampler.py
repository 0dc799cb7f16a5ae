"""`Sampler`: sampling of N environments with all their agents into arrays, without RLlib's episodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from time import perf_counter
from typing import Any

import numpy as np

from safe_inspect.environments.episodes import EpisodeAccumulator
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition, Transition
from safe_inspect.errors import SafeInspectError
from safe_inspect.experiments.sampling.episode_reports import EpisodeReport, episode_reports
from safe_inspect.experiments.sampling.policy_net import PolicyNet
from safe_inspect.experiments.sampling.rollout import Rollout
from safe_inspect.random.action_draws import Distribution, DrawRows
from safe_inspect.types import AnyArray, BoolArray, IntArray

#: Indices of some environments of a batch.
Rows = IntArray | slice


@dataclass(frozen=True)
class AgentSlot:
    """A controlled agent.

    Attributes:
        agent: Its name.
        policy: Name of its policy.
        group: Index of its group among the controlled groups.
        member: Its index in the group.
        deputy: Its index among all agents.
    """

    agent: str
    policy: str
    group: int
    member: int
    deputy: int


def agent_slots(environment: TeamEnvironment, policy_of: Callable[[str], str] | None = None) -> tuple[AgentSlot, ...]:
    """Return the controlled agents, in order.

    Args:
        environment: The environments.
        policy_of: Function from an agent to its policy; by default the policies of the environments are used.
    """
    return tuple(
        AgentSlot(agent, policy_of(agent) if policy_of else group.policies[member], index, member, group.first + member)
        for index, group in enumerate(environment.acting)
        for member, agent in enumerate(group.agents)
    )


class Sampler:
    """Sampler that steps the environments with their policies and stores the results.

    Unfinished episodes continue in the next call. The samples depend only on the seed and the slots, not on the number
    of environments in the batch.

    Args:
        environment: The environments.
        slots: The controlled agents, in order.
        nets: Function that makes the net of a policy for a number of rows.
        seed: Seed of the actions' noise.
        first_slot: Global index of the first environment slot.
    """

    def __init__(
        self,
        environment: TeamEnvironment,
        slots: tuple[AgentSlot, ...],
        nets: Callable[[str, int], PolicyNet],
        *,
        seed: int,
        first_slot: int,
    ) -> None:
        self.environment = environment
        self.agent_slots = slots
        count = environment.num_envs
        self._seed = np.uint64(seed)
        self._slots = np.arange(first_slot, first_slot + count, dtype=np.uint64)
        self._deputies = [np.full(count, slot.deputy) for slot in slots]
        self._slots_by_policy: dict[str, list[int]] = {}
        for index, slot in enumerate(slots):
            self._slots_by_policy.setdefault(slot.policy, []).append(index)
        self._nets = {policy: nets(policy, count * len(indices)) for policy, indices in self._slots_by_policy.items()}
        self._where = [environment.groups.index(group) for group in environment.acting]
        ends = accumulate(group.size for group in environment.acting)
        self._members = [slice(end - group.size, end) for end, group in zip(ends, environment.acting, strict=True)]
        self._actions = [np.zeros((count, group.size, group.action_layout.size)) for group in environment.acting]
        self._distributions = [self._distribution(index) for index in range(len(environment.acting))]
        self._sizes = [
            (group.size, group.observation_layout.size, group.action_layout.size, distribution.inputs)
            for group, distribution in zip(environment.acting, self._distributions, strict=True)
        ]
        self._generator = np.random.default_rng(seed)
        self._sums = EpisodeAccumulator(environment)
        self._step: IntArray = np.zeros(count, dtype=np.int64)
        self._flying: BoolArray = np.ones((len(slots), count), dtype=np.bool_)
        self._since = [perf_counter()] * count
        self._observations: list[AnyArray] = []
        #: Reports of the episodes that have ended; the caller removes them.
        self.reports: list[EpisodeReport] = []

    def reset(self) -> None:
        """Start a new episode in every environment."""
        rows = np.arange(self.environment.num_envs)
        self._observations = [observation.copy() for observation in self.environment.reset()]
        self._sums.restart(rows)
        self._step[:] = 0
        self._flying[:] = True
        self._since = [perf_counter()] * len(rows)

    def roll(self, steps: int, explore: bool = True, random: bool = False, lifetime: int = 0) -> Rollout:
        """Take a number of steps in every environment.

        Args:
            steps: Number of steps.
            explore: Whether to sample actions; otherwise they are the means.
            random: Whether to sample actions uniformly within their bounds instead, without a policy.
            lifetime: Number of steps that the whole training has sampled.
        """
        rollout: Rollout = self._rollout(steps)
        for time in range(steps):
            self._advance(rollout, time, explore, random, lifetime)
        self._observe(rollout, steps)
        rollout.close(steps)
        self._flying &= rollout.ended < 0
        return rollout

    def roll_episodes(self, count: int, explore: bool = True, random: bool = False, lifetime: int = 0) -> Rollout:
        """Sample whole episodes: the first ones of as many environments as possible.

        The number of episodes of each environment is fixed in advance, because taking the episodes that end first would
        favour short ones. All environments are reset first, and episodes that are unfinished at the end are discarded.

        Args:
            count: Number of episodes.
            explore: See `roll`.
            random: See `roll`.
            lifetime: See `roll`.
        """
        self.reset()
        envs = self.environment.num_envs
        wanted = count // envs + (np.arange(envs) < count % envs)
        rollout: Rollout = self._rollout(512, wanted)
        time = 0
        while rollout.missing:
            self._advance(rollout, time, explore, random, lifetime)
            time += 1
        return rollout

    def _distribution(self, group: int) -> Distribution:
        """Return the action distribution of a group of agents.

        Raises:
            SafeInspectError: The policies of its agents have different distributions.
        """
        found: dict[str, Distribution] = {
            slot.policy: self._nets[slot.policy].distribution for slot in self.agent_slots if slot.group == group
        }
        first, *others = found.values()
        if any(type(other) is not type(first) for other in others):
            raise SafeInspectError(
                f"the policies {', '.join(found)} control equal agents with different action distributions; give "
                "`hurdle` to all of them or to none"
            )
        return first

    def _rollout(self, steps: int, wanted: IntArray | None = None) -> Any:
        return Rollout(self._sizes, steps, self._step.copy(), self._flying.copy(), wanted)

    def _advance(self, rollout: Any, time: int, explore: bool, random: bool, lifetime: int) -> None:
        rollout.reserve(time + 1)
        chosen = self._observe(rollout, time)
        if random:
            self._act_at_random(rollout, time, chosen)
        else:
            self._act(rollout, time, chosen, explore, lifetime + time * self.environment.num_envs)
        transition = self.environment.step(self._actions)
        self._step += 1
        self._sums.add(transition)
        self._observations = [transition.groups[where].observation for where in self._where]
        for index, (where, agents) in enumerate(zip(self._where, self._members, strict=True)):
            found = transition.groups[where]
            self._store(rollout, index, time, found)
            if np.count_nonzero(found.terminated) or np.count_nonzero(found.truncated):
                rollout.end(agents, time, found.terminated.T, found.truncated.T)
        if np.count_nonzero(transition.over):
            self._begin_again(rollout, time, transition)

    def _observe(self, rollout: Any, time: int) -> Sequence[Rows]:
        """Store the current observations; return for each agent the rows in which it acts now."""
        for track, observation in zip(rollout.tracks, self._observations, strict=True):
            track.observations[:, :, time] = observation.transpose(1, 0, 2)
        return [slice(None)] * len(self.agent_slots)

    def _store(self, rollout: Any, group: int, time: int, found: Transition) -> None:
        """Store the rewards of a group after a step."""
        rollout.tracks[group].rewards[:, :, time] = found.reward.T

    def _net_for(self, policy: str, rows: int) -> PolicyNet:
        """Return a policy's net for a number of rows."""
        return self._nets[policy]

    def _act(self, rollout: Any, time: int, chosen: Sequence[Rows], explore: bool, lifetime: int) -> None:
        episodes = self.environment.simulation.episodes
        for policy, indices in self._slots_by_policy.items():
            counts = [len(self._slots[chosen[index]]) for index in indices]
            if not any(counts):
                continue
            net = self._net_for(policy, sum(counts))
            places = [slice(last - count, last) for last, count in zip(accumulate(counts), counts, strict=True)]
            for index, place in zip(indices, places, strict=True):
                slot = self.agent_slots[index]
                net.observations[place] = self._observations[slot.group][chosen[index], slot.member]
            inputs = net(explore, lifetime)
            for index, place in zip(indices, places, strict=True):
                slot, rows = self.agent_slots[index], chosen[index]
                track, mine = rollout.tracks[slot.group], inputs[place]
                draws = DrawRows(
                    self._seed, self._slots[rows], episodes[rows], self._step[rows], self._deputies[index][rows]
                )
                action = np.empty((len(mine), track.actions.shape[3]), dtype=np.float32)
                log_probability = np.empty(len(mine), dtype=np.float32)
                self._distributions[slot.group].draw(mine, explore, draws, action, log_probability)
                at = (slot.member, rows, self._time_of(track, slot.member, rows, time))
                track.actions[at], track.inputs[at], track.log_probabilities[at] = action, mine, log_probability
                self._actions[slot.group][rows, slot.member] = action

    def _time_of(self, track: Any, member: int, rows: Rows, time: int) -> Any:
        """Return the index in a track of the actions that an agent takes now."""
        return time

    def _act_at_random(self, rollout: Any, time: int, chosen: Sequence[Rows]) -> None:
        rollout.random = True
        for group, actions in zip(self.environment.acting, self._actions, strict=True):
            actions[...] = group.action_layout.draw(self._generator, actions.shape[:-1])
        for slot, rows in zip(self.agent_slots, chosen, strict=True):
            track = rollout.tracks[slot.group]
            time_of = self._time_of(track, slot.member, rows, time)
            track.actions[slot.member, rows, time_of] = self._actions[slot.group][rows, slot.member]

    def _begin_again(self, rollout: Any, time: int, transition: TeamTransition) -> list[int]:
        """Close the pieces of ended episodes, report them and start new episodes; return the rows that are kept."""
        rows = np.flatnonzero(transition.over)
        episodes = self.environment.simulation.episodes
        kept = [
            row
            for row in rows.tolist()
            if rollout.finish(row, time + 1, int(episodes[row]), [found[row].copy() for found in self._observations])
        ]
        now = perf_counter()
        for row, report in zip(kept, episode_reports(self.environment, self._sums, kept, transition), strict=True):
            self.reports.append({**report, "seconds": now - self._since[row]})
        for row in rows.tolist():
            self._since[row] = now
        self._sums.restart(rows)
        self._step[rows] = 0
        self._flying[:, rows] = True
        for observation, fresh in zip(self._observations, self.environment.reset(rows), strict=True):
            observation[rows] = fresh
        return kept


def agents_by_policy(slots: tuple[AgentSlot, ...]) -> Mapping[str, tuple[str, ...]]:
    """Return the names of the agents of each policy."""
    found: dict[str, tuple[str, ...]] = {}
    for slot in slots:
        found[slot.policy] = (*found.get(slot.policy, ()), slot.agent)
    return found
