"""Registration of one depth frame to the known shape, and the search without a prediction."""

from __future__ import annotations

from dataclasses import replace
from operator import attrgetter

import numpy as np

from safe_inspect.dynamics.quaternion import to_matrix
from safe_inspect.rendezvous.depth_camera import DepthCamera
from safe_inspect.rendezvous.front_end.base import Registration
from safe_inspect.rendezvous.front_end.cleaning import Cloud
from safe_inspect.rendezvous.front_end.residuals import RangeNoise, add_silhouette, add_surface
from safe_inspect.rendezvous.poses import HALF_TURNS, adjoint, difference, inverse, perturbed, pose, rotation_log, skew
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.rendezvous.target.surface import MeshSurface
from safe_inspect.types import FloatArray

#: A step shorter than this ends the iteration [rad, m].
_CONVERGED = 1e-4
#: Largest component of a step [rad, m].
_LARGEST_STEP = 0.2
#: Distance to the surface beyond which points do not count [m].
LARGEST_DISTANCE = 0.03
#: Distance between the points that represent the surface, relative to the swept radius, for tracking and for a search.
_SPACING, _COARSE_SPACING = 0.015, 0.06
#: Minimum mean weighted square of the residuals: details that the model lacks cause errors even without noise.
_LEAST_EXCESS = 0.05
#: Ratio of the variance of second-order errors (from points at wrong places and points beyond the cut) to that of
#: first-order errors at a mean weighted square of 1. Without it, the normalised squared errors of camera profiles
#: differ by a factor of 4.
_SECOND_ORDER = 10.0
#: Standard deviations of the errors caused by details that the model lacks, about the model's origin [rad, m]; the
#: spread of the points, relative to the swept radius, above which the first holds; and the power by which it grows for
#: a smaller spread: details rotate a small patch more, and fewer of them are averaged.
_DETAIL_TURN, _DETAIL_SHIFT, _WHOLE, _SPREAD_POWER = np.deg2rad(0.06), 3e-3, 0.35, 1.5
#: The same rotation by the errors of a map, at a range at which ranges have the constant part of their noise [rad].
_MAP_TURN = np.deg2rad(0.4)
#: Minimum number of poses that a search registers with all points.
_REFINED = 18
#: Number of found poses that are displaced along the axes of M, by which fractions of the swept radius, and the
#: least decrease of the score of another optimum [m].
_DISPLACED, _DISPLACEMENTS, _BETTER = 4, (-0.24, -0.12, 0.12, 0.24), 1e-3
#: Poses whose attitudes differ by less count as the same [rad].
_SAME = np.deg2rad(10.0)


