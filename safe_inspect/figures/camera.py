"""`Moment`: an episode at one time, interpolated between recorded states for animations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from safe_inspect.dynamics.quaternion import continuous, normalise, rotate
from safe_inspect.evaluation.trajectory import Trajectory
from safe_inspect.tasks.inspection.sun import sun_directions
from safe_inspect.types import BoolArray, FloatArray


@dataclass(frozen=True)
class Moment:
    """An episode at one time.

    Attributes:
        time: Time since the reset [s].
        position: Position of each deputy [m], shape (D, 3).
        delta_v: Velocity change that each deputy has spent [m/s], shape (D,).
        sun: Unit vector to the sun, shape (3,); None in a task without a sun.
        seen: Mask of the inspected points, shape (P,).
        lit: Mask of the points on the sun's side, shape (P,); all False without a sun.
        points: Position of the points about the chief's centre [m], shape (P, 3).
        row: Index of the last recorded state that is not later.
    """

    time: float
    position: FloatArray
    delta_v: FloatArray
    sun: FloatArray | None
    seen: BoolArray
    lit: BoolArray
    points: FloatArray
    row: int


def moment(episode: Trajectory, time: float) -> Moment:
    """Return an episode at a time [s]; between two recorded states the deputies follow a cubic.

    The cubic has the recorded positions and velocities at its ends.
    """
    time = float(np.clip(time, episode.time[0], episode.time[-1]))
    row = int(np.clip(np.searchsorted(episode.time, time, side="right") - 1, 0, len(episode.time) - 2))
    step = float(episode.time[row + 1] - episode.time[row])
    u = (time - float(episode.time[row])) / step
    here, there = episode.position[row], episode.position[row + 1]
    leaving, arriving = step * episode.velocity[row], step * episode.velocity[row + 1]
    position = (
        (2.0 * u**3 - 3.0 * u**2 + 1.0) * here
        + (u**3 - 2.0 * u**2 + u) * leaving
        + (3.0 * u**2 - 2.0 * u**3) * there
        + (u**3 - u**2) * arriving
    )
    points, sun, lit = episode.points, None, np.zeros(len(episode.points), dtype=np.bool_)
    if "chief_orientation" in episode.arrays:
        first, second = continuous(
            episode.chief_orientation[None, row : row + 2], episode.chief_orientation[None, row]
        )[0]
        points = rotate(normalise((1.0 - u) * first + u * second), points)
    if "sun_angle" in episode.arrays:
        sun = sun_directions((1.0 - u) * episode.sun_angle[row] + u * episode.sun_angle[row + 1])
        lit = points @ sun > 0.0
    last = row + 1 if u >= 1.0 else row
    return Moment(time, position, episode.delta_v[last], sun, episode.inspected_at <= time, lit, points, last)
