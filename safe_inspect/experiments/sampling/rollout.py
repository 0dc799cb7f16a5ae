"""`Rollout`: samples in arrays, in which the data of an episode are contiguous."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from safe_inspect.types import AnyArray, BoolArray, IntArray


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

    def __init__(self, size: tuple[int, int, int, int], envs: int, steps: int) -> None:
        agents, observation, action, inputs = size
        self.observations: AnyArray = np.empty((agents, envs, steps + 1, observation), dtype=np.float32)
        self.actions: AnyArray = np.empty((agents, envs, steps, action), dtype=np.float32)
        self.inputs: AnyArray = np.empty((agents, envs, steps, inputs), dtype=np.float32)
        self.log_probabilities: AnyArray = np.empty((agents, envs, steps), dtype=np.float32)
        self.rewards: AnyArray = np.empty((agents, envs, steps), dtype=np.float32)

    def grow(self) -> None:
        """Double the number of steps."""
        for name, array in vars(self).items():
            extra = np.empty((*array.shape[:2], array.shape[2], *array.shape[3:]), dtype=np.float32)
            setattr(self, name, np.concatenate((array, extra), axis=2))


@dataclass(frozen=True)
class Span:
    """The part of one agent in a piece.

    Attributes:
        start: Index in the track of its first step or decision.
        length: Number of its steps or decisions, from the start of the piece.
        terminated: Whether its episode ended with the last of them by the task's conditions.
        truncated: Whether its episode ended with the last of them by a time limit.
    """

    start: int
    length: int
    terminated: bool
    truncated: bool


@dataclass(frozen=True)
class Piece:
    """A part of one environment's episode.

    Attributes:
        env: Index of the environment.
        start: Time index of its first step.
        stop: Time index after its last step.
        begun: Number of steps of the episode before this piece.
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
    spans: tuple[Span, ...]
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
        envs: Number of environments, N.
        steps: Number of steps, T.
        begun: Number of earlier steps of the running episodes, shape (N,).
        flying: Mask of the agents that have not ended at the start, shape (K, N).
        wanted: Number of whole episodes of each environment to keep, shape (N,); None keeps everything.

    Attributes:
        tracks: The arrays of each group.
        pieces: The parts of episodes, in the order of time for each environment.
        ended: Time index after the step with which each agent ended in the current piece, -1 while it is active, shape
            (K, N).
        random: Whether actions were sampled without a policy.
    """

    def __init__(
        self,
        sizes: Sequence[tuple[int, int, int, int]],
        envs: int,
        steps: int,
        begun: IntArray,
        flying: BoolArray,
        wanted: IntArray | None = None,
    ) -> None:
        self.tracks = tuple(Track(size, envs, steps) for size in sizes)
        self.pieces: list[Piece] = []
        self.random = False
        self.ended: IntArray = np.full(flying.shape, -1, dtype=np.int64)
        self._steps = steps
        self._start: IntArray = np.zeros(envs, dtype=np.int64)
        self._begun = begun
        self._flying = flying
        self._terminated: BoolArray = np.zeros(flying.shape, dtype=np.bool_)
        self._truncated: BoolArray = np.zeros(flying.shape, dtype=np.bool_)
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

    def end(self, first: int, time: int, terminated: BoolArray, truncated: BoolArray) -> None:
        """Record which agents of a group ended in a step.

        Args:
            first: Index of the first agent of the group.
            time: Time index of the step.
            terminated: Mask, shape (G, N).
            truncated: Mask, shape (G, N).
        """
        mine = slice(first, first + len(terminated))
        self._terminated[mine] |= terminated
        self._truncated[mine] |= truncated
        self.ended[mine][terminated | truncated] = time + 1

    def finish(self, env: int, stop: int, episode: int, finals: Sequence[AnyArray]) -> bool:
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

    def close(self, observations: Sequence[AnyArray]) -> None:
        """Close the pieces of the episodes that continue; `observations` are those after the last step."""
        for track, observation in zip(self.tracks, observations, strict=True):
            track.observations[:, :, self._steps] = observation.transpose(1, 0, 2)
        for env in np.flatnonzero(self._start < self._steps).tolist():
            self._cut(env, self._steps, -1, ())

    def _cut(self, env: int, stop: int, episode: int, finals: Sequence[AnyArray]) -> None:
        start = int(self._start[env])
        spans = tuple(
            Span(start, (ended if ended >= 0 else stop) - start if flying else 0, terminated, truncated)
            for ended, flying, terminated, truncated in zip(
                self.ended[:, env].tolist(),
                self._flying[:, env].tolist(),
                self._terminated[:, env].tolist(),
                self._truncated[:, env].tolist(),
                strict=True,
            )
        )
        self.pieces.append(Piece(env, start, stop, int(self._begun[env]), episode, spans, finals))
