"""Prediction of a tumbling body's pose in the next frame: constant rate, and the chaser's rotation from the gyro."""

from __future__ import annotations

import numpy as np

from safe_inspect.rendezvous.poses import pose, rotation_exp, rotation_log
from safe_inspect.types import FloatArray

#: Weight of the newest difference in the smoothed rate and velocity.
_WEIGHT = 0.5


class RelativeMotion:
    """Predictor of T_MB of a body with constant rate and velocity, relative to a chaser whose rotation is measured.

    With g = R_B'B of the gyro, ``R_MB = D^T R_MB' g``, where D = Exp(w dt) rotates the body about its axes. The origin
    of M, relative to the chaser, moves by ``c = g^T (c' + v dt)``.

    Args:
        time: Time of the first pose [s].
        first: The first pose T_MB, shape (4, 4).
    """

    def __init__(self, time: float, first: FloatArray) -> None:
        self._time, self._pose = time, first
        self._turn = np.eye(3)
        self._rate: FloatArray | None = None
        self._velocity = np.zeros(3)

    def turned(self, rotation: FloatArray) -> None:
        """Add a rotation of the chaser, R_B'B from the gyro, shape (3, 3)."""
        self._turn = self._turn @ rotation

    def predict(self, time: float) -> FloatArray:
        """Return T_MB at a time [s], shape (4, 4)."""
        seconds = time - self._time
        body = np.eye(3) if self._rate is None else rotation_exp(self._rate * seconds)
        R_MB = body.T @ self._pose[:3, :3] @ self._turn  # noqa: N806
        centre = -self._pose[:3, :3].T @ self._pose[:3, 3]
        return pose(R_MB, -R_MB @ (self._turn.T @ (centre + self._velocity * seconds)))

    def observe(self, time: float, found: FloatArray) -> None:
        """Add a pose T_MB, shape (4, 4), that was measured at a time [s]."""
        if time > self._time:
            seconds = time - self._time
            body = self._pose[:3, :3] @ self._turn @ found[:3, :3].T
            rate = rotation_log(body) / seconds
            self._rate = rate if self._rate is None else (1.0 - _WEIGHT) * self._rate + _WEIGHT * rate
            before, after = -self._pose[:3, :3].T @ self._pose[:3, 3], -found[:3, :3].T @ found[:3, 3]
            velocity = (self._turn @ after - before) / seconds
            self._velocity = self._turn.T @ ((1.0 - _WEIGHT) * self._velocity + _WEIGHT * velocity)
        self._time, self._pose, self._turn = time, found, np.eye(3)
