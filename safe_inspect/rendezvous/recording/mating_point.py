"""A mating point given by a pixel of a frame, for targets without a known model of the shape."""

from __future__ import annotations

import numpy as np

from safe_inspect.dynamics.quaternion import to_matrix
from safe_inspect.errors import ConfigError
from safe_inspect.rendezvous.poses import move
from safe_inspect.rendezvous.recording.estimation import LogEstimate
from safe_inspect.rendezvous.recording.reader import SensorLog
from safe_inspect.types import FloatArray

#: Half width of the window of pixels to which a surface's normal is fitted, and smallest number of valid pixels in it.
_WINDOW, _LEAST = 3, 8


def pick_point(log: SensorLog, frame: int, column: int, row: int, distance: float) -> FloatArray:
    """Return the point at a distance above the surface that a pixel sees, in B at that frame [m], shape (3,).

    The surface's normal is that of a plane fitted to the surrounding pixels, and points to the side of the camera.

    Args:
        log: The log.
        frame: Number of the frame.
        column: Column of the pixel.
        row: Row of the pixel.
        distance: Distance above the surface [m].

    Raises:
        ConfigError: The pixel does not exist or has no depth, or too few pixels around it see the same surface.
    """
    camera = log.description.camera
    if not (0 <= frame < len(log) and 0 <= column < camera.width and 0 <= row < camera.height):
        raise ConfigError(
            f"{log.folder}: frame {frame}, column {column}, row {row} is not in the log; it has {len(log)} frames of "
            f"{camera.width} x {camera.height} pixels, counted from 0"
        )
    image = log.frame(frame)
    if not image.valid[row, column]:
        raise ConfigError(
            f"{log.files[frame]}: column {column}, row {row} has no depth; pick a pixel of the target, see the figure "
            "that --output writes"
        )
    directions = camera.geometry.directions
    place = directions[row, column] * (image.depth[row, column] / directions[row, column, 2])
    window = np.s_[max(row - _WINDOW, 0) : row + _WINDOW + 1, max(column - _WINDOW, 0) : column + _WINDOW + 1]
    around = image.valid[window] & (np.abs(image.depth[window] - image.depth[row, column]) < 0.05)
    rays = directions[window][around]
    points = rays * (image.depth[window][around] / rays[:, 2])[:, None]
    if len(points) < _LEAST:
        raise ConfigError(
            f"{log.files[frame]}: only {len(points)} pixels around column {column}, row {row} see the same surface; "
            "pick a pixel farther from an edge"
        )
    normal = np.linalg.svd(points - points.mean(axis=0))[2][2]
    normal = -normal if normal @ place > 0.0 else normal
    found: FloatArray = move(log.T_BC, (place + distance * normal)[None])[0]
    return found


def in_principal_axes(log: SensorLog, estimate: LogEstimate, frame: int, point: FloatArray) -> FloatArray:
    """Return a point, given in B at a frame, in the estimated principal axes T from the centre of mass [m], shape (3,).

    The result is ``p_T = R_GT^T (T_GB p_B - o)``, where o is the centre of mass in G. If the graph no longer contains
    the attitude at the frame, the estimated motion gives it.

    Args:
        log: The log.
        estimate: The estimate from the log.
        frame: Number of the frame.
        point: Point in B [m], shape (3,).
    """
    R_WT = to_matrix(estimate.attitudes(log.times[frame : frame + 1])[0])  # noqa: N806
    near = int(np.abs(estimate.history.times - log.times[frame]).argmin())
    R_WB = to_matrix(estimate.history.chaser[near])  # noqa: N806
    return np.asarray(R_WT.T @ (R_WB @ point + estimate.chaser_positions[frame] - estimate.graph.centre))


def mating_point_text(point: FloatArray) -> str:
    """Return a mating point as text for the key ``mating_point`` of a target."""
    return "[" + ", ".join(f"{value:.4f} m" for value in point) + "]"
