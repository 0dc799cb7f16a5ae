"""Random picks inside compiled kernels: pure functions of a key, no state."""

from __future__ import annotations

import numpy as np

from safe_inspect.compiling import njit


@njit
def _mix(word: np.uint64) -> np.uint64:
    """Return the output function of SplitMix64 (Steele, Lea and Flood, 2014) of a 64-bit word."""
    word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return word ^ (word >> np.uint64(31))


@njit
def pick_below(key: np.uint64, step: int, pick: int, below: int) -> np.int64:
    """Return a whole number in [0, below), a pure function of key, step and pick."""
    weyl = np.uint64(0x9E3779B97F4A7C15)
    word = _mix(key + weyl * np.uint64(step + 1))
    word = _mix(word + weyl * np.uint64(pick + 1))
    return np.int64(word % np.uint64(below))
