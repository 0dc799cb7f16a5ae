"""Estimation of one mission from frames and inertial samples."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, from_matrix, multiply, rotate, to_matrix
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
from safe_inspect.rendezvous.estimation.characteriser import PolhodeCharacteriser
from safe_inspect.rendezvous.estimation.factors import ImuBuffer
from safe_inspect.rendezvous.estimation.graph import ISAM2BackEnd, PoseGraph
from safe_inspect.rendezvous.estimation.history import History, TargetEstimate
from safe_inspect.rendezvous.estimation.states import CentrePrior, ChaserStart, GraphEstimate
from safe_inspect.rendezvous.front_end.base import FrontEndRun
from safe_inspect.rendezvous.poses import MODEL, Edge
from safe_inspect.rendezvous.sensors.imu import ImuNoise, InertialSample
from safe_inspect.rendezvous.sensors.tof import DepthFrame
from safe_inspect.rendezvous.target.model import Target
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


@dataclass(frozen=True, eq=False)
class PipelineParts:
    """Components of a pipeline.

    Attributes:
        front_end: The front end of the mission.
        back_end: Options of the back end.
        characterise: Finds the motion.
        target: The target, None if it is not known.
        T_BC: Pose of the camera in B, shape (4, 4).
        imu: Errors of the inertial unit.
        imu_period: Time between two of its samples [s].
    """

    front_end: FrontEndRun
    back_end: ISAM2BackEnd
    characterise: PolhodeCharacteriser
    target: Target | None
    T_BC: FloatArray
    imu: ImuNoise
    imu_period: float


def _is_consistent(found: TargetEstimate | None) -> bool:
    """Return whether a motion was found that agrees with all edges and with the newest ones."""
    return found is not None and max(found.misfit, found.recent_misfit) < _DOUBTFUL


class EstimationPipeline:
    """Front end, back end and characterisation of one mission or recording.

    Args:
        parts: Components of the pipeline.
        start: State of the chaser at time zero.
    """

    def __init__(self, parts: PipelineParts, start: ChaserStart) -> None:
        self._parts, self._start = parts, start
        self._back_end: PoseGraph | None = None
        self._edges: list[Edge] = []
        self._times: dict[int, float] = {}
        self._count = 0
        self._since = 0.0
        self._fitted_at = -np.inf
        self._jumps = self._refused = 0
        self._has_coasted = False
        #: None after the frames have disagreed with the commands, for instance because a thruster failed.
        self._bias_jumps: BiasJumps | None = BiasJumps(parts.imu)
        self._mismatches: deque[float] = deque([np.inf] * _COMPARED, _COMPARED)
        self.graph: GraphEstimate | None = None
        self.target: TargetEstimate | None = None
        self.updated = 0.0
        self.changed = False

    def check_biases(self, samples: Sequence[InertialSample], expected: ExpectedMotion, duration: float) -> None:
        """Compare the samples of a step with the expected motion, before they are used; see `BiasJumps.check`."""
        if self._bias_jumps is None or self._back_end is None or self.graph is None:
            return
        jump = self._bias_jumps.check(samples, expected, self.graph.bias[:3], duration)
        if jump is not None:
            self._back_end.imu.correct(jump)

    def measure(self, acceleration: FloatArray, rate: FloatArray, period: float) -> None:
        """Add a sample of the inertial unit, in B [m/s^2, rad/s], at the end of a period [s].

        Samples before the first frame are not used because the chaser's start is its state at that frame.
        """
        if self._back_end is not None:
            self._back_end.imu.add(acceleration, rate, period)

    def coast(self, period: float, commanded: FloatArray | None = None) -> None:
        """Assume that the commanded motion was flown in a period [s] without a sample; without a command, free flight.

        See `ImuBuffer.coast`.
        """
        self._has_coasted = True
        if self._bias_jumps is not None:
            self._bias_jumps.interrupt()
        if self._back_end is not None:
            self._back_end.imu.coast(period, np.zeros(6) if commanded is None else commanded)

    def see(self, frame: DepthFrame) -> None:
        """Add a frame at the time of the last sample."""
        number, self._count = self._count, self._count + 1
        self._times[number] = frame.time
        if self._back_end is None:
            parts = self._parts
            imu = ImuBuffer(parts.imu, parts.imu_period)
            radius = None if parts.target is None else parts.target.swept_radius
            centre = CentrePrior.seen(frame.points, self._start, parts.T_BC, radius)
            self._back_end = parts.back_end(imu, self._start, centre)
            self._edges += parts.front_end.step(frame, None, np.eye(3))
            return
        back_end = self._back_end
        edges = self._parts.front_end.step(frame, self._predicted(frame.time), back_end.imu.rotation)
        expected, _, _ = back_end.now()
        measured, edges = edges, self._trusted(expected, edges)
        self._edges += edges
        back_end.update(number, edges, jumped=self._jumps == _JUMP_FRAMES)
        self._has_coasted = False
        if self._bias_jumps is not None:
            self._bias_jumps.settle()
        self.graph = back_end.estimate()
        self._mismatches.append(self._mismatch(frame.time, measured))
        self._check_motion(frame.time, edges)
        if self.graph.relative is not None and edges:
            self.updated = frame.time
        if frame.time >= self._fitted_at + _FIT_PERIOD - 1e-9 and edges:
            self._fit(frame.time)

    @property
    def mismatch(self) -> float:
        """Largest distance in T between single frames and the estimate; see `StateEstimate`."""
        return max(self._mismatches)

    def now(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return T_WB (4, 4), the velocity in W (3,) and the angular velocity in B (3,) at the last sample."""
        if self._back_end is None:
            return self._start.pose, self._start.velocity, np.zeros(3)
        return self._back_end.now()

    def history(self) -> History:
        """Return the history of the frames since the last detected change of motion, at most `_LONGEST` seconds."""
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
        if known is not None and known.misfit < _DOUBTFUL and known.aligned == (model is not None):
            before = motion_of(known)
        found = parts.characterise(history, parts.target, before, model)
        if self.changed and before is not None and not _is_consistent(found):
            found = parts.characterise(history, parts.target, None, model)
        if found is None or _is_consistent(found):
            self.target, self.changed = found or known, self.changed and found is None
        elif self.changed:  # some frames are from before the change, or it changed once more: omit the oldest frames
            self._since = max(self._since, time - _LEAST_TIME + 2.0 * _FIT_PERIOD)
        elif known is not None and found.recent_misfit > _CHANGED_MISFIT:
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
        times, orientation = self._newest_attitudes(known)
        sigma = np.sqrt(np.mean([np.trace(edge.covariance[:3, :3]) for edge in edges]) / 3.0)
        if departs(known, times, orientation, float(sigma)):
            # The frames that are off were taken after the change; those before them possibly were not.
            self._forget_before(float(times[-OFF_FRAMES]), time)

    def _newest_attitudes(self, known: TargetEstimate) -> tuple[FloatArray, FloatArray]:
        """Return times [s], shape (n,), and measured attitudes q_WT, shape (n, 4), of the newest frames."""
        assert self._back_end is not None, "frames come before poses"
        is_placed = known.aligned or self.graph is None or self.graph.model is None
        frames = self._back_end.frames[-_CHANGED_FRAMES:]
        poses = dict(zip(frames, self._back_end.chaser_poses(len(frames)), strict=True))
        relative = self._back_end.relative_poses(len(frames)) if is_placed else {}
        q_WG = [from_matrix(poses[frame][:3, :3] @ relative[frame][:3, :3].T) for frame in relative]  # noqa: N806
        times = np.array([self._times[frame] for frame in relative])
        return times, multiply(np.reshape(q_WG, (-1, 4)), known.q_GT)

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
        if known is None or graph is None or self._back_end is None:
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
        if graph is None or target is None or self._back_end is None:
            return None
        pose, _, _ = self._back_end.now()
        q, _ = target.predict(np.array([time]))
        relative = np.eye(4)
        relative[:3, :3] = to_matrix(target.q_GT) @ to_matrix(q[0]).T @ pose[:3, :3]
        seen = pose[:3, :3].T @ (graph.centre - pose[:3, 3])
        relative[:3, 3] = graph.centre_glued - relative[:3, :3] @ seen
        return relative
