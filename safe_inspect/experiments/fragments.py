"""From a rollout's arrays to the episodes that RLlib's learner takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from ray.rllib.core.columns import Columns
from ray.rllib.env.multi_agent_episode import MultiAgentEpisode
from ray.rllib.env.single_agent_episode import SingleAgentEpisode
from ray.rllib.utils.metrics import WEIGHTS_SEQ_NO

from safe_inspect.experiments.rollout import Piece, Rollout, Span
from safe_inspect.experiments.sampler import Seat
from safe_inspect.types import AnyArray

#: Observation and action space of an agent.
Spaces = tuple[Any, Any]


def single_agent_episodes(
    rollout: Rollout, seat: Seat, spaces: Spaces, names: Sequence[str], weights: int
) -> list[SingleAgentEpisode]:
    """Return the pieces of a rollout with one agent.

    Args:
        rollout: What was sampled.
        seat: The agent.
        spaces: Its spaces.
        names: The identity of each piece's episode.
        weights: Number of the weights that flew it.
    """
    return [
        _episode(rollout, seat, spaces, piece, piece.spans[0], name, weights)
        for piece, name in zip(rollout.pieces, names, strict=True)
    ]


def multi_agent_episodes(
    rollout: Rollout,
    seats: Sequence[Seat],
    spaces: Mapping[str, Spaces],
    names: Sequence[str],
    weights: int,
    mapping: Any,
) -> list[MultiAgentEpisode]:
    """Return the pieces of a rollout with several agents; an agent that took no step is not part of a piece.

    Args:
        rollout: What was sampled.
        seats: The agents whose steps are wanted.
        spaces: The spaces of each agent.
        names: The identity of each piece's episode.
        weights: Number of the weights that flew it.
        mapping: RLlib's function from agent to policy.
    """
    observation_space: Any = {agent: pair[0] for agent, pair in spaces.items()}
    action_space: Any = {agent: pair[1] for agent, pair in spaces.items()}
    modules: dict[Any, str] = {seat.agent: seat.policy for seat in seats}
    episodes = []
    for piece, name in zip(rollout.pieces, names, strict=True):
        whole = MultiAgentEpisode(
            name,
            observation_space=observation_space,
            action_space=action_space,
            env_t_started=piece.begun,
            agent_t_started=dict.fromkeys(modules, piece.begun),
            agent_module_ids=modules.copy(),
            agent_to_module_mapping_fn=mapping,
        )
        whole.env_t = piece.begun + piece.stop - piece.start
        for seat in seats:
            span = piece.spans[_place(seat, rollout)]
            if span.length:
                part = _episode(
                    rollout,
                    seat,
                    spaces[seat.agent],
                    piece,
                    span,
                    f"{name}-{seat.agent}",
                    weights,
                    agent_id=seat.agent,
                    module_id=seat.policy,
                    multi_agent_episode_id=name,
                )
                whole.agent_episodes[seat.agent] = part
                whole.env_t_to_agent_t[seat.agent].extend(range(piece.begun, piece.begun + span.length + 1))
        if piece.over:
            whole.is_truncated = any(span.truncated for span in piece.spans)
            whole.is_terminated = not whole.is_truncated
        if whole.agent_episodes:
            episodes.append(whole)
    return episodes


def _place(seat: Seat, rollout: Rollout) -> int:
    """Return the index of a seat among the acting agents."""
    return sum(len(track.rewards) for track in rollout.tracks[: seat.group]) + seat.member


def _episode(
    rollout: Rollout, seat: Seat, spaces: Spaces, piece: Piece, span: Span, name: str, weights: int, **more: Any
) -> SingleAgentEpisode:
    track, member = rollout.tracks[seat.group], seat.member
    stop = piece.start + span.length
    part = (member, piece.env, slice(piece.start, stop))
    observations: Any = track.observations[member, piece.env, piece.start : stop + 1]
    actions: Any = track.actions[part]
    if np.issubdtype(spaces[1].dtype, np.integer):
        actions = actions.astype(spaces[1].dtype)
    rewards: Any = track.rewards[part]
    if piece.over and stop == piece.stop:  # behind the end stands the first observation of the next episode
        observations = np.concatenate((observations[:-1], piece.finals[seat.group][None, member]))
    outputs: dict[str, AnyArray] = {WEIGHTS_SEQ_NO: np.full(span.length, weights)}
    if not rollout.random:
        outputs[Columns.ACTION_DIST_INPUTS] = track.inputs[part]
        outputs[Columns.ACTION_LOGP] = track.log_probabilities[part]
    return SingleAgentEpisode(
        name,
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
        **more,
    )
