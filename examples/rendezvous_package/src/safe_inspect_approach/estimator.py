"""An estimator of one's own: a filter with fixed gains on the poses of a front end and on the inertial unit."""

from dataclasses import replace

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, exp, from_matrix, log, multiply, rotate, to_matrix
from safe_inspect.plugins.functor import functor_field
from safe_inspect.rendezvous.interfaces import (
    MODEL,
    BodyState,
    EstimateErrors,
    FrontEndContext,
    StateEstimate,
    unknown_estimate,
)
from safe_inspect.rendezvous.plugins import StateEstimator

#: Gains on an innovation: of attitude and rate, and of position, velocity and bias; frames until all has settled.
_TURN, _MOVE, _SETTLED = (0.3, 0.05), (0.5, 0.1, 0.008), 40


class FixedGainEstimator(StateEstimator):
    """Predicts with gyroscopes and accelerometers, and corrects by the poses to the known model with fixed gains.

    Attributes:
        front_end: Gives the poses.
    """

    front_end: functor_field("front_end") = "ModelFrontEnd"

    @property
    def reads(self):
        """What it reads of the sensors."""
        return (self.front_end.reads, "inertial")

    def __call__(self, context):
        """Return the estimator of a mission."""
        seen = FrontEndContext(context.camera, context.T_BC, context.target, context.streams)
        return _Run(context, self.front_end(seen))


class _Run:
    def __init__(self, context, front_end):
        self.context, self.front_end = context, front_end
        self.frames, self.updated, self.turn, self.bias = 0, 0.0, np.eye(3), np.zeros(3)

    def update(self, readings):
        """Return the newest estimate."""
        if readings.start is not None:
            self.chaser = readings.start
            self.known = unknown_estimate(0.0, 0.0, self.chaser, self.context.target.principal, 0.9)
        for sample in readings.samples:
            self._move(sample.acceleration, sample.rate)
        if readings.frame is not None:
            edges = self.front_end.step(readings.frame, None, self.turn)
            self.turn = np.eye(3)
            for edge in (edge for edge in edges if edge.first == MODEL):
                self._correct(readings.time, edge.pose)
        q, w = self.known.predict(np.array([readings.time]))
        body = self.known.target._replace(orientation=q[0], angular_velocity=w[0])
        return replace(self.known, time=readings.time, updated=self.updated, chaser=self.chaser, target=body)

    def _move(self, acceleration, rate):
        dt, (p, v, q, _) = self.context.imu_period, self.chaser
        gained = dt * rotate(q, acceleration - self.bias)
        turn = exp(dt * rate)
        self.turn = self.turn @ to_matrix(turn)
        self.chaser = BodyState(p + dt * (v + 0.5 * gained), v + gained, multiply(q, turn), rate)

    def _correct(self, time, T_MB):  # noqa: N803
        p, v, q, rate = self.chaser
        seen = rotate(q, T_MB[:3, :3].T @ T_MB[:3, 3])  # the chaser from the target, in W
        attitude = multiply(q, from_matrix(T_MB[:3, :3].T @ self.context.target.R_MT))
        since, dt = self.frames, self.context.frame_period
        self.frames, self.updated = since + 1, time
        w = np.zeros(3)
        if since:
            expected, w = (value[0] for value in self.known.predict(np.array([time])))
            error = log(multiply(conjugate(expected), attitude))
            gains = np.maximum(_TURN, (1.0, 1.0 / since)) if since < 5 else _TURN  # the first frames give the rate
            attitude, w = multiply(expected, exp(gains[0] * error)), w + gains[1] / dt * error
        self.bias = self.bias - _MOVE[2] / dt**2 * rotate(conjugate(q), seen - p)
        self.chaser = BodyState(p + _MOVE[0] * (seen - p), v + _MOVE[1] / dt * (seen - p), q, rate)
        body = BodyState(np.zeros(3), np.zeros(3), attitude, w)
        errors = EstimateErrors(attitude=0.01, rate=0.001, velocity=0.002)
        problem = "" if self.frames > _SETTLED else "the filter has not settled"
        self.known = StateEstimate(time, time, self.chaser, body, self.known.inertia, errors, 0.9, problem)
