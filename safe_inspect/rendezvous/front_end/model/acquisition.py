"""Search for the pose of a known shape in a frame without a prediction."""

from __future__ import annotations

import numpy as np

from safe_inspect.dynamics.quaternion import to_matrix
from safe_inspect.rendezvous.characterise.polhode import HALF_TURNS
from safe_inspect.rendezvous.front_end.cleaning import Cloud
from safe_inspect.rendezvous.front_end.model.registration import ModelRegistration
from safe_inspect.rendezvous.front_end.registration import Registration
from safe_inspect.rendezvous.poses import pose, rotation_log
from safe_inspect.types import FloatArray

#: Poses whose attitudes differ by less count as the same [rad].
_SAME = np.deg2rad(10.0)


def spread_rotations(count: int) -> FloatArray:
    """Return rotations that are spread evenly over SO(3), shape (count, 3, 3).

    Source:
        Alexa, "Super-Fibonacci spirals: fast, low-discrepancy sampling of SO(3)", CVPR 2022.
    """
    s = np.arange(count) + 0.5
    r, big = np.sqrt(s / count), np.sqrt(1.0 - s / count)
    alpha, beta = 2.0 * np.pi * s / np.sqrt(2.0), 2.0 * np.pi * s / 1.533751168755204288118041
    q = np.stack([r * np.sin(alpha), r * np.cos(alpha), big * np.sin(beta), big * np.cos(beta)], axis=1)
    return to_matrix(q)


def acquire(registration: ModelRegistration, cloud: Cloud, rotations: int = 600, kept: int = 6) -> list[Registration]:
    """Return the poses that explain a frame, best first, none within 10 degrees of a better one.

    For each rotation of a grid, the centroid of the shape's visible points is placed at the centroid of the frame, and
    two steps of the registration are done with few points. The best quarter gets more steps. The best of those are
    registered with all points and up to 25 steps, and so is the very best rotated by half a turn about each axis of M.

    Args:
        registration: Registers frames to the shape.
        cloud: The cleaned frame.
        rotations: Size of the grid; with 600, neighbours are 25 degrees apart.
        kept: Maximum number of poses.
    """
    coarse = cloud.thinned(250)
    centroid, samples = cloud.points.mean(axis=0), registration.coarse_samples
    toward = -centroid / np.linalg.norm(centroid)
    found = []
    for R_MB in spread_rotations(rotations):  # noqa: N806
        shown = samples.points[samples.normals @ (R_MB @ toward) > 0.2]
        start = pose(R_MB, shown.mean(axis=0) - R_MB @ centroid)
        found.append(registration(coarse, start, iterations=2, widening=2.5, coarse=True))
    found = sorted(found, key=_score)[: rotations // 4]
    found = [registration(coarse, one.pose, iterations=4, widening=2.0, coarse=True) for one in found]
    poses = [one.pose for one in _distinct(sorted(found, key=_score), 3 * kept)]
    refined = [registration(cloud, one, iterations=25, widening=2.5) for one in poses]
    # A pose that looks like the true one most often differs by half a turn about one of the axes.
    turned = [pose(turn, np.zeros(3)) @ min(refined, key=_score).pose for turn in HALF_TURNS[1:]]
    refined += [registration(cloud, one, iterations=25, widening=2.5) for one in turned]
    return _distinct(sorted(refined, key=_score), kept)


def _score(one: Registration) -> float:
    return one.score


def _distinct(ordered: list[Registration], count: int) -> list[Registration]:
    """Return at most `count` registrations, in order, whose attitudes differ from all earlier ones."""
    kept: list[Registration] = []
    for one in ordered:
        turns = (other.pose[:3, :3].T @ one.pose[:3, :3] for other in kept)
        if all(np.linalg.norm(rotation_log(turn)) > _SAME for turn in turns):
            kept.append(one)
        if len(kept) == count:
            break
    return kept
