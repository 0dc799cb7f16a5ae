"""Random integers in compiled kernels: pure functions of a key, without state."""

from __future__ import annotations

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.random.splitmix import mix


@njit
def pick_below(key: np.uint64, step: int, pick: int, below: int) -> np.int64:
    """Return a whole number in [0, below), a pure function of key, step and pick."""
    weyl = np.uint64(0x9E3779B97F4A7C15)
    word = mix(key + weyl * np.uint64(step + 1))
    word = mix(word + weyl * np.uint64(pick + 1))
    return np.int64(word % np.uint64(below))
