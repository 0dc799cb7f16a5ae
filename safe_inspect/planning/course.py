"""`Course`: all that a plan for one episode depends on, and how positions answer to burns. Compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.types import BoolArray, FloatArray, IntArray


class Course(NamedTuple):
    """One episode of one deputy: J steps from its beginning, in SI units and Hill's frame, about the chief's centre.

    Attributes:
        answer: Change of the position m steps after the beginning of a burn of 1 m/s along each axis, held over `hold`
            steps [s], shape (J + 1, 3, 3). Only radial and along-track motion mix.
        hold: Number of steps of a burn.
        coast: Position after 0, 1, ... steps without thrust [m], shape (J + 1, 3).
        lever: Largest answer within so many steps [s], in the orbit's plane and across it, shape (J + 1, 2).
        normals: Outward unit vectors of the points that are not inspected at the beginning, shape (P, 3).
        slopes: Their shares in the orbit's plane and across it, shape (P, 2).
        lit: Whether they are lit after 0, 1, ... steps, shape (J + 1, P).
        radius: Height above the centre from which a point is seen: its normal times the position is at least this [m].
        near: Least range [m].
        far: Largest range [m].
    """

    answer: FloatArray
    hold: int
    coast: FloatArray
    lever: FloatArray
    normals: FloatArray
    slopes: FloatArray
    lit: BoolArray
    radius: float
    near: float
    far: float


@njit
def answers(gamma: FloatArray, phi: FloatArray, step_size: float, steps: int, hold: int) -> FloatArray:
    """Return `Course.answer`, shape (steps + 1, 3, 3).

    Args:
        gamma: Input matrices of a body of 1 kg by the number of steps, shape (J + 1, 6, 3).
        phi: Transition matrices likewise, shape (J + 1, 6, 6).
        step_size: Length of a step [s].
        steps: Number of steps.
        hold: Number of steps of a burn.
    """
    answer = np.zeros((steps + 1, 3, 3))
    for m in range(1, steps + 1):
        burning = min(m, hold)
        for i in range(3):
            for axis in range(3):
                total = 0.0
                for j in range(6):
                    total += phi[m - burning, i, j] * gamma[burning, j, axis]
                answer[m, i, axis] = total / (hold * step_size)
    return answer


@njit
def levers(answer: FloatArray) -> FloatArray:
    """Return `Course.lever`, shape (J + 1, 2)."""
    lever = np.zeros((answer.shape[0], 2))
    for m in range(1, answer.shape[0]):
        plane, across = lever[m - 1, 0], lever[m - 1, 1]
        for axis in range(2):
            plane = max(plane, math.sqrt(answer[m, 0, axis] ** 2 + answer[m, 1, axis] ** 2))
        lever[m, 0], lever[m, 1] = plane, max(across, abs(answer[m, 2, 2]))
    return lever


@njit
def track(course: Course, start: IntArray, delta_v: FloatArray, count: int, stride: int, position: FloatArray) -> None:
    """Write the position after 0, `stride`, 2 `stride`, ... steps [m], shape (J + 1, 3); the other rows stay.

    Args:
        course: The episode.
        start: First step of each burn, shape (K,).
        delta_v: Velocity change of each burn [m/s], shape (K, 3).
        count: How many burns there are.
        stride: The position is wanted after every so-many-th step.
        position: Receives the positions.
    """
    answer, last = course.answer, position.shape[0]
    for j in range(0, last, stride):
        for i in range(3):
            position[j, i] = course.coast[j, i]
    for k in range(count):
        x, y, z = delta_v[k, 0], delta_v[k, 1], delta_v[k, 2]
        first = (start[k] // stride + 1) * stride
        for j in range(first, last, stride):
            m = j - start[k]
            position[j, 0] += answer[m, 0, 0] * x + answer[m, 0, 1] * y
            position[j, 1] += answer[m, 1, 0] * x + answer[m, 1, 1] * y
            position[j, 2] += answer[m, 2, 2] * z
