"""Cameras that rotate with their deputies: which lit points they see, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.rotation_row import Components, rotated
from safe_inspect.geometry.visibility import Credit, Scores, Surface, count_inspected, light_row, point_axes, sum_scores
from safe_inspect.types import BoolArray, FloatArray


class ConeCamera(NamedTuple):
    """Camera with a cone of view, whose apex is the deputy's centre.

    Attributes:
        axis: Unit vector of the cone's axis in body axes.
        half_angle: Half the full angle of the cone [rad]; with pi or more, the camera sees in all directions.
    """

    axis: Components
    half_angle: float


@njit
def in_cone(look: Components, cos_half: float, dx: float, dy: float, dz: float) -> bool:
    """Return whether a direction of any length is within a cone.

    Args:
        look: Unit vector of the cone's axis.
        cos_half: Cosine of half its full angle.
        dx: First component of the direction.
        dy: Second component.
        dz: Third component.
    """
    return look[0] * dx + look[1] * dy + look[2] * dz >= cos_half * math.sqrt(dx * dx + dy * dy + dz * dz)


@njit
def inspect_by_camera(
    position: FloatArray,
    orientation: FloatArray,
    body: int,
    camera: ConeCamera,
    sun: FloatArray,
    surface: Surface,
    active: BoolArray,
    credit: Credit,
    scores: Scores,
) -> None:
    """Credit each lit point that a camera sees to the first deputy that sees it, and sum the weights.

    A point q is visible from p if it is above the horizon, ``q . p >= R^2``, and the angle at the deputy between q and
    the camera's axis is at most half that of the cone.

    Args:
        position: Positions of the bodies, the deputies first [m], shape (N, B, 3).
        orientation: Attitudes of the bodies, shape (N, B, 4).
        body: Index of the body that carries the points.
        camera: The camera of every deputy.
        sun: Unit vectors to the sun [-], shape (N, 3).
        surface: The points of the body, relative to its centre.
        active: Whether a deputy's sensor works, shape (N, D).
        credit: Which deputy inspected each point; read and written.
        scores: Weights of the inspected points; read and written.
    """
    radius, count = surface.radius, surface.points.shape[0]
    axes, bright = point_axes(surface.points), np.empty(count, dtype=np.bool_)
    qx, qy, qz = axes[0], axes[1], axes[2]
    viewer = np.empty(3)
    horizon, cos_half = radius * radius, math.cos(min(camera.half_angle, math.pi))
    inspector = credit.inspector
    for n in range(credit.own_count.shape[0]):
        changed = False
        for d in range(credit.own_count.shape[1]):
            for k in range(3):
                viewer[k] = position[n, d, k] - position[n, body, k]
            vx, vy, vz = viewer[0], viewer[1], viewer[2]
            square = vx * vx + vy * vy + vz * vz
            if not active[n, d] or square < horizon:
                continue
            look = rotated(orientation[n, d], camera.axis[0], camera.axis[1], camera.axis[2])
            distance = math.sqrt(square)
            cosine = -(look[0] * vx + look[1] * vy + look[2] * vz) / distance
            away, outline = math.acos(min(max(cosine, -1.0), 1.0)), math.asin(radius / distance)
            if away - outline > camera.half_angle:  # The body is entirely outside the cone.
                continue
            whole = away + outline <= camera.half_angle  # The body is entirely inside the cone.
            light_row(viewer, sun[n], axes, radius, surface.light, bright)
            for p in range(count):
                if inspector[n, p] >= 0 or not bright[p] or not qx[p] * vx + qy[p] * vy + qz[p] * vz >= horizon:
                    continue
                if whole or in_cone(look, cos_half, qx[p] - vx, qy[p] - vy, qz[p] - vz):
                    inspector[n, p] = d
                    changed = True
        if changed:
            count_inspected(n, credit)
            sum_scores(n, credit, scores)
