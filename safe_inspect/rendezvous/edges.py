"""Relative poses between two depth frames, which a front end measures and a back end combines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from safe_inspect.types import FloatArray

#: Value of `Edge.first` for a pose relative to the known model of the target instead of to an earlier frame.
MODEL = -1


@dataclass(frozen=True, eq=False)
class Edge:
    """A measured relative pose of the chaser with respect to the target between frames i and j.

    Let G be the frame that is fixed to the target and equal to B at the first frame, and G_k = T_GB at frame k. The
    pose is ``T_ij = G_i^-1 G_j``. It transforms the coordinates of points of the target from B at frame j to B at
    frame i.

    If the target's shape is known, a frame can also be registered to the model. With M the model's frame, whose origin
    is the centre of mass, the pose is T_MB at frame j, ``first`` is `MODEL` and ``kind`` is "model". With one more
    node for the constant pose T_GM, this pose is ``T_GM^-1 G_j``: an edge like the others, but its errors do not add
    up over time.

    Attributes:
        first: Number i of the earlier frame, or `MODEL`.
        second: Number j of the later frame.
        pose: T_ij, homogeneous matrix, shape (4, 4) [-, m].
        covariance: Covariance of the tangent (rotation [rad], translation [m]) that acts from the right, shape (6, 6).
        inliers: Fraction of the points of frame j that have a correspondence, in [0, 1].
        kind: "odometry" between consecutive frames, "skip" across keyframes, "loop" at a revisited view, "relocalised",
            or "model" to the known shape.
    """

    first: int
    second: int
    pose: FloatArray
    covariance: FloatArray
    inliers: float
    kind: Literal["odometry", "skip", "loop", "relocalised", "model"] = "odometry"
