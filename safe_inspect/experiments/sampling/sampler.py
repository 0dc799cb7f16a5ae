"""`Sampler`: sampling of N environments with all their agents into arrays, without RLlib's episodes.

`DecisionSampler` is for decisions that last several steps, and `episode_reports` gives the values of ended episodes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import accumulate
from time import perf_counter
from typing import Any

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.environments.episodes import INFO, OWN, EpisodeAccumulator
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition, Transition
from safe_inspect.errors import SafeInspectError
from safe_inspect.experiments.modules.tanh_net import LEAST_ROWS, PolicyNet
from safe_inspect.experiments.sampling.rollout import AgentSlot, DecisionRollout, Rollout
from safe_inspect.random.action_draws import Distribution, DrawRows
from safe_inspect.types import AnyArray, BoolArray, IntArray

#: Values of an episode by name; a path such as ``agents/blue0/delta_v`` denotes nested names.
EpisodeReport = dict[str, float]

#: Indices of some environments of a batch.
Rows = IntArray | slice
_ROOM = 32  # decisions of each agent for which a rollout has room at first


def episode_reports(
    environment: TeamEnvironment, sums: EpisodeAccumulator, rows: Sequence[int] | IntArray, transition: TeamTransition
) -> list[EpisodeReport]:
    """Return the reports of the episodes of some rows; must be called before these rows are reset.

    ``return`` and ``reward/NAME`` are sums over the controlled agents, ``delta_v`` and ``interventions`` are means over
    the deputies. With several agents ``agents/NAME/...`` contains the same values for each agent.

    Args:
        environment: The environments.
        sums: The accumulated values of their episodes.
        rows: The rows whose episodes have ended.
        transition: The last step.
    """
    rows = np.asarray(rows, dtype=np.int64)
    state, outcome = environment.state, transition.outcome[rows]
    acting = [group.first + member for group in environment.acting for member in range(group.size)]
    columns: dict[str, AnyArray] = {
        "return": sums.returns[rows][:, acting].sum(axis=1),
        "length": sums.lengths[rows].max(axis=1),
        "success_rate": outcome == DoneStatus.WIN,
        "lost_rate": outcome == DoneStatus.LOSE,
        "delta_v": state.delta_v[rows].mean(axis=1),
    }
    columns |= sums.info(rows)
    if sums.filtered:
        columns["interventions"] = state.interventions[rows].mean(axis=1)
    columns |= sums.terms(rows)
    if sums.returns.shape[1] > 1:
        for agent, figures in sums.agents(rows).items():
            status = figures.pop("status")
            own = {"success": status == DoneStatus.WIN, "lost": status == DoneStatus.LOSE}
            own |= {name.removeprefix(INFO).removeprefix(OWN): value for name, value in figures.items()}
            columns |= {f"agents/{agent}/{name}": value for name, value in own.items()}
    values = zip(*(column.astype(np.float64).tolist() for column in columns.values()), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in values]


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
        self._make_net = nets
        self._nets = {policy: nets(policy, count * len(indices)) for policy, indices in self._slots_by_policy.items()}
        self._where = environment.acting_indices
        ends = accumulate(group.size for group in environment.acting)
        self._members = [slice(end - group.size, end) for end, group in zip(ends, environment.acting, strict=True)]
        self._actions = [np.zeros((count, group.size, group.action_layout.size)) for group in environment.acting]
        self._distributions = [self._distribution(index) for index in range(len(environment.acting))]
        self._sizes = [
            (group.size, group.observation_layout.size, group.action_layout.size, distribution.inputs)
            for group, distribution in zip(environment.acting, self._distributions, strict=True)
        ]
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

    def roll(self, steps: int, explore: bool = True) -> Rollout:
        """Take a number of steps in every environment.

        Args:
            steps: Number of steps.
            explore: Whether to sample actions; otherwise they are the means.
        """
        rollout: Rollout = self._rollout(steps)
        for time in range(steps):
            self._advance(rollout, time, explore)
        self._observe(rollout, steps)
        rollout.close(steps)
        self._flying &= rollout.ended < 0
        return rollout

    def roll_episodes(self, count: int, explore: bool = True) -> Rollout:
        """Sample whole episodes: the first ones of as many environments as possible.

        The number of episodes of each environment is fixed in advance, because taking the episodes that end first would
        favour short ones. All environments are reset first, and episodes that are unfinished at the end are discarded.

        Args:
            count: Number of episodes.
            explore: See `roll`.
        """
        self.reset()
        envs = self.environment.num_envs
        wanted = count // envs + (np.arange(envs) < count % envs)
        rollout: Rollout = self._rollout(512, wanted)
        time = 0
        while rollout.missing:
            self._advance(rollout, time, explore)
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

    def _advance(self, rollout: Any, time: int, explore: bool) -> None:
        rollout.reserve(time + 1)
        self._act(rollout, time, self._observe(rollout, time), explore)
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

    def _act(self, rollout: Any, time: int, chosen: Sequence[Rows], explore: bool) -> None:
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
            inputs = net(explore)
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


class DecisionSampler(Sampler):
    """Sampler that steps all environments at every control step and stores decisions: a semi-Markov process.

    The reward of a decision of k control steps is sum gamma^i r_i over them. The agents decide at different times. A
    decision that has not elapsed when a call ends is stored by the next call, once it has elapsed.

    Args:
        *arguments: See `Sampler`.
        gamma: Discount of a control step.
        **keywords: See `Sampler`.
    """

    def __init__(self, *arguments: Any, gamma: float, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self.environment.observes_coasting = False
        self._gamma = gamma
        self._sized: dict[tuple[str, int], PolicyNet] = {}
        shape = (len(self.agent_slots), self.environment.num_envs)
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
        size = max(LEAST_ROWS, 1 << (rows - 1).bit_length())
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
