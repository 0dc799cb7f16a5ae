"""Innovation: the distance of a measurement from its expected value."""

from __future__ import annotations

import numpy as np

from safe_inspect.rendezvous.back_end.states import GraphEstimate
from safe_inspect.rendezvous.edges import MODEL, Edge
from safe_inspect.rendezvous.poses import inverse
from safe_inspect.types import FloatArray


def centre_innovation(graph: GraphEstimate, expected: FloatArray, edge: Edge) -> float:
    """Return the distance of the measured centre of mass in B from its expected position, in standard deviations.

    The standard deviation is that of one axis. The result is 0 if the distance cannot be determined: for an edge from a
    frame before the last one, or from a frame whose relative pose is not known.

    Args:
        graph: Estimate of the back end at the last frame.
        expected: T_WB of this frame from the inertial unit, shape (4, 4).
        edge: An edge to this frame.
    """
    arm = 0.0
    if edge.first == MODEL:
        seen = inverse(edge.pose)[:3, 3]
    elif edge.first == graph.frame and graph.relative is not None:
        relative = graph.relative @ edge.pose
        seen = relative[:3, :3].T @ (graph.centre_glued - relative[:3, 3])
        arm = float(seen @ seen * np.linalg.eigvalsh(edge.covariance[:3, :3])[-1])
    else:
        return 0.0
    difference = seen - expected[:3, :3].T @ (graph.centre - expected[:3, 3])
    covariance = graph.centre_covariance + edge.covariance[3:, 3:] + graph.velocity_covariance + arm * np.eye(3)
    return float(np.sqrt(difference @ np.linalg.solve(covariance, difference) / 3.0))
