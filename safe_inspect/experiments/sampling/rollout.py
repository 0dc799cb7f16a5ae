"""`Rollout`: samples in arrays, in which the data of an episode are contiguous, and RLlib's episodes made from them.

The batched runners of `env_runners` send what `_episode` returns, of the agents whose policies are trained: for each
sample, ceil(num_timesteps / N) control steps of each of N environments, or whole episodes if their number is given.
Where a training uses RLlib's stock runners, these send RLlib's own episodes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from ray.rllib.core.columns import Columns
from ray.rllib.env.multi_agent_episode import MultiAgentEpisode
from ray.rllib.env.single_agent_episode import SingleAgentEpisode
from ray.rllib.utils.metrics import WEIGHTS_SEQ_NO

from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.types import AnyArray, BoolArray, IntArray

#: Name of the control steps of each decision, among RLlib's outputs of a module.
DECISION_STEPS = "decision_steps"
#: Observation and action space of an agent.
Spaces = tuple[Any, Any]


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


class Track:
    """The arrays of one group of G agents over N environments and T steps.

    Attributes:
        observations: Observations at the start of each step and, at the last index, at the end of the last step,
            float32, shape (G, N, T + 1, O).
        actions: Actions as sampled from the policy, not clipped, float32, shape (G, N, T, A).
        inputs: Inputs of the action distribution, float32, shape (G, N, T, I).
        log_probabilities: Log probabilities of the actions, float32, shape (G, N, T).
        rewards: Rewards, float32, shape (G, N, T).
        steps: Number of control steps of each decision, only in a `DecisionTrack`; otherwise None.
    """

    steps: IntArray | None = None
    _SAMPLED = ("observations", "actions", "inputs", "log_probabilities")
    _ARRAYS: tuple[str, ...] = (*_SAMPLED, "rewards")

    def __init__(self, size: tuple[int, int, int, int], envs: int, steps: int) -> None:
        agents, observation, action, inputs = size
        self.observations: AnyArray = np.empty((agents, envs, steps + 1, observation), dtype=np.float32)
        self.actions: AnyArray = np.empty((agents, envs, steps, action), dtype=np.float32)
        self.inputs: AnyArray = np.empty((agents, envs, steps, inputs), dtype=np.float32)
        self.log_probabilities: AnyArray = np.empty((agents, envs, steps), dtype=np.float32)
        self.rewards: AnyArray = np.empty((agents, envs, steps), dtype=np.float32)

    def grow(self) -> None:
        """Double the number of steps."""
        for name in self._ARRAYS:
            array = getattr(self, name)
            setattr(self, name, np.concatenate((array, np.empty_like(array)), axis=2))


class DecisionTrack(Track):
    """A `Track` whose third axis is the index of each agent's decisions instead of time steps.

    After the last decision of an episode there is an entry with only the last observation, so that the observations of
    a piece are contiguous.

    Attributes:
        steps: Number of control steps of each decision, shape (G, N, T).
        counts: Index of the decision that each agent has started or starts next, shape (G, N).
        starts: Index of each agent's first decision in the current piece, shape (G, N).
    """

    steps: IntArray
    _ARRAYS = (*Track._ARRAYS, "steps")

    def __init__(self, size: tuple[int, int, int, int], envs: int, steps: int) -> None:
        super().__init__(size, envs, steps)
        self.steps = np.empty(self.rewards.shape, dtype=np.int64)
        self.counts: IntArray = np.zeros(self.rewards.shape[:2], dtype=np.int64)
        self.starts: IntArray = np.zeros_like(self.counts)

    def pending(self) -> dict[str, AnyArray]:
        """Return copies of the decision that each agent has started, each of shape (G, N, ...)."""
        where = (*np.indices(self.counts.shape, sparse=True), self.counts)
        return {name: getattr(self, name)[where] for name in self._SAMPLED}

    def resume(self, pending: dict[str, AnyArray]) -> None:
        """Continue the pending decisions of an earlier track."""
        for name, array in pending.items():
            getattr(self, name)[:, :, 0] = array


@dataclass(frozen=True)
class _Span:
    """The part of one agent in a piece.

    Attributes:
        start: Index in the track of its first step or decision.
        length: Number of its steps or decisions, from the start of the piece.
        terminated: Whether its episode ended with the last of them by the task's conditions.
        truncated: Whether it was truncated with the last of them, by a time limit or by a draw of a shared done.
    """

    start: int
    length: int
    terminated: bool
    truncated: bool


@dataclass(frozen=True)
class _Piece:
    """A part of one environment's episode.

    Attributes:
        env: Index of the environment.
        start: Time index of its first control step.
        stop: Time index after its last control step.
        begun: Number of control steps of the episode before this piece.
        episode: Index of the episode within the environment's slot; -1 while it continues.
        spans: The part of each agent.
        finals: For each group the last observations, shape (G, O), if the episode has ended and the track does not
            contain them.
    """

    env: int
    start: int
    stop: int
    begun: int
    episode: int
    spans: tuple[_Span, ...]
    finals: Sequence[AnyArray] = ()

    @property
    def over(self) -> bool:
        """Whether the episode has ended for all agents."""
        return self.episode >= 0


class Rollout:
    """Samples of several steps of N environments.

    Args:
        sizes: For each group the numbers of agents, of elements of observation and action, and of inputs of the action
            distribution.
        steps: Number of steps, T.
        begun: Number of earlier steps of the running episodes, shape (N,).
        flying: Mask of the agents that have not ended at the start, shape (K, N).
        wanted: Number of whole episodes of each environment to keep, shape (N,); None keeps everything.

    Attributes:
        tracks: The arrays of each group.
        pieces: The parts of episodes, in the order of time for each environment.
        ended: Time index after the step with which each agent ended in the current piece, -1 while it is active, shape
            (K, N).
    """

    _Track: type[Track] = Track

    def __init__(
        self,
        sizes: Sequence[tuple[int, int, int, int]],
        steps: int,
        begun: IntArray,
        flying: BoolArray,
        wanted: IntArray | None = None,
    ) -> None:
        self.tracks = tuple(self._Track(size, len(begun), steps) for size in sizes)
        self.pieces: list[_Piece] = []
        self.ended: IntArray = np.full(flying.shape, -1, dtype=np.int64)
        self._steps = steps
        self._start: IntArray = np.zeros_like(begun)
        self._begun = begun
        self._flying = flying
        self._terminated: BoolArray = np.zeros_like(flying)
        self._truncated: BoolArray = np.zeros_like(flying)
        self._wanted = None if wanted is None else wanted.copy()

    @property
    def missing(self) -> bool:
        """Whether some of the required episodes have not ended."""
        return self._wanted is not None and bool(self._wanted.any())

    def reserve(self, steps: int) -> None:
        """Enlarge the arrays to at least the given number of steps."""
        while self._steps < steps:
            self._steps *= 2
            for track in self.tracks:
                track.grow()

    def end(self, agents: slice, time: int, terminated: BoolArray, truncated: BoolArray) -> None:
        """Record which agents of a group ended in a step.

        Args:
            agents: Indices of the agents of the group.
            time: Time index of the step.
            terminated: Mask, shape (G, N).
            truncated: Mask, shape (G, N).
        """
        self._terminated[agents] |= terminated
        self._truncated[agents] |= truncated
        self.ended[agents][terminated | truncated] = time + 1

    def finish(self, env: int, stop: int, episode: int, finals: Sequence[AnyArray] = ()) -> bool:
        """Close the piece at the end of an episode; return whether it is kept."""
        kept = True
        if self._wanted is not None:
            kept = bool(self._wanted[env] > 0)
            self._wanted[env] -= kept
        if kept:
            self._cut(env, stop, episode, finals)
        self._start[env], self._begun[env] = stop, 0
        self.ended[:, env] = -1
        self._flying[:, env] = True
        self._terminated[:, env] = self._truncated[:, env] = False
        return kept

    def close(self, stop: int) -> None:
        """Close the pieces of the episodes that continue."""
        for env in np.flatnonzero(self._start < stop).tolist():
            self._cut(env, stop, -1, ())

    def _cut(self, env: int, stop: int, episode: int, finals: Sequence[AnyArray]) -> None:
        starts, lengths = self._parts(env, stop)
        ends = self._terminated[:, env].tolist(), self._truncated[:, env].tolist()
        spans = tuple(map(_Span, starts, lengths, *ends))
        self.pieces.append(_Piece(env, int(self._start[env]), stop, int(self._begun[env]), episode, spans, finals))

    def _parts(self, env: int, stop: int) -> tuple[list[int], list[int]]:
        """Return the index of the first step of each agent in the current piece, and the number of its steps."""
        start, ends = int(self._start[env]), self.ended[:, env].tolist()
        flying = self._flying[:, env].tolist()
        lengths = [(end if end >= 0 else stop) - start if flies else 0 for end, flies in zip(ends, flying, strict=True)]
        return [start] * len(ends), lengths


class DecisionRollout(Rollout):
    """Samples of decisions that last several steps; `Rollout` is for actions of one step.

    Decisions that have not elapsed when the rollout is closed belong to the next rollout; see `DecisionTrack.pending`.
    """

    _Track = DecisionTrack
    tracks: tuple[DecisionTrack, ...]

    def reserve(self, steps: int) -> None:
        """Enlarge the arrays if necessary, for the next decision of every agent and two observations after it."""
        for track in self.tracks:
            if track.counts.max() + 2 >= track.rewards.shape[2]:
                track.grow()

    def finish(self, env: int, stop: int, episode: int, finals: Sequence[AnyArray] = ()) -> bool:
        """Close the piece at the end of an episode; return whether it is kept."""
        kept = super().finish(env, stop, episode)
        for track in self.tracks:
            track.counts[:, env] += 1  # skips the entry with the last observation
            track.starts[:, env] = track.counts[:, env]
        return kept

    def _parts(self, env: int, stop: int) -> tuple[list[int], list[int]]:
        starts = [start for track in self.tracks for start in track.starts[:, env].tolist()]
        counts = [count for track in self.tracks for count in track.counts[:, env].tolist()]
        return starts, [count - start for count, start in zip(counts, starts, strict=True)]


def single_agent_episodes(
    rollout: Rollout, slot: AgentSlot, spaces: Spaces, names: Sequence[str], weights: int
) -> list[SingleAgentEpisode]:
    """Return the pieces of a rollout with one agent as episodes, without pieces in which no decision has elapsed.

    Args:
        rollout: The samples.
        slot: The agent.
        spaces: Its spaces.
        names: Identifier of each piece's episode.
        weights: Sequence number of the weights with which the actions were sampled.
    """
    return [
        _episode(rollout, slot, piece, span, weights, spaces, id_=name)
        for piece, name in zip(rollout.pieces, names, strict=True)
        for span in piece.spans
        if span.length
    ]


def multi_agent_episodes(
    rollout: Rollout,
    slots: Sequence[AgentSlot],
    spaces: Mapping[str, Spaces],
    names: Sequence[str],
    weights: int,
    mapping: Any,
) -> list[MultiAgentEpisode]:
    """Return the pieces of a rollout with several agents as episodes; agents without a step are not part of a piece.

    Args:
        rollout: The samples.
        slots: The agents whose steps are returned.
        spaces: The spaces of each agent.
        names: Identifier of each piece's episode.
        weights: Sequence number of the weights with which the actions were sampled.
        mapping: RLlib's function from agent to policy.
    """
    modules: Any = {slot.agent: slot.policy for slot in slots}
    observation_space: Any = {agent: pair[0] for agent, pair in spaces.items()}
    action_space: Any = {agent: pair[1] for agent, pair in spaces.items()}
    places = [sum(len(track.rewards) for track in rollout.tracks[: slot.group]) + slot.member for slot in slots]
    episodes = []
    for piece, name in zip(rollout.pieces, names, strict=True):
        agents: dict[Any, SingleAgentEpisode] = {}
        for slot, place in zip(slots, places, strict=True):
            span = piece.spans[place]
            if span.length:
                own = {"agent_id": slot.agent, "module_id": slot.policy, "multi_agent_episode_id": name}
                agents[slot.agent] = _episode(
                    rollout, slot, piece, span, weights, spaces[slot.agent], id_=f"{name}-{slot.agent}", **own
                )
        if not agents:
            continue
        episode = MultiAgentEpisode(
            name,
            observation_space=observation_space,
            action_space=action_space,
            env_t_started=piece.begun,
            agent_t_started=dict.fromkeys(modules, piece.begun),
            agent_module_ids=dict(modules),
            agent_to_module_mapping_fn=mapping,
        )
        episode.agent_episodes = agents
        episode.env_t = piece.begun + piece.stop - piece.start
        episode.is_truncated = piece.over and any(span.truncated for span in piece.spans)
        episode.is_terminated = piece.over and not episode.is_truncated
        for agent, part in agents.items():
            episode.env_t_to_agent_t[agent].data = list(range(piece.begun, piece.begun + len(part) + 1))
        episodes.append(episode)
    return episodes


def _episode(
    rollout: Rollout, slot: AgentSlot, piece: _Piece, span: _Span, weights: int, spaces: Spaces, **names: Any
) -> SingleAgentEpisode:
    """Return the steps or decisions of one agent in a piece as an episode with the given names.

    The learner receives T + 1 observations, T actions as they were sampled, T rewards (of a decision, the discounted
    sum over its steps) with the number of steps of each decision if decisions last, the inputs and log-probabilities of
    the action distribution, the number of the weights that acted, and whether the episode was terminated or truncated
    by the task. A time limit truncates, and so does a draw of a shared done. An episode that is neither terminated nor
    truncated continues in the next sample. The learner computes values and advantages itself. Metrics are no part of
    it: `env_runners` returns them by ``get_metrics``.

    Of one agent in one environment, float32 unless stated otherwise: observations (T + 1, O); actions (T, A), of the
    space's type if they are integers; rewards (T,); `Columns.ACTION_DIST_INPUTS` (T, I), where I is 2 A for a Gaussian
    (means, then log standard deviations), the sum of the numbers of values for integers (logits), and 1 + 2 A + K for a
    `Hurdle` over A numbers and K choices (logit, means, log standard deviations, logits of the choices);
    `Columns.ACTION_LOGP` (T,); `WEIGHTS_SEQ_NO` and `DECISION_STEPS` (T,), int64. The infos are empty.
    """
    track, stop = rollout.tracks[slot.group], span.start + span.length
    part = (slot.member, piece.env, slice(span.start, stop))
    observations: Any = track.observations[slot.member, piece.env, span.start : stop + 1]
    if piece.finals and stop == piece.stop:
        # In the track of a `Rollout`, the last observation of an episode is overwritten by the first of the next one.
        observations = np.concatenate((observations[:-1], piece.finals[slot.group][slot.member][None]))
    actions: Any = track.actions[part]
    if np.issubdtype(spaces[1].dtype, np.integer):
        actions = actions.astype(spaces[1].dtype)
    outputs: dict[str, AnyArray] = {
        WEIGHTS_SEQ_NO: np.full(span.length, weights),
        Columns.ACTION_DIST_INPUTS: track.inputs[part],
        Columns.ACTION_LOGP: track.log_probabilities[part],
    }
    if track.steps is not None:
        outputs[DECISION_STEPS] = track.steps[part]
    rewards: Any = track.rewards[part]
    return SingleAgentEpisode(
        observations=observations,
        observation_space=spaces[0],
        infos=[{}] * (span.length + 1),
        actions=actions,
        action_space=spaces[1],
        rewards=rewards,
        terminated=span.terminated,
        truncated=span.truncated,
        extra_model_outputs=outputs,
        t_started=piece.begun,
        len_lookback_buffer=0,
        **names,
    )
