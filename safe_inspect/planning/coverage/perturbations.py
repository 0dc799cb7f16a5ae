"""Random changes of the burns of a path, and of the steps at which points are seen. Compiled."""

from __future__ import annotations

from safe_inspect.compiling import njit
from safe_inspect.planning.coverage.problem import CoverageProblem, write_positions
from safe_inspect.random.splitmix import SplitMixState, next_uniform
from safe_inspect.types import FloatArray, IntArray

#: Smallest and largest size of an additional burn, as powers of ten [m/s].
_SMALLEST, _LARGEST = -3.3, -1.0
#: Share of the episode, from its start, in which burns start.
_EARLY = 0.7
#: Number of attempts to find another step at which a point is lit.
_TRIES = 20


@njit
def random_burn(
    problem: CoverageProblem,
    seed: SplitMixState,
    smallest: float,
    largest: float,
    start: IntArray,
    delta_v: FloatArray,
    k: int,
) -> None:
    """Write burn k at random: at the reset or later, of a size between two powers of ten [m/s], along some axes."""
    size = 10.0 ** (smallest + (largest - smallest) * next_uniform(seed))
    start[k] = int(next_uniform(seed) * _EARLY * (problem.coast.shape[0] - 1)) if next_uniform(seed) < 0.6 else 0
    for axis in range(3):
        delta_v[k, axis] = size * (2.0 * next_uniform(seed) - 1.0) if next_uniform(seed) < 0.6 else 0.0


@njit
def perturb_burns(
    problem: CoverageProblem,
    seed: SplitMixState,
    start: IntArray,
    delta_v: FloatArray,
    count: int,
    stride: int,
    position: FloatArray,
) -> None:
    """Write the path with an additional burn, or with a smaller or shifted burn; the burns themselves do not change.

    Args:
        problem: The episode.
        seed: State of the random numbers; read and written.
        start: First step of each burn, with space for one more.
        delta_v: Velocity changes [m/s], with space for one more.
        count: Number of burns.
        stride: See `write_positions`.
        position: See `write_positions`.
    """
    kind = next_uniform(seed)
    if kind < 0.5 or count == 0:
        random_burn(problem, seed, _SMALLEST, _LARGEST, start, delta_v, count)
        write_positions(problem, start, delta_v, count + 1, stride, position)
        return
    k = int(next_uniform(seed) * count)
    begin, burn = start[k], delta_v[k].copy()
    if kind < 0.8:
        share = next_uniform(seed)
        for axis in range(3):
            delta_v[k, axis] *= share
    else:
        shift = 1.5 * 10.0 ** (2.3 * next_uniform(seed)) * (2.0 * next_uniform(seed) - 1.0)
        start[k] = max(0, min(problem.coast.shape[0] - 2, begin + int(shift)))
    write_positions(problem, start, delta_v, count, stride, position)
    start[k] = begin
    for axis in range(3):
        delta_v[k, axis] = burn[axis]


@njit
def resample_sightings(
    problem: CoverageProblem, seed: SplitMixState, stride: int, tight: IntArray, tights: int, sighting: IntArray
) -> None:
    """Move the sightings of one or two of the points that cost fuel to random steps at which they are lit.

    Args:
        problem: The episode.
        seed: State of the random numbers; read and written.
        stride: Sightings are at multiples of it.
        tight: Points that cost fuel.
        tights: Number of these points.
        sighting: Step of the sighting of each point, shape (P,); read and written.
    """
    for _ in range(1 + int(2.0 * next_uniform(seed))):
        p = tight[int(next_uniform(seed) * tights)]
        for _ in range(_TRIES):
            j = (1 + int(next_uniform(seed) * ((problem.coast.shape[0] - 1) // stride))) * stride
            if j < problem.coast.shape[0] and problem.lit[j, p]:
                sighting[p] = j
                break
