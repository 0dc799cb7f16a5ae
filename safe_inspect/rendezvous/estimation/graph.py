"""Factor graph of one mission, solved incrementally by iSAM2."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import Field

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rendezvous.estimation.factors import (
    OF_FRAMES,
    ImuBuffer,
    edge_factor,
    inertial_factors,
    key,
    marginal_factors,
    model_centre_factors,
    rotation_kinematic_factors,
    value_of,
)
from safe_inspect.rendezvous.estimation.states import CentrePrior, ChaserStart, GraphEstimate
from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.poses import MODEL, Edge, skew
from safe_inspect.types import FloatArray
from safe_inspect.units import NonNegativeDuration, PositiveLength

#: Standard deviations [rad, m] of G at the first frame, which fixes it, and of the model's pose before it is measured.
_FIXED, _LOOSE = 1e-5, 10.0
#: Standard deviations of the chaser's attitude [rad], position [m] and velocity [m/s] at the start.
_START_ATTITUDE, _START_POSITION, _START_VELOCITY = 1e-4, 1e-4, 1e-3
#: Standard deviation of the rotation kinematic factor, which constrains the centre of mass to be at rest in W [m].
_KINEMATIC = 5e-3
#: Lower-case letters of the variables that belong to a frame.
_OF_FRAMES = set(OF_FRAMES.lower())
#: Residual beyond which an edge counts less, in standard deviations.
_HUBER = 1.345
#: Change beyond which iSAM2 relinearises a variable [rad, m, m/s].
_RELINEARISE = 1e-3
#: Number of intervals between frames within which a jump is detected.
_DOUBTED = 4


class ISAM2BackEnd(Plugin):
    """Factor graph of inertial samples, relative poses and a centre of mass at rest in W, solved by iSAM2.

    Attributes:
        largest: Number of frames beyond which the older half is eliminated.
        memory: Correlation time of the errors of poses relative to the model [s]: their covariances are multiplied by
            ``(1 + rho) / (1 - rho)`` with ``rho = exp(-dt / memory)``; 0 for independent errors.
        model_centre: Standard deviation of the origin of the model from the centre of mass [m].
    """

    largest: int = Field(default=600, ge=10)
    memory: NonNegativeDuration = 2.0  # type: ignore[valid-type]
    model_centre: PositiveLength = 1e-3  # type: ignore[valid-type]

    def __call__(self, imu: ImuBuffer, start: ChaserStart, centre: CentrePrior) -> PoseGraph:
        """Return the back end for a mission; see `PoseGraph`."""
        return PoseGraph(imu, start, centre, self)


class PoseGraph:
    """Factor graph that estimates chaser and target from edges and inertial measurements.

    The variables of each frame are ``X = T_WB``, velocity, bias and ``G = T_GB``. The constant variables are the centre
    of mass, o in G and p in W, and the pose T_GM of the known model. The frames are those of a front end, in ascending
    order. G equals B at the first frame that has an edge.

    Source:
        Kaess et al., "iSAM2: Incremental smoothing and mapping using the Bayes tree", IJRR 31 (2012).

    Args:
        imu: Buffer of the inertial measurements; it is restarted at each frame.
        start: State of the chaser at the first frame, which is frame 0.
        centre: Prior of the centre of mass.
        options: The options.
    """

    def __init__(self, imu: ImuBuffer, start: ChaserStart, centre: CentrePrior, options: ISAM2BackEnd) -> None:
        self._gtsam = gtsam = require("gtsam")
        self.imu, self._options = imu, options
        self._is_qr, self._solver = False, self._new_solver("CHOLESKY")
        self._factors, self._values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        #: All factors with the frames that they concern, for rebuilding the graph.
        self._kept: list[tuple[tuple[int, ...], Any]] = []
        #: Numbers of the frames in the graph, in ascending order.
        self.frames: list[int] = []
        self._reached: set[int] = set()
        self._has_model = False
        #: Inertial factors of the newest intervals between frames, with the factors that replace them after a jump.
        self._doubted: list[list[tuple[Any, Any]]] = []
        #: Number of poses relative to the model that count as one, because their errors are correlated.
        self._alike = 1.0
        pose = gtsam.Pose3(start.pose)
        bias = gtsam.imuBias.ConstantBias()
        self._add_frame(0, pose, start.velocity, bias)
        sigmas = np.repeat([_START_ATTITUDE, _START_POSITION], 3)
        biases = np.repeat([imu.noise.acceleration_bias, imu.noise.rate_bias], 3)
        self._add(gtsam.PriorFactorPose3(key("X"), pose, self._diagonal(sigmas)), 0)
        self._add(gtsam.PriorFactorVector(key("V"), start.velocity, self._same(3, _START_VELOCITY)), 0)
        self._add(gtsam.PriorFactorConstantBias(key("B"), bias, self._diagonal(biases)), 0)
        self._values.insert(key("P"), centre.position)
        self._add(gtsam.PriorFactorPoint3(key("P"), centre.position, self._same(3, centre.sigma)))
        self._centre = centre
        self._state: dict[str, Any] = {}
        self._solution = gtsam.Values()
        self._solve(0)

    def now(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return T_WB (4, 4), the velocity in W (3,) and the angular velocity in B (3,) at the last sample."""
        pose, velocity = self._predicted()
        rate = self.imu.last_rate - self._state["B"].gyroscope()
        return pose.matrix(), np.asarray(velocity), np.asarray(rate)

    def _predicted(self) -> tuple[Any, FloatArray]:
        """Return T_WB and the velocity in W (3,) at the last sample."""
        return self.imu.predict(self._state["X"], self._state["V"], self._state["B"])

    def update(self, frame: int, edges: Sequence[Edge], *, jumped: bool = False) -> None:
        """Add a frame at the time of the last inertial sample.

        Edges to frames that are not in the graph are ignored.

        Args:
            frame: Number of the frame.
            edges: Edges that the front end has measured, to this frame or between earlier ones.
            jumped: Whether the bias has jumped during the last frames; the inertial measurements of these frames then
                have a small weight.
        """
        if jumped:
            self._loosen()
        if len(self.frames) >= self._options.largest:
            self._forget()
        before = self.frames[-1]
        if self._options.memory > 0.0 and self.imu.duration > 0.0:
            share = np.exp(-self.imu.duration / self._options.memory)
            self._alike = float((1.0 + share) / (1.0 - share))
        pose, velocity = self._predicted()
        self._add_frame(frame, pose, velocity, self._state["B"])
        inertial = inertial_factors(before, frame, self.imu)
        for usual, loose in inertial:
            self._add(loose if jumped else usual, before, frame)
        self._doubted = [*self._doubted[1 - _DOUBTED :], inertial]
        for edge in edges:
            self._add_edge(edge)
        self._solve(frame)
        self.imu.restart(self._state["B"])

    def estimate(self) -> GraphEstimate:
        """Return the estimate at the last frame."""
        frame, state = self.frames[-1], self._state
        reached = frame in self._reached
        centre = np.asarray(self._solver.calculateEstimatePoint3(key("P")))
        glued = np.asarray(self._solver.calculateEstimatePoint3(key("O"))) if self._reached else np.zeros(3)
        cov_x, cov_p, cross, velocity = self._marginals(frame)
        rotation = state["X"].rotation().matrix()
        seen = rotation.T @ (centre - state["X"].translation())
        by_chaser = np.hstack([skew(seen), -np.eye(3)])
        mixed = by_chaser @ cross @ rotation
        relative = by_chaser @ cov_x @ by_chaser.T + rotation.T @ cov_p @ rotation + mixed + mixed.T
        return GraphEstimate(
            frame=frame,
            chaser=state["X"].matrix(),
            velocity=np.array(state["V"]),
            bias=np.array(state["B"].vector()),
            relative=self._solver.calculateEstimatePose3(key("G", frame)).matrix() if reached else None,
            centre=centre,
            centre_glued=glued,
            model=self._solver.calculateEstimatePose3(key("M")).matrix() if self._has_model else None,
            chaser_covariance=np.array(cov_x),
            velocity_covariance=np.array(velocity),
            centre_covariance=relative,
        )

    def chaser_poses(self, newest: int | None = None) -> FloatArray:
        """Return the smoothed T_WB of all frames, or of the `newest` ones, shape (F, 4, 4)."""
        frames = self.frames if newest is None else self.frames[-newest:]
        return np.stack([self._solver.calculateEstimatePose3(key("X", frame)).matrix() for frame in frames])

    def relative_poses(self, newest: int | None = None) -> dict[int, FloatArray]:
        """Return the smoothed T_GB by frame, of all frames or of the `newest` ones, omitting those without an edge."""
        frames = self.frames if newest is None else self.frames[-newest:]
        pose_of = self._solver.calculateEstimatePose3
        return {frame: pose_of(key("G", frame)).matrix() for frame in frames if frame in self._reached}

    def _add_edge(self, edge: Edge) -> None:
        gtsam = self._gtsam
        first, second, pose = edge.first, edge.second, gtsam.Pose3(edge.pose)
        if second not in self.frames or (first != MODEL and first not in self.frames):
            return
        if first == MODEL and self._reached and second not in self._reached and not self._has_model:
            self._forget_edges()  # nothing relates the model to the earlier edges: G begins at this frame
        if not self._reached:
            root = second if first == MODEL else first
            self._reach(root, gtsam.Pose3())
            self._add(gtsam.PriorFactorPose3(key("G", root), gtsam.Pose3(), self._same(6, _FIXED)), root)
            guess = self._state["X"].transformTo(self._centre.position) if root == self.frames[-1] else None
            if guess is None:
                guess = self._solver.calculateEstimatePose3(key("X", root)).transformTo(self._centre.position)
            self._values.insert(key("O"), guess)
            self._add(gtsam.PriorFactorPoint3(key("O"), guess, self._same(3, _LOOSE)))
        if first == MODEL:
            if second not in self._reached:
                self._reach(second, self._pose_of("M").compose(pose))
            if not self._has_model:
                self._has_model = True
                model = self._pose_of("G", second).compose(pose.inverse())
                self._values.insert(key("M"), model)
                self._values.insert(key("Z"), np.zeros(3))
                self._add(gtsam.PriorFactorPose3(key("M"), model, self._same(6, _LOOSE)))
                for factor in model_centre_factors(self._options.model_centre):
                    self._add(factor)
            alike = replace(edge, covariance=self._alike * edge.covariance)
            self._add(edge_factor(alike, key("M"), key("G", second), _HUBER), second)
            return
        if first not in self._reached and second not in self._reached:
            return
        if first not in self._reached:
            self._reach(first, self._pose_of("G", second).compose(pose.inverse()))
        if second not in self._reached:
            self._reach(second, self._pose_of("G", first).compose(pose))
        self._add(edge_factor(edge, key("G", first), key("G", second), _HUBER), first, second)

    def _pose_of(self, letter: str, index: int = 0) -> Any:
        name = key(letter, index)
        return self._values.atPose3(name) if self._values.exists(name) else self._solver.calculateEstimatePose3(name)

    def _reach(self, frame: int, relative: Any) -> None:
        """Add G and the rotation kinematic factor of a frame."""
        self._reached.add(frame)
        self._values.insert(key("G", frame), relative)
        guess = self._pose_of("X", frame).transformTo(self._centre.position)
        self._values.insert(key("Y", frame), guess)
        for factor in rotation_kinematic_factors(frame, _KINEMATIC):
            self._add(factor, frame)

    def _add_frame(self, frame: int, pose: Any, velocity: FloatArray, bias: Any) -> None:
        self.frames.append(frame)
        self._values.insert(key("X", frame), pose)
        self._values.insert(key("V", frame), velocity)
        self._values.insert(key("B", frame), bias)

    def _add(self, factor: Any, *frames: int) -> None:
        self._factors.add(factor)
        self._kept.append((frames, factor))

    def _solve(self, frame: int) -> None:
        gtsam = self._gtsam
        values = self._values
        try:
            self._solver.update(self._factors, values)
            self._solver.update()
        except RuntimeError:
            self._solution.insert(values)
            self._use_qr()
        self._factors, self._values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        self._solution = self._solver.calculateEstimate()
        self._state = {letter: value_of(self._solution, letter, frame) for letter in "XVB"}

    def _marginals(self, frame: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return the covariances of X and p, their cross-covariance, and the covariance of the velocity."""
        x, p, v = key("X", frame), key("P"), key("V", frame)
        try:
            if not self._reached:  # no factor connects them yet
                marginals = [self._solver.marginalCovariance(name) for name in (x, p, v)]
                return marginals[0], marginals[1], np.zeros((6, 3)), marginals[2]
            joint = self._solver.jointMarginalCovariance([x, p])
            return joint.at(x, x), joint.at(p, p), joint.at(x, p), self._solver.marginalCovariance(v)
        except RuntimeError:
            if self._is_qr:
                raise
            self._use_qr()
            return self._marginals(frame)

    def _new_solver(self, factorization: str) -> Any:
        parameters = self._gtsam.ISAM2Params()
        parameters.setRelinearizeThreshold(_RELINEARISE)
        parameters.relinearizeSkip = 1
        parameters.setFactorization(factorization)
        return self._gtsam.ISAM2(parameters)

    def _use_qr(self) -> None:
        """Solve all factors again with QR, after Cholesky lost a variable to rounding; QR is three times slower."""
        self._is_qr = True
        self._solve_anew(self._new_solver("QR"))

    def _loosen(self) -> None:
        """Reduce the weight of the inertial factors of the newest intervals, in one of which the bias has jumped."""
        loose = {id(usual): other for interval in self._doubted for usual, other in interval}
        self._kept = [(at, loose.get(id(factor), factor)) for at, factor in self._kept]
        self._doubted = []
        try:
            self._solve_anew(self._gtsam.ISAM2(self._solver.params()))
        except RuntimeError:
            self._use_qr()

    def _solve_anew(self, solver: Any) -> None:
        """Solve all factors with another solver."""
        graph = self._gtsam.NonlinearFactorGraph()
        for _, factor in self._kept:
            graph.add(factor)
        self._solver = solver
        self._solver.update(graph, self._solution)
        self._solver.update()

    def _forget_edges(self) -> None:
        """Remove all factors that concern G, so that another frame becomes its root; keep the chaser's motion."""
        gtsam = self._gtsam
        values, target = gtsam.Values(self._solution), set("gyomz")
        values.insert(self._values)
        factors = [one for one in self._kept if target.isdisjoint(map(self._letter, one[1].keys()))]
        # Factors that an elimination has left concern both.
        older = [factor for _, factor in self._kept if isinstance(factor, gtsam.LinearContainerFactor)]
        names = {name for factor in older for name in self._keys_of(factor, target)}
        if names:
            older += [factor for at, factor in self._kept if factor not in older and names.issuperset(factor.keys())]
            factors = [one for one in factors if one[1] not in older]
            factors += self._eliminated(older, values, names)
        self._restart(factors, values, lambda letter, index: letter in target)
        self._reached = set()

    def _forget(self) -> None:
        """Eliminate the variables of the older half of the frames."""
        frames = self.frames[len(self.frames) // 2 :]
        kept, values = set(frames), self._solver.calculateEstimate()
        older = [factor for at, factor in self._kept if not kept.issuperset(at)]
        names = {name for factor in older for name in self._keys_of(factor, _OF_FRAMES)}
        gone = {name for name in names if self._gtsam.symbolIndex(name) not in kept}
        factors = [one for one in self._kept if kept.issuperset(one[0])] + self._eliminated(older, values, gone)
        self._restart(factors, values, lambda letter, index: letter in _OF_FRAMES and index not in kept)
        self.frames, self._reached = frames, self._reached & kept
        self._solve(frames[-1])

    def _eliminated(self, factors: list[Any], values: Any, names: set[int]) -> list[tuple[tuple[int, ...], Any]]:
        """Return `marginal_factors` with the frames that they concern."""
        found = marginal_factors(factors, values, sorted(names))
        index = self._gtsam.symbolIndex
        return [(tuple({index(name) for name in self._keys_of(one, _OF_FRAMES)}), one) for one in found]

    def _restart(
        self, factors: list[tuple[tuple[int, ...], Any]], values: Any, is_dropped: Callable[[str, int], bool]
    ) -> None:
        """Begin a new graph with some factors, and with the values whose letter and number are not dropped."""
        gtsam = self._gtsam
        self._solver = gtsam.ISAM2(self._solver.params())
        self._factors, self._values, self._kept = gtsam.NonlinearFactorGraph(), values, []
        self._solution = gtsam.Values()
        for at, factor in factors:
            self._add(factor, *at)
        for name in list(values.keys()):
            if is_dropped(self._letter(name), gtsam.symbolIndex(name)):
                values.erase(name)

    def _keys_of(self, factor: Any, letters: set[str]) -> list[int]:
        """Return the keys of a factor with one of some lower-case letters."""
        keys = factor.keys()
        return [name for name in keys if self._letter(name) in letters]

    def _letter(self, name: int) -> str:
        """Return the lower-case letter of a key."""
        return chr(self._gtsam.symbolChr(name))

    def _diagonal(self, sigmas: FloatArray) -> Any:
        return self._gtsam.noiseModel.Diagonal.Sigmas(sigmas)

    def _same(self, size: int, sigma: float) -> Any:
        return self._gtsam.noiseModel.Isotropic.Sigma(size, sigma)
