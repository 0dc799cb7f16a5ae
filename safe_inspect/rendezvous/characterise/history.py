"""What a characterisation is made from, and what it finds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, from_matrix, multiply
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.rendezvous.edges import MODEL, Edge
from safe_inspect.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class History:
    """The rotations of an observation, in ascending order of time; G is B at the first frame.

    Attributes:
        times: Times of the frames [s], shape (F,).
        chaser: Attitudes q_WB, shape (F, 4).
        glued: Attitudes q_GB from the back end, shape (F, 4); NaN where no edge has reached the frame.
        first: Position of the earlier frame of each edge, or `MODEL`, shape (E,).
        second: Position of the later frame, shape (E,).
        rotation: Measured q_ij, or q_MB, shape (E, 4).
        covariance: Of its tangent, shape (E, 3, 3) [rad^2].
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
        """Return the history of some frames; edges of others are left out.

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

    def between(self, start: float, end: float) -> History:
        """Return the frames from a start to an end, both included [s], with the edges among them."""
        kept = np.flatnonzero((self.times >= start - 1e-9) & (self.times <= end + 1e-9))
        place = np.full(len(self.times) + 1, -2)
        place[kept], place[MODEL] = np.arange(len(kept)), MODEL
        first, second = place[self.first], place[self.second]
        used = (first > -2) & (second > -2)
        return History(
            self.times[kept], self.chaser[kept], self.glued[kept],
            first[used], second[used], self.rotation[used], self.covariance[used],
        )  # fmt: skip

    def without(self, dropped: FloatArray) -> History:
        """Return the history without some edges, a mask of shape (E,)."""
        kept = ~np.asarray(dropped, bool)
        return History(
            self.times, self.chaser, self.glued,
            self.first[kept], self.second[kept], self.rotation[kept], self.covariance[kept],
        )  # fmt: skip

    @property
    def in_inertial(self) -> tuple[FloatArray, FloatArray]:
        """Times [s] and attitudes q_WG of the frames that the back end has reached, shapes (n,) and (n, 4)."""
        seen = np.isfinite(self.glued).all(axis=1)
        return self.times[seen], multiply(self.chaser[seen], conjugate(self.glued[seen]))


@dataclass(frozen=True, eq=False)
class TargetEstimate:
    """How the target tumbles.

    Attributes:
        time: When attitude and angular velocity hold [s].
        orientation: q_WT, shape (4,).
        angular_velocity: In T [rad/s], shape (3,).
        ratios: k1 = J1 / J3 and k2 = J2 / J3, shape (2,).
        q_GT: Principal axes in G, shape (4,).
        covariance: Of the motion's tangent at that time, attitude [rad], angular velocity in the turned axes [rad/s]
            and logits, shape (8, 8); see `safe_inspect.rendezvous.characterise.fit.Motion`.
        axes_sigma: Standard deviation of the principal axes in G, the largest [rad].
        observable: Whether the motion shows the transverse axes and the ratios; else they are the prior's.
        aligned: Whether poses to the model tell which of the axes' directions are the model's.
        misfit: Root mean square of the residuals in standard deviations; about 1 where noise and motion are as assumed.
        recent_misfit: The same of the newest edges, left out or not, by their median: large where the motion has
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
        """Principal moments up to one factor, shape (3,)."""
        return np.array([self.ratios[0], self.ratios[1], 1.0])

    def predict(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return q_WT, shape (K, 4), and the angular velocity in T [rad/s], shape (K, 3), at times [s], shape (K,)."""
        elapsed = np.asarray(times, dtype=np.float64) - self.time
        q, w = tumble(self.inertia, self.orientation[None], self.angular_velocity[None], elapsed)
        return q[0], w[0]
