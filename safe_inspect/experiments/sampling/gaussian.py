"""Actions of Gaussian policies, drawn by counter: a draw is a function of (seed, slot, episode, step, agent).

So the same seed gives the same actions, however many environments stand in a batch and however many runners
share them.
"""

from __future__ import annotations

import math
import zlib

import numpy as np
from numpy.typing import NDArray

from safe_inspect.compiling import njit
from safe_inspect.random.philox import philox4x32
from safe_inspect.types import AnyArray, FloatArray, IntArray

Words = NDArray[np.uint64]

ACTION = np.uint64(zlib.crc32(b"action"))
WORD = np.uint64(0xFFFFFFFF)
SHIFT = np.uint64(32)
STEP_SHIFT = np.uint64(12)
UNIT = 2.0**-32
_HALF_LOG_2PI = 0.5 * math.log(2.0 * math.pi)


@njit
def draw_actions(
    inputs: AnyArray,
    explore: bool,
    seed: np.uint64,
    slot: Words,
    episode: IntArray,
    step: IntArray,
    agent: int,
    action: AnyArray,
    log_probability: AnyArray,
) -> None:
    """Draw the actions of one agent in N environments; see `Gaussian noise` for the counters.

    The action is mean + exp(log_std) z with standard normal z; its log-probability is that of the float32 action.

    Args:
        inputs: Mean and logarithm of the standard deviation, float32, shape (N, 2 A).
        explore: False: the action is the mean.
        seed: The seed of the run.
        slot: Global index of each environment slot, shape (N,).
        episode: Index of the episode within its slot, shape (N,).
        step: Steps since the reset, below 2**20, shape (N,).
        agent: Index of the deputy; below 4096 / ceil(A / 4).
        action: Receives the actions, float32, shape (N, A).
        log_probability: Receives the logarithms of their densities, float32, shape (N,).
    """
    rows, width = action.shape
    blocks = (width + 3) // 4
    normal = np.empty(4)
    for n in range(rows):
        density = 0.0
        for block in range(blocks):
            if explore:
                _normals(seed, slot[n], episode[n], step[n], agent * blocks + block, normal)
            else:
                normal[:] = 0.0
            for j in range(4 * block, min(4 * block + 4, width)):
                mean, log_std = np.float64(inputs[n, j]), np.float64(inputs[n, width + j])
                std = math.exp(log_std)
                action[n, j] = np.float32(mean + std * normal[j - 4 * block])
                z = (np.float64(action[n, j]) - mean) / std
                density -= 0.5 * z * z + log_std + _HALF_LOG_2PI
        log_probability[n] = np.float32(density)


@njit
def _normals(seed: np.uint64, slot: np.uint64, episode: int, step: int, block: int, normal: FloatArray) -> None:
    """Write four independent standard normal numbers, by Box and Muller's transform of one Philox block."""
    w0, w1, w2, w3 = philox4x32(
        np.uint64(block) + (np.uint64(step) << STEP_SHIFT),
        ACTION,
        np.uint64(episode) & WORD,
        slot & WORD,
        seed & WORD,
        seed >> SHIFT,
    )
    radius = math.sqrt(-2.0 * math.log((np.float64(w0) + 0.5) * UNIT))
    angle = 2.0 * math.pi * np.float64(w1) * UNIT
    normal[0], normal[1] = radius * math.cos(angle), radius * math.sin(angle)
    radius = math.sqrt(-2.0 * math.log((np.float64(w2) + 0.5) * UNIT))
    angle = 2.0 * math.pi * np.float64(w3) * UNIT
    normal[2], normal[3] = radius * math.cos(angle), radius * math.sin(angle)
