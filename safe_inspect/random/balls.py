"""Random numbers, and vectors of bounded length, in compiled kernels: pure functions of a key, without state."""

from __future__ import annotations

import math

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.random.splitmix import mix
from safe_inspect.types import AnyArray, FloatArray, IntArray

_WEYL = np.uint64(0x9E3779B97F4A7C15)
_PURPOSE = np.uint64(0xD1B54A32D192ED03)


@njit
def uniform_at(key: np.uint64, step: int, pick: int) -> float:
    """Return a uniform number in [0, 1), a pure function of key, step and pick; independent of `pick_below`."""
    word = mix((key ^ _PURPOSE) + _WEYL * np.uint64(step + 1))
    word = mix(word + _WEYL * np.uint64(pick + 1))
    return float(word >> np.uint64(11)) * 2.0**-53


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
