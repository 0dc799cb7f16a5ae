"""Actions of stochastic policies, drawn by counter: the same numbers as the training's batched runner draws.

A draw is a function of (seed, slot, step, agent) and, as `rollout` flies the first episode of every slot, of the
episode 0. See `safe_inspect.random.streams` for the counters.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from safe_inspect.random.streams import Streams
from safe_inspect.types import AnyArray, FloatArray, IntArray

_HALF = np.uint64(32)
_WORD = np.uint64(0xFFFFFFFF)
_UNIT = 2.0**-32


def gaussian(inputs: AnyArray, seed: int, slots: IntArray, deputies: IntArray, step: int) -> FloatArray:
    """Return mean + exp(log_std) z with standard normal z, as float32 holds it, shape (R, A).

    Args:
        inputs: Means and logarithms of the standard deviations, shape (R, 2 A).
        seed: Seed of the draws.
        slots: Global index of each row's environment slot, shape (R,).
        deputies: Index of each row's deputy, shape (R,).
        step: Steps since the reset, below 2**20.
    """
    width = inputs.shape[1] // 2
    uniform = _uniform(width, seed, slots, deputies, step).reshape(len(inputs), -1, 2)
    # Box and Muller's transform of each pair.
    radius = np.sqrt(-2.0 * np.log(np.ascontiguousarray(uniform[:, :, 0])))
    angle = 2.0 * np.pi * (np.ascontiguousarray(uniform[:, :, 1]) - 0.5 * _UNIT)
    normal = np.stack((radius * np.cos(angle), radius * np.sin(angle)), axis=-1).reshape(len(inputs), -1)[:, :width]
    mean, deviation = inputs[:, :width].astype(np.float64), np.exp(inputs[:, width:].astype(np.float64))
    return np.asarray((mean + deviation * normal).astype(np.float32), dtype=np.float64)


def choices(
    inputs: AnyArray, sizes: Sequence[int], seed: int, slots: IntArray, deputies: IntArray, step: int
) -> IntArray:
    """Return an index for each element, drawn with the probabilities softmax(logits), shape (R, A).

    Args:
        inputs: Logits of all elements, one behind the other, shape (R, K_1 + ... + K_A).
        sizes: Number of values of each element, K_1 to K_A.
        seed: Seed of the draws.
        slots: Global index of each row's environment slot, shape (R,).
        deputies: Index of each row's deputy, shape (R,).
        step: Steps since the reset, below 2**20.
    """
    uniform = _uniform(len(sizes), seed, slots, deputies, step)
    chosen = np.zeros((len(inputs), len(sizes)), dtype=np.int64)
    first = 0
    for column, size in enumerate(sizes):
        logits = inputs[:, first : first + size].astype(np.float64)
        weight = np.exp(logits - logits.max(axis=1, keepdims=True))
        below = np.zeros(len(inputs))
        sums = []
        for level in range(size):  # one after the other, so that the order does not depend on the shape
            below = below + weight[:, level]
            sums.append(below)
        for level in range(size - 1):
            chosen[:, column] += sums[level] < uniform[:, column] * sums[-1]
        first += size
    return chosen


def _uniform(width: int, seed: int, slots: IntArray, deputies: IntArray, step: int) -> FloatArray:
    """Return numbers in (0, 1), a multiple of four a row, shape (R, 4 ceil(A / 4))."""
    blocks = (width + 3) // 4
    streams = Streams(seed, slots, np.zeros_like(slots))
    bits = streams.bits("action", 2 * blocks * (int(deputies.max(initial=0)) + 1), step)
    own = 2 * blocks * deputies[:, None] + np.arange(2 * blocks)
    pairs = np.take_along_axis(bits, own, axis=1)
    words = np.stack((pairs >> _HALF, pairs & _WORD), axis=-1).reshape(len(slots), 4 * blocks)
    return np.asarray((words.astype(np.float64) + 0.5) * _UNIT)
