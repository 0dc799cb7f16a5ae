"""Conversion of a rollout's arrays to the episodes that RLlib's learners expect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from ray.rllib.core.columns import Columns
from ray.rllib.env.multi_agent_episode import MultiAgentEpisode
from ray.rllib.env.single_agent_episode import SingleAgentEpisode
from ray.rllib.utils.metrics import WEIGHTS_SEQ_NO

from safe_inspect.experiments.sampling.rollout import Piece, Rollout, Span
from safe_inspect.experiments.sampling.sampler import AgentSlot
from safe_inspect.types import AnyArray

#: Name of the control steps of each decision, among RLlib's outputs of a module.
DECISION_STEPS = "decision_steps"
#: Observation and action space of an agent.
Spaces = tuple[Any, Any]


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
            episode.env_t_to_agent_t[agent].extend(range(piece.begun, piece.begun + len(part) + 1))
        episodes.append(episode)
    return episodes


def _episode(
    rollout: Rollout, slot: AgentSlot, piece: Piece, span: Span, weights: int, spaces: Spaces, **names: Any
) -> SingleAgentEpisode:
    """Return the steps or decisions of one agent in a piece as an episode with the given names."""
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