class ModelRegistration:
    """Registration of frames to the shape of a target: of points to its surface, and of the shape to the silhouette.

    Only triangles that look to the camera are used: the rear of a thin plate would attract points through the plate.
    The silhouette constrains the shape in directions in which points do not, for instance along a box.

    Args:
        target: The target.
        camera: Geometry of the camera.
        T_BC: Pose of the camera in B, shape (4, 4).
        sigma0: Constant part of the standard deviation of a range [m].
        k: Coefficient of the part that grows with the square of the range [1/m].
        cut: Distance to the surface beyond which points do not count [m].
        roughness: Standard deviation of the errors of the surface's normals, along each axis [rad].
    """

    def __init__(
        self,
        target: Target,
        camera: DepthCamera,
        T_BC: FloatArray,  # noqa: N803
        sigma0: float,
        k: float,
        cut: float = LARGEST_DISTANCE,
        roughness: float = 0.0,
    ) -> None:
        self.surface = MeshSurface(target.shape)
        self.samples, self.coarse_samples = (
            self.surface.sample(0.5 * side * target.swept_radius).thinned(side * target.swept_radius)
            for side in (_SPACING, _COARSE_SPACING)
        )
        self._noise = RangeNoise(sigma0, k, 0.5 / camera.focal_length, cut)
        self._T_BC, self._camera, self.swept_radius = T_BC, camera, target.swept_radius
        self._roughness = roughness

    def __call__(
        self,
        cloud: Cloud,
        start: FloatArray,
        information: FloatArray | None = None,
        *,
        iterations: int = 12,
        widening: float = 1.6,
        coarse: bool = False,
    ) -> Registration:
        """Return the registration with the pose T_MB that fits a frame best, found by Gauss-Newton steps.

        The score is the mean distance of the points to the shape plus that of the shape to the silhouette, each
        distance at most 5 cm [m].

        Args:
            cloud: The cleaned frame.
            start: Initial T_MB, shape (4, 4).
            information: Information matrix of a prior at the start, of the tangent from the right, shape (6, 6), which
                constrains directions that the frame does not; None without a prior.
            iterations: Maximum number of steps.
            widening: Ratio of the cut at the first step to that at the last ones; it decreases to 1 in three steps.
            coarse: Whether to represent the surface by fewer points.
        """
        pose = start
        prior = np.zeros((6, 6)) if information is None else information
        for step in range(iterations + 1):
            found, gradient = self.linearise(cloud, pose, max(widening * (1.0 - step / 3.0), 1.0), coarse=coarse)
            if step == iterations:
                break
            pull = prior @ difference(start, pose)
            damping = np.diag(1e-6 * np.diag(found.hessian) + 1e-6)
            move = -np.linalg.solve(found.hessian + prior + damping, gradient + pull)
            if np.abs(move).max() < _CONVERGED and step >= 3:
                break
            pose = perturbed(pose, np.asarray(move / max(float(np.abs(move).max()) / _LARGEST_STEP, 1.0)))
        # Details that the boxes lack shift the shape in its frame M, independently of the distance.
        carry = adjoint(inverse(pose))
        turn = self._detail_turn(cloud)
        systematic = carry @ np.diag(np.repeat([turn, _DETAIL_SHIFT], 3) ** 2) @ carry.T
        excess = found.excess * (1.0 + _SECOND_ORDER * found.excess**2)
        # On a rough surface, the prior bounds the errors along directions that the frame does not show.
        hessian = found.hessian + excess * prior if self._roughness else found.hessian
        return replace(found, hessian=hessian, excess=excess, systematic=systematic)

    def _detail_turn(self, cloud: Cloud) -> float:
        """Return the standard deviation of the rotation by details that the shape lacks [rad].

        The errors of a map matter more where the ranges that are compared with it are noisier.
        """
        if self._roughness:
            distance = float(np.linalg.norm(cloud.points.mean(axis=0) - self._T_BC[:3, 3]))
            return float(_MAP_TURN * (1.0 + self._noise.k * distance**2 / self._noise.sigma0))
        spread, whole = float(np.sqrt(cloud.points.var(axis=0).sum())), _WHOLE * self.swept_radius
        return float(_DETAIL_TURN * max(whole / max(spread, 1e-3 * whole), 1.0) ** _SPREAD_POWER)

    def linearise(
        self, cloud: Cloud, pose: FloatArray, widening: float = 1.0, *, coarse: bool = False
    ) -> tuple[Registration, FloatArray]:
        """Return the normal equations of a frame at a pose: a registration that stays there, and the gradient, (6,).

        The excess is the mean weighted square of the residuals.

        Args:
            cloud: The cleaned frame.
            pose: T_MB, shape (4, 4).
            widening: Factor of the cut.
            coarse: Whether to represent the surface by fewer points.
        """
        mount = self._T_BC
        samples = (self.coarse_samples if coarse else self.samples).facing((pose @ mount)[:3, 3])
        noise = self._noise._replace(cut=self._noise.cut * widening)
        sums, number = np.zeros((7, 7)), max(len(cloud), 1)
        distance, inliers = add_surface(sums, self.surface, samples, pose, cloud, noise)
        squares = float(sums[6, 6])
        far, shown = add_silhouette(sums, samples, pose, cloud, self._camera, mount, noise)
        score = distance / number + far / max(shown, 1)
        excess = max(squares / max(inliers - 6, 1), _LEAST_EXCESS)
        hessian, gradient = sums[:6, :6].copy(), sums[:6, 6].copy()
        if self._roughness and number > 1:
            hessian, gradient = _of_exact_normals(hessian, gradient, cloud.points, self._roughness)
        return Registration(pose, hessian, score, inliers / number, excess), gradient


