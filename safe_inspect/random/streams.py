"""Counter-based random numbers: one stream for each environment slot and episode.

A draw is a pure function of (seed, slot, episode, purpose, index); there is no generator
with a state. Therefore a result depends neither on the size of the batch, nor on the
number of workers, nor on the order in which quantities are sampled.

The bijection is Philox4x32-10 (Salmon et al., "Parallel random numbers: as easy as
1, 2, 3", SC 2011), see `safe_inspect.random.philox`.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from safe_inspect.random.philox import Words, draw_bits
from safe_inspect.types import FloatArray, IntArray


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
