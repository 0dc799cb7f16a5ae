"""Relative poses of the target's body between two depth frames: what a front end gives and a back end takes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from safe_inspect.types import FloatArray

#: `Edge.first` of a pose that is measured with respect to the known model of the target, and not to a frame.
MODEL = -1


@dataclass(frozen=True, eq=False)
class Edge:
    """A measured relative pose of the chaser with respect to the target between frames i and j.

    With G the frame that is glued to the target and equal to B at the first frame, and G_k = T_GB at frame k, it is
    ``T_ij = G_i^-1 G_j``: it takes coordinates of points of the target from B at frame j to B at frame i.

    Where the target's shape is known, a frame can also be registered to it. With M the model's frame, origin at the
    centre of mass, the pose is T_MB at frame j, ``first`` is `MODEL` and ``kind`` is "model": with one more node for
    the constant pose T_GM it is ``T_GM^-1 G_j``, an edge like the others whose errors do not add up over time.

    Attributes:
        first: Number i of the earlier frame, or `MODEL`.
        second: Number j of the later frame.
        pose: T_ij, homogeneous matrix, shape (4, 4) [-, m].
        covariance: Of the tangent (rotation [rad], translation [m]) that acts from the right, shape (6, 6).
        inliers: Share of points of frame j that found a correspondence, in [0, 1].
        kind: "odometry" between neighbours, "skip" across keyframes, "loop" at a revisited view, "relocalised",
            "model" to the known shape.
    """

    first: int
    second: int
    pose: FloatArray
    covariance: FloatArray
    inliers: float
    kind: Literal["odometry", "skip", "loop", "relocalised", "model"] = "odometry"
