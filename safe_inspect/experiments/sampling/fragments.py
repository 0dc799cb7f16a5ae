"""Conversion of a rollout's arrays to the episodes that RLlib's learner expects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ray.rllib.env.multi_agent_episode import MultiAgentEpisode
from ray.rllib.env.single_agent_episode import SingleAgentEpisode

from safe_inspect.experiments.sampling.rollout import Piece, Rollout, Span
from safe_inspect.experiments.sampling.rollout_episodes import EpisodePart, RolloutEpisode, RolloutTeamEpisode, Spaces
from safe_inspect.experiments.sampling.sampler import AgentSlot


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
        RolloutEpisode(_part(rollout, slot, piece, span, weights), name, spaces, piece.begun, span.truncated)
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
    modules: dict[Any, str] = {slot.agent: slot.policy for slot in slots}
    places = [_place(slot, rollout) for slot in slots]
    episodes: list[MultiAgentEpisode] = []
    for piece, name in zip(rollout.pieces, names, strict=True):
        parts = {}
        for slot, place in zip(slots, places, strict=True):
            span = piece.spans[place]
            if span.length:
                parts[slot.agent] = RolloutEpisode(
                    _part(rollout, slot, piece, span, weights),
                    f"{name}-{slot.agent}",
                    spaces[slot.agent],
                    piece.begun,
                    span.truncated,
                    (slot.agent, slot.policy, name),
                )
        truncated = piece.over and any(span.truncated for span in piece.spans)
        steps = (piece.begun, piece.begun + piece.stop - piece.start)
        done = (piece.over and not truncated, truncated)
        if parts:
            episodes.append(RolloutTeamEpisode(parts, name, steps, done, spaces, modules, mapping))
    return episodes


def _place(slot: AgentSlot, rollout: Rollout) -> int:
    """Return the index of a slot among the acting agents."""
    return sum(len(track.rewards) for track in rollout.tracks[: slot.group]) + slot.member


def _part(rollout: Rollout, slot: AgentSlot, piece: Piece, span: Span, weights: int) -> EpisodePart:
    track, member, env = rollout.tracks[slot.group], slot.member, piece.env
    start, stop = span.start, span.start + span.length
    # In the track of a `Rollout`, the last observation of an episode is overwritten by the first of the next episode.
    final = piece.finals[slot.group][member] if piece.finals and stop == piece.stop else None
    return EpisodePart(
        track.observations[member, env, start : stop + 1],
        final,
        track.actions[member, env, start:stop],
        None if rollout.random else track.inputs[member, env, start:stop],
        None if rollout.random else track.log_probabilities[member, env, start:stop],
        track.rewards[member, env, start:stop],
        span.terminated,
        weights,
        None if track.steps is None else track.steps[member, env, start:stop],
    )
