"""SplitMix64 in compiled kernels.

Source: Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from safe_inspect.compiling import njit

#: State of a generator: one word, shape (1,).
SplitMixState = NDArray[np.uint64]


@njit
def mix(word: np.uint64) -> np.uint64:
    """Return the output function of SplitMix64 for a 64-bit word."""
    word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return word ^ (word >> np.uint64(31))


@njit
def next_uniform(state: SplitMixState) -> float:
    """Return the next uniform number in [0, 1) of a generator, and update its state."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    return float(mix(state[0]) >> np.uint64(11)) * 2.0**-53


@njit
def pick_below(key: np.uint64, step: int, pick: int, below: int) -> np.int64:
    """Return a whole number in [0, below), a pure function of key, step and pick."""
    weyl = np.uint64(0x9E3779B97F4A7C15)
    word = mix(key + weyl * np.uint64(step + 1))
    word = mix(word + weyl * np.uint64(pick + 1))
    return np.int64(word % np.uint64(below))
