"""Changes at random: of the burns of a path, and of the steps at which points are looked at. Compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from safe_inspect.compiling import njit
from safe_inspect.planning.course import Course, track
from safe_inspect.policies.search import draw
from safe_inspect.types import FloatArray, IntArray

Seed = NDArray[np.uint64]

#: Smallest and largest size of a further burn, as powers of ten [m/s].
_SMALLEST, _LARGEST = -3.3, -1.0
#: A burn begins in this share of the episode.
_EARLY = 0.7
#: Tries to find another step at which a point is lit.
_TRIES = 20


@njit
def kick(
    course: Course, seed: Seed, smallest: float, largest: float, start: IntArray, delta_v: FloatArray, k: int
) -> None:
    """Write burn k: at the beginning or at any time, of a size between two powers of ten [m/s], along some axes."""
    size = 10.0 ** (smallest + (largest - smallest) * draw(seed))
    start[k] = int(draw(seed) * _EARLY * (course.coast.shape[0] - 1)) if draw(seed) < 0.6 else 0
    for axis in range(3):
        delta_v[k, axis] = size * (2.0 * draw(seed) - 1.0) if draw(seed) < 0.6 else 0.0


@njit
def vary(
    course: Course, seed: Seed, start: IntArray, delta_v: FloatArray, count: int, stride: int, position: FloatArray
) -> None:
    """Write the path with a further burn, or with a burn lessened or moved; the burns themselves stay.

    Args:
        course: The episode.
        seed: State of the random numbers; read and written.
        start: First step of each burn, with room for one more.
        delta_v: Velocity changes [m/s], likewise.
        count: How many burns there are.
        stride: As in `track`.
        position: As there.
    """
    kind = draw(seed)
    if kind < 0.5 or count == 0:
        kick(course, seed, _SMALLEST, _LARGEST, start, delta_v, count)
        track(course, start, delta_v, count + 1, stride, position)
        return
    k = int(draw(seed) * count)
    begin, burn = start[k], delta_v[k].copy()
    if kind < 0.8:
        share = draw(seed)
        for axis in range(3):
            delta_v[k, axis] *= share
    else:
        shift = 1.5 * 10.0 ** (2.3 * draw(seed)) * (2.0 * draw(seed) - 1.0)
        start[k] = max(0, min(course.coast.shape[0] - 2, begin + int(shift)))
    track(course, start, delta_v, count, stride, position)
    start[k] = begin
    for axis in range(3):
        delta_v[k, axis] = burn[axis]


@njit
def other_looks(course: Course, seed: Seed, stride: int, tight: IntArray, tights: int, look: IntArray) -> None:
    """Move the looks at one or two of the points that cost fuel to any step at which they are lit.

    Args:
        course: The episode.
        seed: State of the random numbers; read and written.
        stride: Looks are at multiples of it.
        tight: Points that cost fuel.
        tights: How many they are.
        look: Step of the look at each point, shape (P,); read and written.
    """
    for _ in range(1 + int(2.0 * draw(seed))):
        p = tight[int(draw(seed) * tights)]
        for _ in range(_TRIES):
            j = (1 + int(draw(seed) * ((course.coast.shape[0] - 1) // stride))) * stride
            if j < course.coast.shape[0] and course.lit[j, p]:
                look[p] = j
                break
