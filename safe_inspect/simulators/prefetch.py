"""`InitialStatePrefetcher`: initial states of the next episodes, drawn for many environments at a time.

The initial state of an episode depends only on the run's seed, the slot and the number of the episode. So the next
initial state of every slot can be drawn before the current episode ends, for all slots together: drawing one row takes
as long as drawing a hundred. For a small batch, several episodes of each slot are drawn at once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from safe_inspect.simulators.state import ArraySpec, State
from safe_inspect.types import AnyArray, IntArray

#: Function that draws initial states: it takes the indices of rows and the numbers of their episodes, and returns the
#: initial state of these rows and the statistics of the draw.
DrawInitialStates = Callable[[IntArray, IntArray], tuple[State, dict[str, AnyArray]]]

#: For a batch smaller than this, this many initial states are drawn at a time.
MIN_PREFETCH = 32
#: `State` objects of up to this many rows are cached and reused.
_SMALL = 96


class InitialStatePrefetcher:
    """Cache of the next initial states of every row.

    Args:
        num_envs: Number of environments, N.
        specs: The arrays of their states.
        draw: Draws initial states.
    """

    def __init__(self, num_envs: int, specs: Mapping[str, ArraySpec], draw: DrawInitialStates) -> None:
        self._count, self._specs, self._draw_states = num_envs, specs, draw
        self._depth = max(1, MIN_PREFETCH // num_envs)
        #: Number of the episode whose initial state each place contains, -1 for none, shape (N, depth).
        self._drawn: IntArray = np.full((num_envs, self._depth), -1, dtype=np.int64)
        self._state: State | None = None
        self._statistics: dict[str, AnyArray] = {}
        self._small: dict[int, State] = {}

    def forget(self) -> None:
        """Clear the cache, because the episodes have changed."""
        self._drawn[...] = -1

    def take(self, rows: IntArray, episodes: IntArray) -> tuple[State, dict[str, AnyArray]]:
        """Return the initial states of the next episode of some rows.

        Args:
            rows: Indices of the rows, shape (R,).
            episodes: Number of the current episode of every row, shape (N,); incremented in place for the given rows.

        Returns:
            The initial state of these rows, which the next call may overwrite, and the statistics of its draw.
        """
        if self._state is None:
            self._state = State(self._count * self._depth, self._specs)
        episodes[rows] += 1
        places = episodes[rows] % self._depth
        if (self._drawn[rows, places] != episodes[rows]).any():
            self._draw(episodes + (~np.isin(np.arange(self._count), rows)).astype(np.int64))
        size = len(rows)
        taken = self._state.take(rows * self._depth + places, self._small.get(size))
        if size <= _SMALL:
            self._small[size] = taken
        return taken, {name: array[rows * self._depth + places] for name, array in self._statistics.items()}

    def _draw(self, following: IntArray) -> None:
        """Draw the missing initial states, starting from these episodes, shape (N,)."""
        assert self._state is not None
        wanted = following[:, None] + np.arange(self._depth)
        places = wanted % self._depth
        due, later = np.nonzero(np.take_along_axis(self._drawn, places, axis=1) != wanted)
        episodes, where = wanted[due, later], due * self._depth + places[due, later]
        fresh, statistics = self._draw_states(due, episodes)
        self._state.put(where, fresh)
        for name, array in statistics.items():
            self._statistics.setdefault(name, np.zeros(self._count * self._depth, array.dtype))[where] = array
        self._drawn[due, places[due, later]] = episodes
