"""Actions of categorical policies, drawn by counter as those of `safe_inspect.experiments.sampling.gaussian` are."""

from __future__ import annotations

import math

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.experiments.sampling.gaussian import ACTION, SHIFT, STEP_SHIFT, UNIT, WORD, Words
from safe_inspect.random.philox import philox4x32
from safe_inspect.types import AnyArray, IntArray


@njit
def draw_choices(
    inputs: AnyArray,
    sizes: IntArray,
    explore: bool,
    seed: np.uint64,
    slot: Words,
    episode: IntArray,
    step: IntArray,
    agent: int,
    action: AnyArray,
    log_probability: AnyArray,
) -> None:
    """Draw the actions of one agent in N environments: an index for each element, with probabilities softmax(logits).

    Args:
        inputs: Logits of all elements, one behind the other, float32, shape (N, K_1 + ... + K_A).
        sizes: Number of values of each element, K_1 to K_A, shape (A,).
        explore: False: the most likely index, the first of them.
        seed: The seed of the run.
        slot: Global index of each environment slot, shape (N,).
        episode: Index of the episode within its slot, shape (N,).
        step: Steps since the reset, below 2**20, shape (N,).
        agent: Index of the deputy; below 4096 / ceil(A / 4).
        action: Receives the indices, float32, shape (N, A).
        log_probability: Receives the logarithms of their probabilities, float32, shape (N,).
    """
    rows, width = action.shape
    blocks = (width + 3) // 4
    uniform = np.empty(4)
    for n in range(rows):
        first, total = 0, 0.0
        for j in range(width):
            if explore and j % 4 == 0:
                w0, w1, w2, w3 = philox4x32(
                    np.uint64(agent * blocks + j // 4) + (np.uint64(step[n]) << STEP_SHIFT),
                    ACTION,
                    np.uint64(episode[n]) & WORD,
                    slot[n] & WORD,
                    seed & WORD,
                    seed >> SHIFT,
                )
                uniform[0], uniform[1] = (np.float64(w0) + 0.5) * UNIT, (np.float64(w1) + 0.5) * UNIT
                uniform[2], uniform[3] = (np.float64(w2) + 0.5) * UNIT, (np.float64(w3) + 0.5) * UNIT
            size = sizes[j]
            best = 0
            for k in range(1, size):
                if inputs[n, first + k] > inputs[n, first + best]:
                    best = k
            largest = np.float64(inputs[n, first + best])
            mass = 0.0
            for k in range(size):
                mass += math.exp(np.float64(inputs[n, first + k]) - largest)
            chosen = best
            if explore:
                chosen, below = 0, math.exp(np.float64(inputs[n, first]) - largest)
                while chosen < size - 1 and below < uniform[j % 4] * mass:
                    chosen += 1
                    below += math.exp(np.float64(inputs[n, first + chosen]) - largest)
            action[n, j] = np.float32(chosen)
            total += np.float64(inputs[n, first + chosen]) - largest - math.log(mass)
            first += size
        log_probability[n] = np.float32(total)
