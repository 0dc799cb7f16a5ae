"""`DecisionRollout`: sampled decisions that last several steps, stored one after the other for each agent."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from safe_inspect.experiments.sampling.rollout import Piece, Span, Track
from safe_inspect.types import AnyArray, BoolArray, IntArray

_ROOM = 32


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

    def __init__(self, size: tuple[int, int, int, int], envs: int) -> None:
        super().__init__(size, envs, _ROOM)
        self.steps = np.empty(self.rewards.shape, dtype=np.int64)
        self.counts: IntArray = np.zeros(self.rewards.shape[:2], dtype=np.int64)
        self.starts: IntArray = np.zeros_like(self.counts)

    def reserve(self) -> None:
        """Enlarge the arrays if necessary, for the next decision of every agent and two observations after it."""
        if self.counts.max() + 2 < self.rewards.shape[2]:
            return
        for name in ("observations", "actions", "inputs", "log_probabilities", "rewards", "steps"):
            array = getattr(self, name)
            setattr(self, name, np.concatenate((array, np.empty_like(array)), axis=2))

    def pending(self) -> dict[str, AnyArray]:
        """Return copies of the decision that each agent has started, each of shape (G, N, ...)."""
        where = (*np.indices(self.counts.shape, sparse=True), self.counts)
        return {name: getattr(self, name)[where] for name in ("observations", "actions", "inputs", "log_probabilities")}

    def resume(self, pending: dict[str, AnyArray]) -> None:
        """Continue the pending decisions of an earlier track."""
        for name, array in pending.items():
            getattr(self, name)[:, :, 0] = array


class DecisionRollout:
    """Samples of decisions that last several steps in N environments; `Rollout` is for actions of one step.

    Decisions that have not elapsed when the rollout is closed belong to the next rollout; see `DecisionTrack.pending`.

    Args:
        sizes: For each group the numbers of agents, of elements of observation and action, and of inputs of the action
            distribution.
        begun: Number of earlier control steps of the running episodes, shape (N,).
        wanted: Number of whole episodes of each environment to keep, shape (N,); None keeps everything.

    Attributes:
        tracks: The arrays of each group.
        pieces: The parts of episodes, in the order of time for each environment; their `start` and `stop` count control
            steps.
        random: Whether actions were sampled without a policy.
    """

    def __init__(
        self, sizes: Sequence[tuple[int, int, int, int]], begun: IntArray, wanted: IntArray | None = None
    ) -> None:
        envs = len(begun)
        self.tracks = tuple(DecisionTrack(size, envs) for size in sizes)
        self.pieces: list[Piece] = []
        self.random = False
        self._start: IntArray = np.zeros(envs, dtype=np.int64)
        self._begun = begun
        agents = sum(size[0] for size in sizes)
        self._terminated: BoolArray = np.zeros((agents, envs), dtype=np.bool_)
        self._truncated: BoolArray = np.zeros((agents, envs), dtype=np.bool_)
        self._wanted = None if wanted is None else wanted.copy()

    @property
    def missing(self) -> bool:
        """Whether some of the required episodes have not ended."""
        return self._wanted is not None and bool(self._wanted.any())

    def end(self, first: int, terminated: BoolArray, truncated: BoolArray) -> None:
        """Record which agents of a group ended in a step.

        Args:
            first: Index of the first agent of the group.
            terminated: Mask, shape (G, N).
            truncated: Mask, shape (G, N).
        """
        mine = slice(first, first + len(terminated))
        self._terminated[mine] |= terminated
        self._truncated[mine] |= truncated

    def finish(self, env: int, stop: int, episode: int) -> bool:
        """Close the piece at the end of an episode; return whether it is kept."""
        kept = True
        if self._wanted is not None:
            kept = bool(self._wanted[env] > 0)
            self._wanted[env] -= kept
        if kept:
            self._cut(env, stop, episode)
        for track in self.tracks:
            track.counts[:, env] += 1  # skips the entry with the last observation
            track.starts[:, env] = track.counts[:, env]
        self._start[env], self._begun[env] = stop, 0
        self._terminated[:, env] = self._truncated[:, env] = False
        return kept

    def close(self, stop: int) -> None:
        """Close the pieces of the episodes that continue."""
        for env in np.flatnonzero(self._start < stop).tolist():
            self._cut(env, stop, -1)

    def _cut(self, env: int, stop: int, episode: int) -> None:
        starts, counts = (
            np.concatenate([getattr(track, name)[:, env] for track in self.tracks]) for name in ("starts", "counts")
        )
        ends = zip(self._terminated[:, env].tolist(), self._truncated[:, env].tolist(), strict=True)
        rows = zip(starts.tolist(), (counts - starts).tolist(), ends, strict=True)
        spans = tuple(Span(start, length, *done) for start, length, done in rows)
        self.pieces.append(Piece(env, int(self._start[env]), stop, int(self._begun[env]), episode, spans))
