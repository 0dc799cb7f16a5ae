"""Philox4x32-10, compiled: the bijection that `safe_inspect.random.streams` uses.

Source:
    Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from safe_inspect.compiling import njit

Words = NDArray[np.uint64]

_WORD = np.uint64(0xFFFFFFFF)
_SHIFT = np.uint64(32)
_MULTIPLIER_0, _MULTIPLIER_1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_WEYL_0, _WEYL_1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_INDEX_SHIFT = np.uint64(12)


@njit
def philox4x32(
    c0: np.uint64, c1: np.uint64, c2: np.uint64, c3: np.uint64, k0: np.uint64, k1: np.uint64
) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """Return the four output words for a counter and a key, all 32-bit words, least significant first."""
    for _ in range(10):
        p0, p1 = _MULTIPLIER_0 * c0, _MULTIPLIER_1 * c2
        c0, c1, c2, c3 = (p1 >> _SHIFT) ^ c1 ^ k0, p1 & _WORD, (p0 >> _SHIFT) ^ c3 ^ k1, p0 & _WORD
        k0, k1 = (k0 + _WEYL_0) & _WORD, (k1 + _WEYL_1) & _WORD
    return c0, c1, c2, c3


@njit
def draw_bits(seed: np.uint64, slot: Words, episode: Words, name: np.uint64, index: np.uint64, count: int) -> Words:
    """Return `count` 64-bit words for each row, shape (R, count).

    The counter is (block and index, name, episode, slot), and the key is the seed.
    """
    rows = slot.shape[0]
    out = np.empty((rows, count), np.uint64)
    for r in range(rows):
        for block in range((count + 1) // 2):
            w0, w1, w2, w3 = philox4x32(
                np.uint64(block) + (index << _INDEX_SHIFT),
                name,
                episode[r] & _WORD,
                slot[r] & _WORD,
                seed & _WORD,
                seed >> _SHIFT,
            )
            out[r, 2 * block] = (w0 << _SHIFT) | w1
            if 2 * block + 1 < count:
                out[r, 2 * block + 1] = (w2 << _SHIFT) | w3
    return out
