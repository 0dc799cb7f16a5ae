"""From a rollout's arrays to the episodes that RLlib's learner takes."""

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
    """Return the pieces of a rollout with one agent; those without a decision that has elapsed are left out.

    Args:
        rollout: What was sampled.
        slot: The agent.
        spaces: Its spaces.
        names: The identity of each piece's episode.
        weights: Number of the weights that flew it.
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
    """Return the pieces of a rollout with several agents; an agent that took no step is not part of a piece.

    Args:
        rollout: What was sampled.
        slots: The agents whose steps are wanted.
        spaces: The spaces of each agent.
        names: The identity of each piece's episode.
        weights: Number of the weights that flew it.
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
    # Behind the end of an episode of steps stands the first observation of the next one.
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
