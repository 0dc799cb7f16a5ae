"""Counter-based random numbers: one stream for each environment slot and episode.

A draw is a pure function of (seed, slot, episode, purpose, index); no generator
carries a state. So a result depends neither on the size of the batch, nor on the
number of workers, nor on the order in which quantities are drawn.

The bijection is Philox4x32-10 (Salmon et al., "Parallel random numbers: as easy as
1, 2, 3", SC 2011), here over whole arrays of counters at once.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from safe_inspect.types import FloatArray, IntArray

_WORD = np.uint64(0xFFFFFFFF)
_SHIFT = np.uint64(32)
_MULTIPLIERS = (np.uint64(0xD2511F53), np.uint64(0xCD9E8D57))
_WEYL = (0x9E3779B9, 0xBB67AE85)
_ROUNDS = 10

Words = NDArray[np.uint64]


def philox4x32(counter: tuple[Words, Words, Words, Words], key: tuple[int, int]) -> tuple[Words, Words, Words, Words]:
    """Return the four 32-bit words of Philox4x32-10 for each counter.

    Args:
        counter: Four words, least significant first, each an array of one shape (values below 2**32).
        key: Two 32-bit words.
    """
    c0, c1, c2, c3 = counter
    k0, k1 = key
    for _ in range(_ROUNDS):
        p0, p1 = _MULTIPLIERS[0] * c0, _MULTIPLIERS[1] * c2
        c0, c1, c2, c3 = (
            (p1 >> _SHIFT) ^ c1 ^ np.uint64(k0),
            p1 & _WORD,
            (p0 >> _SHIFT) ^ c3 ^ np.uint64(k1),
            p0 & _WORD,
        )
        k0, k1 = (k0 + _WEYL[0]) & 0xFFFFFFFF, (k1 + _WEYL[1]) & 0xFFFFFFFF
    return c0, c1, c2, c3


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
            purpose: What is drawn, such as ``init_state.radius``; two purposes are independent.
            count: How many words a row.
            index: Number of the draw, for repeated draws of one purpose (below 2**20).
        """
        blocks = -(-count // 2)
        block = np.arange(blocks, dtype=np.uint64) + np.uint64(index << 12)
        shape = (len(self), blocks)
        rows = (np.asarray(part).astype(np.uint64)[:, None] & _WORD for part in (self.episode, self.slot))
        episode, slot = (np.broadcast_to(part, shape) for part in rows)
        name = np.full(shape, zlib.crc32(purpose.encode()), dtype=np.uint64)
        key = (self.seed & 0xFFFFFFFF, (self.seed >> 32) & 0xFFFFFFFF)
        w0, w1, w2, w3 = philox4x32((np.broadcast_to(block, shape), name, episode, slot), key)
        return np.stack(((w0 << _SHIFT) | w1, (w2 << _SHIFT) | w3), axis=-1).reshape(len(self), 2 * blocks)[:, :count]

    def uniform(self, purpose: str, count: int = 1, index: int = 0) -> FloatArray:
        """Return uniform numbers in [0, 1) with 53 random bits, shape (R, count)."""
        return (self.bits(purpose, count, index) >> np.uint64(11)).astype(np.float64) * 2.0**-53

    def interior(self, purpose: str, count: int = 1, index: int = 0) -> FloatArray:
        """Return uniform numbers in (0, 1), whose quantiles are finite, shape (R, count)."""
        return np.minimum(self.uniform(purpose, count, index) + 2.0**-54, 1.0 - 2.0**-53)

    def normal(self, purpose: str, count: int = 1, index: int = 0) -> FloatArray:
        """Return standard normal numbers by inversion, shape (R, count)."""
        from scipy.special import ndtri  # slow to import, and most configurations draw uniformly

        return np.asarray(ndtri(self.interior(purpose, count, index)))
