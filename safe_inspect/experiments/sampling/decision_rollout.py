"""`DecisionRollout`: what was sampled of agents whose decisions last, each agent's one behind the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from safe_inspect.experiments.sampling.rollout import Piece, Span, Track
from safe_inspect.types import AnyArray, BoolArray, IntArray

_ROOM = 32


class DecisionTrack(Track):
    """A `Track` whose third axis counts the decisions of each agent, not the steps of time.

    Behind the last decision of an episode stands a place that holds its last observation alone, so that the
    observations of a piece are contiguous.

    Attributes:
        steps: Control steps of each decision, shape (G, N, T).
        counts: Index of the decision that each agent has begun or begins next, shape (G, N).
        starts: Index of each agent's first decision in the current piece, shape (G, N).
    """

    steps: IntArray

    def __init__(self, size: tuple[int, int, int, int], envs: int) -> None:
        super().__init__(size, envs, _ROOM)
        self.steps = np.empty(self.rewards.shape, dtype=np.int64)
        self.counts: IntArray = np.zeros(self.rewards.shape[:2], dtype=np.int64)
        self.starts: IntArray = np.zeros_like(self.counts)

    def reserve(self) -> None:
        """Make room for the next decision of every agent, and for two observations behind it."""
        if self.counts.max() + 2 < self.rewards.shape[2]:
            return
        for name in ("observations", "actions", "inputs", "log_probabilities", "rewards", "steps"):
            array = getattr(self, name)
            setattr(self, name, np.concatenate((array, np.empty_like(array)), axis=2))

    def pending(self) -> dict[str, AnyArray]:
        """Return copies of the decision that each agent has begun, each of shape (G, N, ...)."""
        where = (*np.indices(self.counts.shape, sparse=True), self.counts)
        return {name: getattr(self, name)[where] for name in ("observations", "actions", "inputs", "log_probabilities")}

    def resume(self, pending: dict[str, AnyArray]) -> None:
        """Go on with the decisions of an earlier track."""
        for name, array in pending.items():
            getattr(self, name)[:, :, 0] = array


class DecisionRollout:
    """What the decisions of agents in N environments gave; `Rollout` is the like for actions of one step.

    Decisions that have not elapsed when it is closed belong to the next one: `pending` holds them.

    Args:
        sizes: For each group the numbers of agents, of elements of observation and action, and of inputs of the action
            distribution.
        begun: Control steps of the running episodes before, shape (N,).
        wanted: How many whole episodes of each environment to keep, shape (N,); None: keep everything.

    Attributes:
        tracks: The arrays, for each group.
        pieces: The stretches, for each environment in the order of time; their `start` and `stop` count control steps.
        random: Whether actions were drawn without a policy.
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
        """Whether episodes that are wanted have not ended."""
        return self._wanted is not None and bool(self._wanted.any())

    def end(self, first: int, terminated: BoolArray, truncated: BoolArray) -> None:
        """Note which agents of a group, the first of which is `first`, ended in a step; both masks are (G, N)."""
        mine = slice(first, first + len(terminated))
        self._terminated[mine] |= terminated
        self._truncated[mine] |= truncated

    def finish(self, env: int, stop: int, episode: int) -> bool:
        """Cut at the end of an episode; return whether it is kept."""
        kept = True
        if self._wanted is not None:
            kept = bool(self._wanted[env] > 0)
            self._wanted[env] -= kept
        if kept:
            self._cut(env, stop, episode)
        for track in self.tracks:
            track.counts[:, env] += 1  # behind the place of the last observation
            track.starts[:, env] = track.counts[:, env]
        self._start[env], self._begun[env] = stop, 0
        self._terminated[:, env] = self._truncated[:, env] = False
        return kept

    def close(self, stop: int) -> None:
        """Cut what goes on."""
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
