"""SplitMix64 in compiled kernels, and numbers and vectors that are pure functions of a key, without state.

Source: Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from safe_inspect.compiling import njit
from safe_inspect.types import AnyArray, FloatArray, IntArray

#: State of a generator: one word, shape (1,).
SplitMixState = NDArray[np.uint64]

_WEYL = np.uint64(0x9E3779B97F4A7C15)
_PURPOSE = np.uint64(0xD1B54A32D192ED03)


@njit
def mix(word: np.uint64) -> np.uint64:
    """Return the output function of SplitMix64 for a 64-bit word."""
    word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return word ^ (word >> np.uint64(31))


@njit
def next_uniform(state: SplitMixState) -> float:
    """Return the next uniform number in [0, 1) of a generator, and update its state."""
    state[0] += _WEYL
    return float(mix(state[0]) >> np.uint64(11)) * 2.0**-53


@njit
def pick_below(key: np.uint64, step: int, pick: int, below: int) -> np.int64:
    """Return a whole number in [0, below), a pure function of key, step and pick."""
    return np.int64(_word_at(key, step, pick) % np.uint64(below))


@njit
def _word_at(key: np.uint64, step: int, pick: int) -> np.uint64:
    word = mix(key + _WEYL * np.uint64(step + 1))
    return mix(word + _WEYL * np.uint64(pick + 1))


@njit
def uniform_at(key: np.uint64, step: int, pick: int) -> float:
    """Return a uniform number in [0, 1), a pure function of key, step and pick; independent of `pick_below`."""
    return float(_word_at(key ^ _PURPOSE, step, pick) >> np.uint64(11)) * 2.0**-53


@njit
def normal_at(key: np.uint64, step: int, pick: int) -> float:
    """Return a standard normal number by the method of Box and Muller, a pure function of key, step and pick."""
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform_at(key, step, 2 * pick)))
    return radius * math.cos(2.0 * math.pi * uniform_at(key, step, 2 * pick + 1))


@njit
def draw_normals(
    key: AnyArray, step: IntArray, salt: np.uint64, first: int, agents: int, drawn: FloatArray
) -> None:  # fmt: skip
    """Write standard normal numbers for the agents of a group, shape (N G, size).

    Args:
        key: Key of each episode, shape (N,).
        step: Steps since the reset, shape (N,).
        salt: Number of the purpose.
        first: Index of the group's first deputy.
        agents: Number of agents of the group, G.
        drawn: Output.
    """
    for row in range(drawn.shape[0]):
        i, deputy = row // agents, first + row % agents
        own = mix(key[i] ^ mix(salt + _WEYL * np.uint64(deputy + 1)))
        for k in range(drawn.shape[1]):
            drawn[row, k] = normal_at(own, step[i], k)


@njit
def draw_in_ball(
    key: np.uint64, step: int, pick: int, radius: float, on_surface: bool
) -> tuple[float, float, float]:  # fmt: skip
    """Return a vector that is uniformly distributed in a ball, or on its surface.

    Args:
        key: Key of the episode.
        step: Steps since the reset.
        pick: Number of the draw, which uses the numbers from 4 pick to 4 pick + 2.
        radius: Radius of the ball.
        on_surface: Whether the length of the vector is the radius.
    """
    z = 2.0 * uniform_at(key, step, 4 * pick) - 1.0
    angle = 2.0 * math.pi * uniform_at(key, step, 4 * pick + 1)
    size = radius if on_surface else radius * uniform_at(key, step, 4 * pick + 2) ** (1.0 / 3.0)
    across = size * math.sqrt(max(0.0, 1.0 - z * z))
    return across * math.cos(angle), across * math.sin(angle), size * z
