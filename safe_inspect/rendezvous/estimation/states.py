"""What back end and characteriser begin with and what they find: states, rotations of a history, and motions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, from_matrix, multiply
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.rendezvous.poses import MODEL, Edge
from safe_inspect.types import FloatArray, IntArray

#: Standard deviation of the centre's prior as a fraction of the radius that the target sweeps.
_CENTRE_SHARE = 0.4


class ChaserStart(NamedTuple):
    """State of the chaser at the first frame.

    Attributes:
        pose: T_WB, shape (4, 4) [-, m].
        velocity: Velocity in W [m/s], shape (3,).
    """

    pose: FloatArray
    velocity: FloatArray


class CentrePrior(NamedTuple):
    """Prior of the target's centre of mass.

    Attributes:
        position: Expected position in W [m], shape (3,).
        sigma: Standard deviation along each axis [m].
    """

    position: FloatArray
    sigma: float

    @classmethod
    def seen(cls, points: FloatArray, start: ChaserStart, mount: FloatArray, radius: float | None) -> CentrePrior:
        """Return the prior about the mean of the points that a frame sees, or in front of the camera without any.

        Args:
            points: Points in C [m], shape (n, 3).
            start: State of the chaser.
            mount: Pose T_BC of the camera in B, shape (4, 4).
            radius: Radius that the target sweeps [m]; None if it is not known.
        """
        radius = 1.0 if radius is None else radius
        if len(points):
            place, sigma = points.mean(axis=0), _CENTRE_SHARE * radius
        else:
            place, sigma = np.array([0.0, 0.0, max(1.3 * radius, 0.5)]), 0.6 * radius
        in_body = mount[:3, :3] @ place + mount[:3, 3]
        return cls(start.pose[:3, :3] @ in_body + start.pose[:3, 3], sigma)


@dataclass(frozen=True, eq=False)
class GraphEstimate:
    """Estimate of a factor graph after a frame.

    Attributes:
        frame: Number of the frame.
        chaser: T_WB, shape (4, 4) [-, m].
        velocity: Velocity of the chaser in W [m/s], shape (3,).
        bias: Biases of the accelerometers [m/s^2] and gyroscopes [rad/s], shape (6,).
        relative: T_GB, shape (4, 4) [-, m]; None if the frame has no edge.
        centre: Centre of mass in W [m], shape (3,).
        centre_glued: Centre of mass in G [m], shape (3,).
        model: T_GM, shape (4, 4) [-, m]; None without a pose relative to the model.
        chaser_covariance: Covariance of the tangent of T_WB (rotation [rad], translation [m]), shape (6, 6).
        velocity_covariance: Covariance of the velocity in W [m^2/s^2], shape (3, 3).
        centre_covariance: Covariance of the centre of mass in B, that is, relative to the chaser [m^2], shape (3, 3).
    """

    frame: int
    chaser: FloatArray
    velocity: FloatArray
    bias: FloatArray
    relative: FloatArray | None
    centre: FloatArray
    centre_glued: FloatArray
    model: FloatArray | None
    chaser_covariance: FloatArray
    velocity_covariance: FloatArray
    centre_covariance: FloatArray


@dataclass(frozen=True, eq=False)
class History:
    """Rotations of an observation, in ascending order of time; G equals B at the first frame.

    Attributes:
        times: Times of the frames [s], shape (F,).
        chaser: Attitudes q_WB, shape (F, 4).
        glued: Attitudes q_GB from the back end, shape (F, 4); NaN for frames without an edge.
        first: Index of the earlier frame of each edge, or `MODEL`, shape (E,).
        second: Index of the later frame of each edge, shape (E,).
        rotation: Measured q_ij, or q_MB, shape (E, 4).
        covariance: Covariance of its tangent, shape (E, 3, 3) [rad^2].
    """

    times: FloatArray
    chaser: FloatArray
    glued: FloatArray
    first: IntArray
    second: IntArray
    rotation: FloatArray
    covariance: FloatArray

    @classmethod
    def of(
        cls, times: FloatArray, chaser: FloatArray, glued: FloatArray, edges: Sequence[Edge], frames: Sequence[int]
    ) -> History:
        """Return the history of some frames; edges of other frames are omitted.

        Args:
            times: Times [s], shape (F,).
            chaser: Attitudes q_WB, shape (F, 4).
            glued: Attitudes q_GB, shape (F, 4).
            edges: The measured edges.
            frames: Numbers of the frames, ascending.
        """
        place = {frame: k for k, frame in enumerate(frames)} | {MODEL: MODEL}
        used = [edge for edge in edges if edge.first in place and edge.second in place]
        poses = np.array([edge.pose[:3, :3] for edge in used]).reshape(-1, 3, 3)
        return cls(
            np.asarray(times, dtype=np.float64),
            chaser,
            glued,
            np.array([place[edge.first] for edge in used], np.int64),
            np.array([place[edge.second] for edge in used], np.int64),
            from_matrix(poses),
            np.array([edge.covariance[:3, :3] for edge in used]).reshape(-1, 3, 3),
        )

    def without(self, dropped: FloatArray) -> History:
        """Return the history without the edges of a mask of shape (E,)."""
        kept = ~np.asarray(dropped, bool)
        return History(
            self.times, self.chaser, self.glued,
            self.first[kept], self.second[kept], self.rotation[kept], self.covariance[kept],
        )  # fmt: skip

    @property
    def in_inertial(self) -> tuple[FloatArray, FloatArray]:
        """Times [s], shape (n,), and attitudes q_WG, shape (n, 4), of the frames that have an edge."""
        seen = np.isfinite(self.glued).all(axis=1)
        return self.times[seen], multiply(self.chaser[seen], conjugate(self.glued[seen]))


@dataclass(frozen=True, eq=False)
class TargetEstimate:
    """Estimate of the target's tumbling motion.

    Attributes:
        time: Time of attitude and angular velocity [s].
        orientation: q_WT, shape (4,).
        angular_velocity: Angular velocity in T [rad/s], shape (3,).
        ratios: k1 = J1 / J3 and k2 = J2 / J3, shape (2,).
        q_GT: Principal axes in G, shape (4,).
        covariance: Covariance of the motion's tangent at that time: attitude [rad], angular velocity in the rotated
            axes [rad/s] and logits, shape (8, 8); see `safe_inspect.rendezvous.estimation.fit.Motion`.
        axes_sigma: Largest standard deviation of the principal axes in G [rad].
        observable: Whether the transverse axes and the ratios are observable from the motion; otherwise they are those
            of the prior.
        aligned: Whether the directions of the axes agree with those of the model, known from poses relative to it.
        misfit: Root mean square of the residuals in standard deviations; about 1 if noise and motion are as assumed.
        recent_misfit: The same for the newest edges, removed ones included, from their median; large if the motion has
            changed.
        singular: Ratios s6 / s5 and s5 / s1 of the quadrics' singular values.
    """

    time: float
    orientation: FloatArray
    angular_velocity: FloatArray
    ratios: FloatArray
    q_GT: FloatArray  # noqa: N815
    covariance: FloatArray
    axes_sigma: float
    observable: bool
    aligned: bool
    misfit: float
    recent_misfit: float
    singular: tuple[float, float]

    @property
    def inertia(self) -> FloatArray:
        """Principal moments up to a common factor, shape (3,)."""
        return np.array([self.ratios[0], self.ratios[1], 1.0])

    def predict(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return q_WT, shape (K, 4), and the angular velocity in T [rad/s], shape (K, 3), at times [s], shape (K,)."""
        elapsed = np.asarray(times, dtype=np.float64) - self.time
        q, w = tumble(self.inertia, self.orientation[None], self.angular_velocity[None], elapsed)
        return q[0], w[0]


def largest_sigma(covariance: FloatArray) -> float:
    """Return the largest standard deviation of a covariance along any direction, shape (n, n)."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))
