"""The estimation of one mission, from frames and inertial samples to what the mission knows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, from_matrix, log, multiply, rotate, to_matrix
from safe_inspect.rendezvous.back_end.options import CentrePrior, ChaserStart, GraphEstimate
from safe_inspect.rendezvous.back_end.run import BackEndRun
from safe_inspect.rendezvous.characterise.fit import Motion
from safe_inspect.rendezvous.characterise.history import History, TargetEstimate
from safe_inspect.rendezvous.characterise.ratios import logits_of
from safe_inspect.rendezvous.edges import MODEL, Edge
from safe_inspect.rendezvous.estimation.innovation import centre_innovation, widened
from safe_inspect.rendezvous.front_end.context import FrontEndRun
from safe_inspect.rendezvous.sensors.tof import DepthFrame
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import FloatArray

#: Called with the history, the target, the motion as it was known and q_GM.
Characterise = Callable[[History, Target | None, Motion | None, FloatArray | None], TargetEstimate | None]
#: Innovation of a frame's rotations, in standard deviations, beyond which the motion has changed, and how often in a
#: row; it is the least of the frame's edges, so that a single bad one does not count. Below the angle [rad] it is the
#: front end's view, and not a change, that is likely.
_CHANGED, _CHANGED_ANGLE, _CHANGED_TIMES = 5.0, 0.08, 2
#: Errors of a motion that is known from a few frames only [rad, rad/s], and their span [s].
_QUICK_SIGMA, _QUICK_SPAN = (0.05, 0.02), 3.0
#: Innovation of the centre of mass in B beyond which the accelerometers' bias has jumped, in standard deviations, and
#: for how many frames it may go on.
_JUMP, _JUMP_FRAMES = 5.0, 3
#: Distance from the target below which a registration may slide, as a share of the radius that it sweeps, the
#: innovation that shows it, in standard deviations, and for how many frames in a row edges are refused at most.
_NEAR, _SLIDING, _MOST_REFUSED = 0.75, 2.5, 30
#: Least standard deviation of an edge's translation there [m].
_NEAR_SIGMA = 0.1
#: Time of frames that a motion is found from, and whose history stays [s].
_LEAST_TIME, _LONGEST = 15.0, 240.0
#: Misfit beyond which a motion is looked for anew, in standard deviations.
_DOUBTFUL = 1.8
#: Extent of the centre's prior as a share of the radius that the target sweeps.
_CENTRE_SHARE = 0.4


@dataclass(frozen=True, eq=False)
class PipelineParts:
    """What a pipeline is made of.

    Attributes:
        front_end: The front end of the mission.
        back_end: Makes the back end, from the chaser's start and the prior of the centre.
        characterise: Finds the motion.
        target: The target where it is known.
        T_BC: Pose of the camera in B, shape (4, 4).
        fit_period: Time between two fits [s].
    """

    front_end: FrontEndRun
    back_end: Callable[[ChaserStart, CentrePrior], BackEndRun]
    characterise: Characterise
    target: Target | None
    T_BC: FloatArray
    fit_period: float = 2.0


class EstimationPipeline:
    """Front end, back end and characterisation of one mission or recording.

    Args:
        parts: What it is made of.
        start: The chaser at time zero.
    """

    def __init__(self, parts: PipelineParts, start: ChaserStart) -> None:
        self._parts, self._start = parts, start
        self._back_end: BackEndRun | None = None
        self._rate = np.zeros(3)
        self._edges: list[Edge] = []
        self._times: dict[int, float] = {}
        self._count = 0
        self._since = 0.0
        self._fitted_at = -np.inf
        self._strange = self._jumps = self._refused = 0
        self.graph: GraphEstimate | None = None
        self.target: TargetEstimate | None = None
        self.updated = 0.0
        self.changed = False

    def measure(self, acceleration: FloatArray, rate: FloatArray, period: float) -> None:
        """Take a sample of the inertial unit, in B [m/s^2, rad/s], at the end of a period [s].

        Samples before the first frame are not used: the chaser's start holds at that frame.
        """
        self._rate = rate
        if self._back_end is not None:
            self._back_end.measure(acceleration, rate, period)

    def coast(self, period: float) -> None:
        """Take a period [s] without a sample as free flight at the last angular velocity."""
        bias = np.zeros(3) if self.graph is None else self.graph.bias[:3]
        self.measure(bias, self._rate, period)

    def see(self, frame: DepthFrame) -> None:
        """Take a frame at the time of the last sample."""
        number, self._count = self._count, self._count + 1
        if self._back_end is None:
            self._back_end = self._parts.back_end(self._start, self._centre_prior(frame))
            edges = self._parts.front_end.step(frame, None, np.eye(3))
            self._times[number] = frame.time
            self._edges += edges
            return
        back_end = self._back_end
        edges = self._parts.front_end.step(frame, self._predicted(frame.time), back_end.rotation)
        expected, _, _ = back_end.now()
        edges = self._trusted(expected, edges)
        self._times[number] = frame.time
        self._edges += edges
        back_end.update(number, edges, jumped=self._jumps > 0)
        self.graph = back_end.estimate()
        self._check_motion(frame.time, edges)
        if self.graph.relative is not None and edges:
            self.updated = frame.time
        if frame.time >= self._fitted_at + self._parts.fit_period - 1e-9 and edges:
            self._fit(frame.time)

    def now(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return T_WB (4, 4), the velocity in W (3,) and the angular velocity in B (3,) at the last sample."""
        if self._back_end is None:
            return self._start.pose, self._start.velocity, np.zeros(3)
        return self._back_end.now()

    def history(self) -> History:
        """Return the frames since the motion was seen to change, or the newest of them."""
        assert self._back_end is not None, "a history needs a frame"
        frames = list(self._back_end.frames)
        poses = self._back_end.chaser_poses()
        relative = self._back_end.relative_poses()
        newest = self._times[frames[-1]]
        kept = [k for k, frame in enumerate(frames) if self._times[frame] >= max(self._since, newest - _LONGEST)]
        glued = np.full((len(kept), 4), np.nan)
        for place, k in enumerate(kept):
            if frames[k] in relative:
                glued[place] = from_matrix(relative[frames[k]][:3, :3])
        names = [frames[k] for k in kept]
        while len(names) and not np.isfinite(glued[0]).all():
            names, glued, kept = names[1:], glued[1:], kept[1:]
        times = np.array([self._times[name] for name in names])
        return History.of(times, from_matrix(poses[kept][:, :3, :3]), glued, self._edges, names)

    def _fit(self, time: float) -> None:
        parts, graph, known = self._parts, self.graph, self.target
        if time - self._since < _LEAST_TIME or graph is None:
            return
        history = self.history()
        if len(history.times) < 2:
            return
        self._fitted_at = time
        model = None if graph.model is None else from_matrix(graph.model[:3, :3])
        before = None
        if not self.changed and known is not None and known.misfit < _DOUBTFUL and known.aligned == (model is not None):
            before = Motion(known.time, known.orientation, known.angular_velocity, logits_of(known.ratios))
        found = parts.characterise(history, parts.target, before, model)
        if found is None:
            return
        self.target, self.changed = found, False

    def _check_motion(self, time: float, edges: list[Edge]) -> None:
        """See whether the newest rotations are those of the known motion; if not, forget it."""
        known = self.target
        if known is None or not edges:
            return
        if self.changed:
            self._follow_newest(time)
            return
        innovations = [self._rotation_innovation(known, edge) for edge in edges]
        seen = [value for value in innovations if value is not None]
        if not seen:
            return
        size, angle = min(seen)
        is_strange = size > _CHANGED * max(known.misfit, 1.0) and angle > _CHANGED_ANGLE
        self._strange = self._strange + 1 if is_strange else 0
        if self._strange >= _CHANGED_TIMES:
            self.changed, self._since, self._strange = True, time - _QUICK_SPAN + 1.0, 0
            self._follow_newest(time)

    def _rotation_innovation(self, known: TargetEstimate, edge: Edge) -> tuple[float, float] | None:
        """Return how far a measured rotation is from the known motion, in standard deviations of one axis and in rad.

        It is None where that cannot be determined: of an edge to an old frame, or to a model that is not placed yet.
        """
        chaser = self._newest_poses(2)
        if edge.second not in chaser or (edge.first != MODEL and edge.first not in chaser):
            return None
        second = self._in_target(known, edge.second, chaser)
        if edge.first == MODEL:
            if not known.aligned or self.graph is None or self.graph.model is None:
                return None
            first = from_matrix(self.graph.model[:3, :3].T @ to_matrix(known.q_GT))
            error = log(multiply(conjugate(from_matrix(edge.pose[:3, :3])), multiply(first, second)))
        else:
            first = self._in_target(known, edge.first, chaser)
            error = log(multiply(conjugate(from_matrix(edge.pose[:3, :3])), multiply(conjugate(first), second)))
        covariance = edge.covariance[:3, :3] + (known.covariance[:3, :3] if edge.first == MODEL else 0.0)
        size = float(np.sqrt(error @ np.linalg.solve(covariance, error) / 3.0))
        return size, float(np.linalg.norm(error))

    def _newest_poses(self, count: int) -> dict[int, FloatArray]:
        """Return the attitudes q_WB of the newest frames."""
        assert self._back_end is not None, "frames come before poses"
        frames = self._back_end.frames[-count:]
        return dict(zip(frames, from_matrix(self._back_end.chaser_poses(count)[:, :3, :3]), strict=True))

    def _in_target(self, known: TargetEstimate, frame: int, chaser: dict[int, FloatArray]) -> FloatArray:
        """Return q_TB of a frame by the known motion."""
        q, _ = known.predict(np.array([self._times[frame]]))
        return np.asarray(multiply(conjugate(q[0]), chaser[frame]))

    def _follow_newest(self, time: float) -> None:
        """Take the motion of the newest frames: the axes in the body are known, and do not change."""
        known, history = self.target, self.history()
        times, q_WG = history.in_inertial  # noqa: N806
        if known is None or len(times) < 2:
            return
        first = max(int(np.searchsorted(times, times[-1] - _QUICK_SPAN - 1e-9)), 0)
        first = min(first, len(times) - 2)
        turn = log(multiply(conjugate(q_WG[first]), q_WG[-1])) / (times[-1] - times[first])
        sigmas = np.repeat([*_QUICK_SIGMA, np.sqrt(known.covariance[6, 6] + known.covariance[7, 7])], [3, 3, 2])
        self.target = replace(
            known,
            time=time,
            orientation=multiply(q_WG[-1], known.q_GT),
            angular_velocity=rotate(conjugate(known.q_GT), turn),
            covariance=np.diag(sigmas**2),
        )

    def _trusted(self, expected: FloatArray, edges: list[Edge]) -> list[Edge]:
        """Return the edges that may be used, and note a jump of the bias.

        Far from the target the front end is right and an innovation is a jump of the bias. Near it, where the target
        fills the frame, a registration may slide along a face: there the inertial unit is right, for a while.
        """
        graph, target = self.graph, self._parts.target
        if graph is None or not edges:
            self._jumps = max(self._jumps - 1, 0)
            return edges
        innovations = [centre_innovation(graph, expected, edge) for edge in edges]
        distance = float(np.linalg.norm(graph.centre - expected[:3, 3]))
        if target is not None and distance < _NEAR * target.swept_radius:
            kept = [
                widened(edge, _NEAR_SIGMA) for edge, value in zip(edges, innovations, strict=True) if value < _SLIDING
            ]
            self._refused = 0 if kept else self._refused + 1
            self._jumps = 0
            return kept if self._refused <= _MOST_REFUSED else edges
        self._refused = 0
        self._jumps = _JUMP_FRAMES if max(innovations) > _JUMP else max(self._jumps - 1, 0)
        return edges

    def _predicted(self, time: float) -> FloatArray | None:
        """Return T_GB now as it is predicted."""
        graph, target = self.graph, self.target
        if graph is None or target is None or self._back_end is None:
            return None
        pose, _, _ = self._back_end.now()
        q, _ = target.predict(np.array([time]))
        relative = np.eye(4)
        relative[:3, :3] = to_matrix(target.q_GT) @ to_matrix(q[0]).T @ pose[:3, :3]
        seen = pose[:3, :3].T @ (graph.centre - pose[:3, 3])
        relative[:3, 3] = graph.centre_glued - relative[:3, :3] @ seen
        return relative

    def _centre_prior(self, frame: DepthFrame) -> CentrePrior:
        """Return where the centre of mass may be: about the middle of what is seen, or in front of the camera."""
        pose, T_BC = self._start.pose, self._parts.T_BC  # noqa: N806
        target = self._parts.target
        radius = 1.0 if target is None else target.swept_radius
        if len(frame.points):
            seen, sigma = frame.points.mean(axis=0), _CENTRE_SHARE * radius
        else:
            seen, sigma = np.array([0.0, 0.0, max(1.3 * radius, 0.5)]), 0.6 * radius
        in_body = T_BC[:3, :3] @ seen + T_BC[:3, 3]
        return CentrePrior(pose[:3, :3] @ in_body + pose[:3, 3], sigma)
