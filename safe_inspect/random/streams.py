"""Counter-based random numbers: one stream for each environment slot and episode.

A draw is a pure function of (seed, slot, episode, purpose, index); there is no generator
with a state. Therefore a result depends neither on the size of the batch, nor on the
number of workers, nor on the order in which quantities are sampled.

Source:
    Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011, for the bijection Philox4x32-10.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from safe_inspect.compiling import njit
from safe_inspect.types import FloatArray, IntArray

Words = NDArray[np.uint64]

_WORD, _SHIFT = np.uint64(0xFFFFFFFF), np.uint64(32)
_MULTIPLIER_0, _MULTIPLIER_1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_WEYL_0, _WEYL_1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_INDEX_SHIFT = np.uint64(12)


@njit
def philox4x32(
    c0: np.uint64, c1: np.uint64, c2: np.uint64, c3: np.uint64, key: np.uint64
) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """Return the four 32-bit output words for a counter of four words and a 64-bit key, least significant first.

    The upper halves of the counter's words are ignored.
    """
    c0, c1, c2, c3 = c0 & _WORD, c1 & _WORD, c2 & _WORD, c3 & _WORD
    k0, k1 = key & _WORD, key >> _SHIFT
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
            place = np.uint64(block) + (index << _INDEX_SHIFT)
            w0, w1, w2, w3 = philox4x32(place, name, episode[r], slot[r], seed)
            out[r, 2 * block] = (w0 << _SHIFT) | w1
            if 2 * block + 1 < count:
                out[r, 2 * block + 1] = (w2 << _SHIFT) | w3
    return out


@dataclass(frozen=True, eq=False)
class Streams:
    """The random streams of R episodes.

    Attributes:
        seed: The seed of the run, 0 to 2**64 - 1.
        slot: Global index of the environment slot, shape (R,).
        episode: Index of the episode within its slot, shape (R,).
    """

    seed: int
    slot: IntArray
    episode: IntArray

    def __len__(self) -> int:
        return len(self.slot)

    def __getitem__(self, rows: IntArray | NDArray[np.bool_] | slice) -> Streams:
        """Return the streams of some rows (a mask, a slice or an array of indices)."""
        return Streams(self.seed, self.slot[rows], self.episode[rows])

    def bits(self, purpose: str, count: int = 1, index: int = 0) -> Words:
        """Return 64-bit words, shape (R, count).

        Args:
            purpose: Name of the sampled quantity, such as ``init_state.radius``; different purposes are independent.
            count: Number of words per row.
            index: Number of the draw, for repeated draws of one purpose (below 2**20).
        """
        words: Words = draw_bits(
            np.uint64(self.seed),
            self.slot.astype(np.uint64),
            self.episode.astype(np.uint64),
            np.uint64(zlib.crc32(purpose.encode())),
            np.uint64(index),
            count,
        )
        return words

    def uniform(self, purpose: str, count: int = 1, index: int = 0) -> FloatArray:
        """Return uniform numbers in [0, 1) with 53 random bits, shape (R, count)."""
        return (self.bits(purpose, count, index) >> np.uint64(11)).astype(np.float64) * 2.0**-53

    def interior(self, purpose: str, count: int = 1, index: int = 0) -> FloatArray:
        """Return uniform numbers in (0, 1), for which quantiles are finite, shape (R, count)."""
        return np.minimum(self.uniform(purpose, count, index) + 2.0**-54, 1.0 - 2.0**-53)

    def normal(self, purpose: str, count: int = 1, index: int = 0) -> FloatArray:
        """Return standard normal numbers by inversion, shape (R, count)."""
        from scipy.special import ndtri  # slow to import, and most configurations draw uniformly

        return np.asarray(ndtri(self.interior(purpose, count, index)))
