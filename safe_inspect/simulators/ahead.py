"""`Ahead`: the beginnings of the next episodes, drawn for many environments at a time.

How an episode begins is a function of the run's seed, the slot and the number of the episode alone. So the next one of
every slot can be drawn before the current one ends, for all slots together: one row takes as long as a hundred.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from safe_inspect.simulators.state import ArraySpec, State
from safe_inspect.types import AnyArray, BoolArray, IntArray

#: Draws the beginning of an episode of some rows: their indices and the numbers of the episodes to the fresh state of
#: these rows and the statistics of the draw.
Begin = Callable[[IntArray, IntArray], tuple[State, dict[str, AnyArray]]]

#: States of up to this many rows are kept and used again.
_SMALL = 32


class Ahead:
    """Keeps the next beginning of every row.

    Args:
        num_envs: Number of environments, N.
        specs: The arrays of their states.
        begin: Draws beginnings.
    """

    def __init__(self, num_envs: int, specs: Mapping[str, ArraySpec], begin: Begin) -> None:
        self._count, self._specs, self._begin = num_envs, specs, begin
        self._drawn: BoolArray = np.zeros(num_envs, dtype=np.bool_)
        self._state: State | None = None
        self._facts: dict[str, AnyArray] = {}
        self._small: dict[int, State] = {}

    def forget(self) -> None:
        """Draw everything anew: the episodes have changed."""
        self._drawn[:] = False

    def take(self, rows: IntArray, episodes: IntArray) -> tuple[State, dict[str, AnyArray]]:
        """Begin the next episode of some rows.

        Args:
            rows: Their indices, shape (R,).
            episodes: Number of the current episode of every row, shape (N,); that of these rows is counted up.

        Returns:
            The fresh state of these rows, which the next call may overwrite, and the statistics of its draw.
        """
        if self._state is None:
            self._state = State(self._count, self._specs)
        if not self._drawn[rows].all():
            due = np.flatnonzero(~self._drawn)
            fresh, facts = self._begin(due, episodes[due] + 1)
            self._state.put(due, fresh)
            for name, array in facts.items():
                self._facts.setdefault(name, np.zeros(self._count, array.dtype))[due] = array
            self._drawn[due] = True
        episodes[rows] += 1
        self._drawn[rows] = False
        size = len(rows)
        taken = self._state.take(rows, self._small.get(size))
        if size <= _SMALL:
            self._small[size] = taken
        return taken, {name: array[rows] for name, array in self._facts.items()}
