"""Contract of front ends: edges between frames that they have received, the same for the same frames."""

from __future__ import annotations

import numpy as np

from safe_inspect.dynamics.quaternion import to_matrix
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.geometry.pointing import R_BC
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.front_end.base import FrontEnd, FrontEndContext
from safe_inspect.rendezvous.poses import MODEL, Edge, inverse, pose
from safe_inspect.rendezvous.sensors.measured import PoseFrame, PoseSensor, PoseSensorRun
from safe_inspect.rendezvous.sensors.tof import TimeOfFlightCamera
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.testing.report import Report
from safe_inspect.types import FloatArray

#: Attitude R_WB and position of a chaser that looks at the origin along y of W.
_AT_START = pose(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([0.0, -1.5, 0.0]))
_COVARIANCE = np.diag(np.repeat([1e-3, 1e-3], 3) ** 2)


def watched_poses(target: Target, frames: int, rate: float = 0.09) -> list[FloatArray]:
    """Return the poses T_MB of a chaser at rest that observes a tumble, one per second, shape (4, 4) each."""
    start = rate * np.array([[0.7, 0.5, 0.5]])
    q, _ = tumble(target.principal, np.array([[0.1, -0.3, 0.5, 0.8]]) / np.sqrt(0.99), start, np.arange(float(frames)))
    turned = to_matrix(q[0]) @ target.R_MT.T
    return [inverse(pose(rotation, np.zeros(3))) @ _AT_START for rotation in turned]


def edges_of(poses: list[FloatArray], *, model: bool) -> list[Edge]:
    """Return exact edges between consecutive poses and, if `model`, to the model."""
    pairs = [(k - 1, k) for k in range(1, len(poses))]
    edges = [Edge(i, j, inverse(poses[i]) @ poses[j], _COVARIANCE, 1.0) for i, j in pairs]
    return edges + [Edge(MODEL, k, T_MB, _COVARIANCE, 1.0, "model") for k, T_MB in enumerate(poses) if model]


def check_front_end(plugin: FrontEnd, target: Target, streams: Streams, report: Report) -> None:
    """Check a front end: its edges must be between frames that it has received."""
    camera, T_BC = TimeOfFlightCamera(profile="clean"), pose(R_BC, np.array([0.13, 0.0, 0.0]))  # noqa: N806
    poses = watched_poses(target, 4)
    renderer = camera(target)

    def edges() -> list[Edge]:
        run, sensor = (
            plugin(FrontEndContext(camera.geometry, T_BC, target, streams)),
            PoseSensorRun(PoseSensor(), streams),
        )
        found = []
        for number, T_MB in enumerate(poses):  # noqa: N806
            T_MC = T_MB @ T_BC  # noqa: N806
            frame = renderer.render(T_MC[:3, :3], T_MC[:3, 3], streams, number, float(number))
            if plugin.reads == "poses":
                measured = sensor.measure(number, T_MB, in_view=True)
                frame = PoseFrame(**vars(frame), number=number, poses=measured)
            own = run.step(frame, None, np.eye(3))
            right = all(edge.first < edge.second <= number and edge.first >= MODEL for edge in own)
            report.expect(right, "frames", "an edge refers to a frame that does not exist", "count frames by calls")
            found += own
        return found

    first, second = edges(), edges()
    for edge in first:
        definite = edge.covariance.shape == (6, 6) and bool((np.linalg.eigvalsh(edge.covariance) > 0.0).all())
        report.expect(definite, "covariance", "a covariance is not positive definite", "state an error of all axes")
    _same(report, "the edges", [edge.pose for edge in first], [edge.pose for edge in second])


def _same(report: Report, what: str, first: list[FloatArray], second: list[FloatArray]) -> None:
    same = len(first) == len(second) and all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))
    report.expect(same, "repeatable", f"{what} differ for the same input", "draw from the given streams alone")
