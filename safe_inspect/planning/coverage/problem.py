"""`CoverageProblem`: the data on which a plan for one episode depends, and how positions respond to burns. Compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.step_maps import StepMaps
from safe_inspect.types import BoolArray, FloatArray, IntArray


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
    for j in range(0, last, stride):
        for i in range(3):
            position[j, i] = problem.coast[j, i]
    for k in range(count):
        x, y, z = delta_v[k, 0], delta_v[k, 1], delta_v[k, 2]
        first = (start[k] // stride + 1) * stride
        for j in range(first, last, stride):
            m = j - start[k]
            position[j, 0] += response[m, 0, 0] * x + response[m, 0, 1] * y
            position[j, 1] += response[m, 1, 0] * x + response[m, 1, 1] * y
            position[j, 2] += response[m, 2, 2] * z