def _of_exact_normals(
    hessian: FloatArray, gradient: FloatArray, points: FloatArray, roughness: float
) -> tuple[FloatArray, FloatArray]:
    """Return normal equations without the information that errors of the normals seem to give.

    Random normals seem to show every motion, for instance that of a sphere about its centre. With errors of variance
    s^2 along each axis, a direction of which the frame shows the fraction f of what points on surfaces of all
    directions would show seems to have the fraction ``f + s^2 (1 - f)``.

    Args:
        hessian: Information matrix of the tangent from the right, shape (6, 6).
        gradient: Gradient, shape (6,).
        points: The measured points in B [m], shape (n, 3).
        roughness: Standard deviation s of the errors of the normals along each axis [rad].
    """
    from scipy.linalg import eigh  # slow to import

    # The mean of the rows [p x e, e] of all points p and axes e, squared.
    squares, middle = points.T @ points / len(points), skew(points.mean(axis=0))
    rows = np.block([[np.trace(squares) * np.eye(3) - squares, middle], [middle.T, np.eye(3)]])
    total = (np.trace(hessian[3:, 3:]) + 1e-9) * rows
    fractions, directions = eigh(hessian, total)
    shown = np.maximum(fractions - roughness**2 * (1.0 - fractions), 0.0)
    turned = total @ directions
    pull = directions.T @ gradient * shown / np.maximum(fractions, 1e-12)
    return np.asarray((turned * shown) @ turned.T), np.asarray(turned @ pull)


def _spread_rotations(count: int) -> FloatArray:
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
    If a part of the shape is outside of the image, the centroids differ, and a right attitude may end at a wrong
    position; the best poses are therefore displaced along each axis of M, and registered again where that fits better.

    Args:
        registration: Registers frames to the shape.
        cloud: The cleaned frame.
        rotations: Size of the grid; with 600, neighbours are 25 degrees apart.
        kept: Maximum number of poses.
    """
    by_score, coarse = attrgetter("score"), cloud.thinned(250)
    centroid, samples = cloud.points.mean(axis=0), registration.coarse_samples
    toward = -centroid / np.linalg.norm(centroid)
    found = []
    for R_MB in _spread_rotations(rotations):  # noqa: N806
        shown = samples.points[samples.normals @ (R_MB @ toward) > 0.2]
        start = pose(R_MB, shown.mean(axis=0) - R_MB @ centroid)
        found.append(registration(coarse, start, iterations=2, widening=2.5, coarse=True))
    found = sorted(found, key=by_score)[: rotations // 4]
    found = [registration(coarse, one.pose, iterations=4, widening=2.0, coarse=True) for one in found]
    poses = [one.pose for one in distinct_poses(sorted(found, key=by_score), max(_REFINED, kept + 3))]
    refined = [registration(cloud, one, iterations=25, widening=2.5) for one in poses]
    # A pose that looks like the true one most often differs by half a turn about one of the axes.
    turned = [pose(turn, np.zeros(3)) @ min(refined, key=by_score).pose for turn in HALF_TURNS[1:]]
    refined += [registration(cloud, one, iterations=25, widening=2.5) for one in turned]
    found = distinct_poses(sorted(refined, key=by_score), kept)
    moved = [_displaced(registration, coarse, one) for one in found[:_DISPLACED]]
    refined = [registration(cloud, one.pose, iterations=25, widening=2.5) for one in moved if one is not None]
    return distinct_poses(sorted(found + refined, key=by_score), kept)


def _displaced(registration: ModelRegistration, cloud: Cloud, found: Registration) -> Registration | None:
    """Return the best registration from displaced starts; None if it fits no better than the pose itself."""
    moves = registration.swept_radius * np.eye(3)
    starts = [pose(np.eye(3), share * move) @ found.pose for move in moves for share in _DISPLACEMENTS]
    tried = [registration(cloud, start, iterations=4, widening=2.0, coarse=True) for start in (found.pose, *starts)]
    best = min(tried, key=attrgetter("score"))
    return best if best.score < registration.linearise(cloud, found.pose, coarse=True)[0].score - _BETTER else None


def distinct_poses(ordered: list[Registration], count: int) -> list[Registration]:
    """Return at most `count` registrations, in order, whose attitudes differ from all earlier ones by 10 degrees."""
    kept: list[Registration] = []
    for one in ordered:
        turns = (other.pose[:3, :3].T @ one.pose[:3, :3] for other in kept)
        if all(np.linalg.norm(rotation_log(turn)) > _SAME for turn in turns):
            kept.append(one)
        if len(kept) == count:
            break
    return kept
