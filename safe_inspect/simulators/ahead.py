"""`Ahead`: the beginnings of the next episodes, drawn for many environments at a time.

How an episode begins is a function of the run's seed, the slot and the number of the episode alone. So the next one of
every slot can be drawn before the current one ends, for all slots together: one row takes as long as a hundred. A small
batch draws several episodes of each slot.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from safe_inspect.simulators.state import ArraySpec, State
from safe_inspect.types import AnyArray, IntArray

#: Draws the beginning of an episode of some rows: their indices and the numbers of the episodes to the fresh state of
#: these rows and the statistics of the draw.
Begin = Callable[[IntArray, IntArray], tuple[State, dict[str, AnyArray]]]

#: A smaller batch than this draws so many beginnings at a time.
DEEP = 32
#: States of up to this many rows are kept and used again.
_SMALL = 96


class Ahead:
    """Keeps the next beginnings of every row.

    Args:
        num_envs: Number of environments, N.
        specs: The arrays of their states.
        begin: Draws beginnings.
    """

    def __init__(self, num_envs: int, specs: Mapping[str, ArraySpec], begin: Begin) -> None:
        self._count, self._specs, self._begin = num_envs, specs, begin
        self._depth = max(1, DEEP // num_envs)
        #: Number of the episode whose beginning is kept in each place, -1 for none, shape (N, depth).
        self._drawn: IntArray = np.full((num_envs, self._depth), -1, dtype=np.int64)
        self._state: State | None = None
        self._facts: dict[str, AnyArray] = {}
        self._small: dict[int, State] = {}

    def forget(self) -> None:
        """Draw everything anew: the episodes have changed."""
        self._drawn[...] = -1

    def take(self, rows: IntArray, episodes: IntArray) -> tuple[State, dict[str, AnyArray]]:
        """Begin the next episode of some rows.

        Args:
            rows: Their indices, shape (R,).
            episodes: Number of the current episode of every row, shape (N,); that of these rows is counted up.

        Returns:
            The fresh state of these rows, which the next call may overwrite, and the statistics of its draw.
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
        return taken, {name: array[rows * self._depth + places] for name, array in self._facts.items()}

    def _draw(self, following: IntArray) -> None:
        """Draw what is not there yet of the episodes from these on, shape (N,)."""
        assert self._state is not None
        wanted = following[:, None] + np.arange(self._depth)
        places = wanted % self._depth
        due, ahead = np.nonzero(np.take_along_axis(self._drawn, places, axis=1) != wanted)
        episodes, where = wanted[due, ahead], due * self._depth + places[due, ahead]
        fresh, facts = self._begin(due, episodes)
        self._state.put(where, fresh)
        for name, array in facts.items():
            self._facts.setdefault(name, np.zeros(self._count * self._depth, array.dtype))[where] = array
        self._drawn[due, places[due, ahead]] = episodes
