"""Random numbers of a deputy within an episode, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from safe_inspect.compiling import njit
from safe_inspect.random.philox import philox4x32
from safe_inspect.types import FloatArray, IntArray

_WORD = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(32)
_DROP = np.uint64(11)  # bits to drop of 64, as a double has 53
_PURPOSE = np.uint64(0x5C217ED)  # makes these samples independent of others with the episode's key


@njit
def uniform(key: NDArray[np.uint64], step: IntArray, deputy: IntArray, count: int) -> FloatArray:
    """Return uniform numbers in [0, 1), each a pure function of its row's key, step and deputy, shape (R, count).

    Args:
        key: Random key of the episode, shape (R,).
        step: Steps since the reset, shape (R,).
        deputy: Index of the deputy, shape (R,).
        count: Number of samples per row.
    """
    out = np.empty((key.shape[0], count))
    for row in range(key.shape[0]):
        for number in range(count):
            high, low, _, _ = philox4x32(
                np.uint64(step[row]) & _WORD,
                np.uint64(deputy[row]) & _WORD,
                np.uint64(number),
                _PURPOSE,
                key[row] & _WORD,
                key[row] >> _HALF,
            )
            out[row, number] = ((high << _HALF | low) >> _DROP) * 2.0**-53
    return out
