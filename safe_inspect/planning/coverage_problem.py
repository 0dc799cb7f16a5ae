"""`CoverageProblem`: the data of a plan for one episode, the positions after burns, and random changes of plans."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.step_maps import StepMaps
from safe_inspect.random.splitmix import SplitMixState, next_uniform
from safe_inspect.types import BoolArray, FloatArray, IntArray


def sight_range(radius: float, field_of_view: float) -> float:
    """Return the range beyond which a camera that points at the centre has a whole sphere in view [m].

    It is ``radius / sin(field_of_view / 2)``; from there on every point above the horizon is in view.

    Args:
        radius: Radius of the sphere [m].
        field_of_view: Full angle of the camera's cone [rad].
    """
    half = field_of_view / 2.0
    return radius if half >= math.pi / 2.0 else radius / math.sin(half)


class CoverageProblem(NamedTuple):
    """One episode of one deputy: J steps from its reset, in SI units and Hill's frame, about the chief's centre.

    Attributes:
        impulse_response: Change of the position m steps after the start of a burn of 1 m/s along each axis, held over
            `hold` steps [s], shape (J + 1, 3, 3). Only radial and along-track motion are coupled.
        hold: Number of steps of a burn.
        coast: Position after 0, 1, ... steps without thrust [m], shape (J + 1, 3).
        control_authority: Largest response within 0, 1, ... steps [s], in the orbital plane and across it, shape (J +
            1, 2).
        normals: Outward unit vectors of the points that are not inspected at the reset, shape (P, 3).
        slopes: Magnitudes of the normals' components in the orbital plane and across it, shape (P, 2).
        lit: Whether the points are lit after 0, 1, ... steps, shape (J + 1, P).
        radius: Height above the centre from which a point is seen: the dot product of its normal and the position is at
            least this [m].
        near: Least range [m].
        far: Largest range [m].
    """

    impulse_response: FloatArray
    hold: int
    coast: FloatArray
    control_authority: FloatArray
    normals: FloatArray
    slopes: FloatArray
    lit: BoolArray
    radius: float
    near: float
    far: float


@njit
def impulse_responses(maps: StepMaps, steps: int, hold: int) -> FloatArray:
    """Return `CoverageProblem.impulse_response`, shape (steps + 1, 3, 3).

    Args:
        maps: The maps of up to `steps` steps.
        steps: Number of steps.
        hold: Number of steps of a burn.
    """
    response = np.zeros((steps + 1, 3, 3))
    for m in range(1, steps + 1):
        burning = min(m, hold)
        for i in range(3):
            for axis in range(3):
                total = 0.0
                for j in range(6):
                    total += maps.phi[m - burning, i, j] * maps.gamma[burning, j, axis]
                response[m, i, axis] = total / (hold * maps.step_size)
    return response


@njit
def control_authorities(response: FloatArray) -> FloatArray:
    """Return `CoverageProblem.control_authority`, shape (J + 1, 2)."""
    authority = np.zeros((response.shape[0], 2))
    for m in range(1, response.shape[0]):
        plane, across = authority[m - 1, 0], authority[m - 1, 1]
        for axis in range(2):
            plane = max(plane, math.sqrt(response[m, 0, axis] ** 2 + response[m, 1, axis] ** 2))
        authority[m, 0], authority[m, 1] = plane, max(across, abs(response[m, 2, 2]))
    return authority


@njit
def write_positions(
    problem: CoverageProblem, start: IntArray, delta_v: FloatArray, count: int, stride: int, position: FloatArray
) -> None:
    """Write the position after 0, `stride`, 2 `stride`, ... steps [m], shape (J + 1, 3); other rows do not change.

    Args:
        problem: The episode.
        start: First step of each burn, shape (K,).
        delta_v: Velocity change of each burn [m/s], shape (K, 3).
        count: Number of burns.
        stride: Number of steps between two positions.
        position: Output: the positions.
    """
    response, last = problem.impulse_response, position.shape[0]
    position[::stride] = problem.coast[::stride]
    for k in range(count):
        x, y, z = delta_v[k, 0], delta_v[k, 1], delta_v[k, 2]
        first = (start[k] // stride + 1) * stride
        for j in range(first, last, stride):
            m = j - start[k]
            position[j, 0] += response[m, 0, 0] * x + response[m, 0, 1] * y
            position[j, 1] += response[m, 1, 0] * x + response[m, 1, 1] * y
            position[j, 2] += response[m, 2, 2] * z


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
        delta_v[k] *= next_uniform(seed)
    else:
        shift = 1.5 * 10.0 ** (2.3 * next_uniform(seed)) * (2.0 * next_uniform(seed) - 1.0)
        start[k] = max(0, min(problem.coast.shape[0] - 2, begin + int(shift)))
    write_positions(problem, start, delta_v, count, stride, position)
    start[k], delta_v[k] = begin, burn


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
