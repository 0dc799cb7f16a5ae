"""Estimation of one mission from frames and inertial samples."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, exp, from_matrix, multiply, rotate, to_matrix
from safe_inspect.rendezvous.depth_camera import DepthFrame
from safe_inspect.rendezvous.estimation.change import (
    OFF_FRAMES,
    QUICK_SPAN,
    BiasJumps,
    ExpectedMotion,
    centre_innovation,
    departs,
    motion_of,
    newest_motion,
)
from safe_inspect.rendezvous.estimation.characteriser import KnownBody, PolhodeCharacteriser
from safe_inspect.rendezvous.estimation.factors import ImuBuffer
from safe_inspect.rendezvous.estimation.graph import ISAM2BackEnd
from safe_inspect.rendezvous.estimation.states import (
    CentrePrior,
    ChaserStart,
    GraphEstimate,
    History,
    TargetEstimate,
    turned_by_bias,
)
from safe_inspect.rendezvous.front_end.base import FrontEndContext, FrontEndRun
from safe_inspect.rendezvous.inertial_unit import InertialSample
from safe_inspect.rendezvous.poses import MODEL, Edge, pose
from safe_inspect.types import FloatArray

#: Minimum time between two fits of the motion [s].
_FIT_PERIOD = 5.0
#: Number of the newest frames that are compared with the known motion, and the misfit of the newest edges, in standard
#: deviations, that indicates a change as well.
_CHANGED_FRAMES, _CHANGED_MISFIT = 5, 3.0
#: Innovation of the centre of mass in B beyond which a frame is refused, in standard deviations; how many frames in a
#: row may be refused before a jump of the accelerometers' bias is assumed; for how many frames the jump may last.
_JUMP, _MOST_REFUSED, _JUMP_FRAMES = 5.0, 1, 3
#: Number of the newest frames that are compared with the estimate.
_COMPARED = 5
#: Minimum duration of frames from which a motion is found, and maximum duration of the history [s].
_LEAST_TIME, _LONGEST = 15.0, 240.0
#: Misfit beyond which the motion is searched again, in standard deviations.
_DOUBTFUL = 1.8
#: Standard deviation of an unknown body's axes above which its motion is searched again [rad].
_SURE_AXES = 0.2
#: Standard deviation of the attitude of an aligned frame about each axis [rad], and the number of frames between two
#: that are compared.
_ALIGNED, _LAG = np.deg2rad(0.5), 7
#: Ratio of the smallest to the largest moment of inertia below which a fit has ended at a rod.
_ROD = 0.02


def _is_consistent(found: TargetEstimate | None, tolerance: float) -> bool:
    """Return whether a motion was found that agrees with all edges and with the newest ones."""
    return found is not None and max(found.misfit, found.recent_misfit) < _DOUBTFUL * tolerance


class EstimationPipeline:
    """Front end, back end and characterisation of one mission or recording.

    Args:
        front_end: The front end of the mission.
        back_end: Options of the back end.
        characterise: Finds the motion.
        context: The camera's pose in B, and the target if it is known.
        imu: Buffer of the inertial unit.
        start: State of the chaser at the first frame.
        frame: The first frame.

    Attributes:
        measured: The edges that the front end has measured in the newest frame.
        tolerance: Factor of the deviations of frames that mean that the motion has changed; smaller ones are errors of
            the frames. It is infinite if the motion does not change.
        fitted_from: Time before which the motion is not fitted [s].
    """

    def __init__(
        self,
        front_end: FrontEndRun,
        back_end: ISAM2BackEnd,
        characterise: PolhodeCharacteriser,
        context: FrontEndContext,
        imu: ImuBuffer,
        start: ChaserStart,
        frame: DepthFrame,
    ) -> None:
        self._front_end, self._characterise, self._known = front_end, characterise, KnownBody.of(context.target)
        radius = None if context.target is None else context.target.swept_radius
        self._back_end = back_end(imu, start, CentrePrior.seen(frame.points, start, context.T_BC, radius))
        self._edges: list[Edge] = []
        self._times: dict[int, float] = {}
        self._since = 0.0
        self._fitted_at = -np.inf
        self._jumps = self._refused = 0
        self._has_coasted = False
        #: None after the frames have disagreed with the commands, for instance because a thruster failed.
        self._bias_jumps: BiasJumps | None = BiasJumps(imu.noise)
        self._mismatches: deque[float] = deque([np.inf] * _COMPARED, _COMPARED)
        self.graph: GraphEstimate | None = None
        self.target: TargetEstimate | None = None
        self.updated = 0.0
        self.changed = False
        self.measured: list[Edge] = []
        self.tolerance, self.fitted_from = 1.0, 0.0
        self._step(frame, np.eye(3))
        self._edges += self.measured

    def _step(self, frame: DepthFrame, rotation: FloatArray) -> None:
        """Measure the edges of the next frame, given the chaser's rotation since the last one, shape (3, 3)."""
        self._times[len(self._times)] = frame.time
        self.measured = self._front_end.step(frame, self._predicted(frame.time), rotation)

    def move(self, samples: Sequence[InertialSample], expected: ExpectedMotion, duration: float) -> None:
        """Propagate a control step by the inertial unit, or by the expected motion if the unit gives no samples.

        Args:
            samples: The samples of the step.
            expected: Motion that the actuators are expected to cause in it.
            duration: Duration of the step [s].
        """
        imu = self._back_end.imu
        if self._bias_jumps is not None and self.graph is not None:
            jump = self._bias_jumps.check(samples, expected, self.graph.bias[:3], duration)
            if jump is not None:
                imu.correct(jump)
        if not samples:
            self._has_coasted = True
            imu.coast(duration, expected.mean)
        for sample in samples:
            imu.add(sample.acceleration, sample.rate, imu.period)

    def measure(self, acceleration: FloatArray, rate: FloatArray, period: float) -> None:
        """Add a sample of the inertial unit, in B [m/s^2, rad/s], at the end of a period [s]."""
        self._back_end.imu.add(acceleration, rate, period)

    def see(self, frame: DepthFrame) -> None:
        """Add a frame at the time of the last sample."""
        number, back_end = len(self._times), self._back_end
        self._step(frame, back_end.imu.rotation)
        expected, _, _ = back_end.now()
        edges = self._trusted(expected, self.measured)
        self._edges += edges
        back_end.update(number, edges, jumped=self._jumps == _JUMP_FRAMES)
        self._has_coasted = False
        if self._bias_jumps is not None:
            self._bias_jumps.settle()
        self.graph = back_end.estimate()
        self._mismatches.append(self._mismatch(frame.time, self.measured))
        self._check_motion(frame.time, edges)
        if self.graph.relative is not None and edges:
            self.updated = frame.time
        if frame.time >= max(self._fitted_at + _FIT_PERIOD, self.fitted_from) - 1e-9 and edges:
            self._fit(frame.time)

    @property
    def mismatch(self) -> float:
        """Largest distance in T between single frames and the estimate; see `StateEstimate`."""
        return max(self._mismatches)

    def now(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return T_WB (4, 4), the velocity in W (3,) and the angular velocity in B (3,) at the last sample."""
        return self._back_end.now()

    def history(self, count: int = 0) -> History:
        """Return the history since the last detected change of motion, at most `_LONGEST` seconds.

        Args:
            count: Number of the newest frames that are considered; 0 for all frames.
        """
        frames = list(self._back_end.frames)[-count:]
        poses, relative = self._back_end.chaser_poses(len(frames)), self._back_end.relative_poses(len(frames))
        since = max(self._since, self._times[frames[-1]] - _LONGEST)
        begun = (k for k, frame in enumerate(frames) if frame in relative and self._times[frame] >= since)
        first = next(begun, len(frames))
        names = frames[first:]
        glued = np.full((len(names), 4), np.nan)
        seen = [name in relative for name in names]
        if names:
            glued[seen] = from_matrix(np.stack([relative[name][:3, :3] for name in names if name in relative]))
        times = np.array([self._times[name] for name in names])
        return History.of(times, from_matrix(poses[first:, :3, :3]), glued, self._edges, names)

    def attitudes(self, found: TargetEstimate) -> dict[int, FloatArray]:
        """Return R_GW at the frames of the history by a motion, shape (3, 3) each, by number of the frame."""
        history = self.history()
        turned = turned_by_bias(history)
        q_WT = multiply(exp((turned[-1] - turned) @ found.drift), found.predict(history.times)[0])  # noqa: N806
        R_GW = to_matrix(multiply(found.q_GT, conjugate(q_WT)))  # noqa: N806
        return dict(zip(list(self._back_end.frames)[-len(R_GW) :], R_GW, strict=True))

    def motion_poses(self, found: TargetEstimate) -> dict[int, FloatArray]:
        """Return T_GB of the frames of the history by a motion, shape (4, 4) each, by number of the frame.

        The motion determines the target's attitude, and the graph the chaser's pose relative to the centre of mass.
        """
        graph = self.graph
        assert graph is not None, "a motion is known after the first frame only"
        attitudes = self.attitudes(found)
        chaser = self._back_end.chaser_poses(len(attitudes))
        return {
            number: pose(R_GW @ T_WB[:3, :3], graph.centre_glued + R_GW @ (T_WB[:3, 3] - graph.centre))
            for (number, R_GW), T_WB in zip(attitudes.items(), chaser, strict=True)
        }

    def refitted(self, poses: Mapping[int, FloatArray]) -> TargetEstimate | None:
        """Return the motion of a body of unknown axes that fits attitudes of frames best; None if it is not found.

        Args:
            poses: T_GB of frames of the history by their number, in ascending order, shape (4, 4) each.
        """
        history, names = self.history(), list(poses)
        places = np.searchsorted(list(self._back_end.frames)[-len(history.times) :], names)
        turns = np.stack([one[:3, :3] for one in poses.values()])
        pairs = [(0, k) for k in range(1, len(names))] + [(k - _LAG, k) for k in range(_LAG + 1, len(names))]
        covariance = 2.0 * _ALIGNED**2 * np.eye(6)
        between = [pose(turns[i].T @ turns[k], np.zeros(3)) for i, k in pairs]
        edges = [Edge(names[i], names[k], one, covariance, 1.0) for (i, k), one in zip(pairs, between, strict=True)]
        shown = History.of(history.times[places], history.chaser[places], from_matrix(turns), edges, names)
        return self._characterise(shown, KnownBody())

    def _fit(self, time: float) -> None:
        graph, known = self.graph, self.target
        if time - self._since < _LEAST_TIME or graph is None:
            return
        history = self.history()
        if len(history.times) < 2:
            return
        self._fitted_at = time
        model = None if graph.model is None else from_matrix(graph.model[:3, :3])
        before = None
        # The fit from a motion of an unknown body whose axes are not known yet may stay in a wrong minimum.
        # From a rod it does: the derivatives vanish there.
        is_found = known is not None and known.axes_sigma < _SURE_AXES and known.ratios[0] > _ROD
        is_sure = self._known.ratios is not None or is_found
        if known is not None and is_sure and known.misfit < _DOUBTFUL and known.aligned == (model is not None):
            before = motion_of(known)
        found = self._characterise(history, self._known, before, model)
        if self.changed and before is not None and not _is_consistent(found, self.tolerance):
            found = self._characterise(history, self._known, None, model)
        if found is None or _is_consistent(found, self.tolerance):
            self.target, self.changed = found or known, self.changed and found is None
        elif self.changed:  # some frames are from before the change, or it changed once more: omit the oldest frames
            self._since = max(self._since, time - _LEAST_TIME + 2.0 * _FIT_PERIOD)
        elif known is not None and found.recent_misfit > _CHANGED_MISFIT * self.tolerance:
            self._forget_before(time - QUICK_SPAN, time)
        else:
            self.target = found

    def _check_motion(self, time: float, edges: list[Edge]) -> None:
        """Check whether the newest attitudes agree with the known motion; if not, discard the frames before them."""
        known = self.target
        if known is None or not edges:
            return
        if self.changed:
            self._follow_newest(time)
            return
        if not known.aligned and self.graph is not None and self.graph.model is not None:
            return  # the newest frames are not related to the axes
        times, q_WG = self.history(_CHANGED_FRAMES).in_inertial  # noqa: N806
        sigma = np.sqrt(np.mean([np.trace(edge.covariance[:3, :3]) for edge in edges]) / 3.0)
        if departs(known, times, multiply(q_WG, known.q_GT), float(sigma), self.tolerance):
            # The frames that are off were taken after the change; those before them possibly were not.
            self._forget_before(float(times[-OFF_FRAMES]), time)

    def _forget_before(self, since: float, time: float) -> None:
        """Mark the motion as changed and find it again from the frames after the time `since` [s]."""
        self.changed, self._since = True, since
        self._follow_newest(time)

    def _follow_newest(self, time: float) -> None:
        """Use the motion of the newest frames."""
        if self.target is not None:
            self.target = newest_motion(self.target, self.history(), time)

    def _trusted(self, expected: FloatArray, edges: list[Edge]) -> list[Edge]:
        """Return the edges that may be used, and record a jump of the bias.

        If a single frame disagrees with the inertial unit, the frame is assumed to be wrong. If the innovation
        persists, the bias of the unit has jumped.
        """
        if self.graph is None or not edges or self._has_coasted:
            self._jumps = max(self._jumps - 1, 0)
            return edges
        innovations = [centre_innovation(self.graph, expected, edge) for edge in edges]
        if self._jumps > 1 or max(innovations) <= _JUMP:  # after a jump, velocity and bias are being estimated again
            self._refused, self._jumps = 0, max(self._jumps - 1, 0)
            return edges
        self._refused, self._jumps = self._refused + 1, 0
        if self._refused <= _MOST_REFUSED:
            return [edge for edge, value in zip(edges, innovations, strict=True) if value <= _JUMP]
        self._jumps = _JUMP_FRAMES
        self._bias_jumps = None
        return edges

    def _mismatch(self, time: float, edges: list[Edge]) -> float:
        """Return a bound of the distance in T between the estimated chaser and where a frame alone shows it [m].

        It is the distance plus the largest standard deviation of the frame's position. That deviation is large, for
        instance, along a face, where a registration only reproduces the expected position. It is infinite if the frame
        shows nothing.
        """
        known, graph = self.target, self.graph
        if known is None or graph is None:
            return np.inf
        relative = {} if all(edge.first == MODEL for edge in edges) else self._back_end.relative_poses()
        q, _ = known.predict(np.array([time]))
        estimated = rotate(conjugate(q[0]), graph.chaser[:3, 3] - graph.centre)
        distances = []
        for edge in edges:
            pose = graph.model if edge.first == MODEL else relative.get(edge.first)
            if pose is not None and edge.second == graph.frame:
                shown = rotate(conjugate(known.q_GT), (pose @ edge.pose)[:3, 3] - graph.centre_glued)
                sigma = np.sqrt(np.linalg.eigvalsh(edge.covariance[3:, 3:])[-1])
                distances.append(float(np.linalg.norm(shown - estimated) + sigma))
        return max(distances, default=np.inf)

    def _predicted(self, time: float) -> FloatArray | None:
        """Return the predicted T_GB at a time [s], shape (4, 4); None before the motion is known."""
        graph, target = self.graph, self.target
        if graph is None or target is None:
            return None
        pose, _, _ = self._back_end.now()
        q, _ = target.predict(np.array([time]))
        relative = np.eye(4)
        relative[:3, :3] = to_matrix(target.q_GT) @ to_matrix(q[0]).T @ pose[:3, :3]
        seen = pose[:3, :3].T @ (graph.centre - pose[:3, 3])
        relative[:3, 3] = graph.centre_glued - relative[:3, :3] @ seen
        return relative
