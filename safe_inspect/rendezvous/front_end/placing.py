"""Where frames together show a map, relative to where the back end predicts it."""

from __future__ import annotations

from collections import deque

import numpy as np

from safe_inspect.rendezvous.poses import adjoint, difference, inverse, perturbed
from safe_inspect.types import FloatArray

#: Standard deviations of the change of the placing in one second, about and along each axis of the map [rad, m].
_CHANGE = np.diag(np.repeat([np.deg2rad(0.1), 2e-3], 3) ** 2)
#: Number of the newest frames that are compared with the placing.
_COMPARED = 5


class Placing:
    """Kalman filter of the pose T_MG of the target-fixed frame G of the back end in a map M, from single frames.

    The back end predicts T_GB by the motion that was fitted to all frames. A distorted map bends this motion, and
    frames from which the map was made seem to confirm it. The newest frames show where the chaser is relative to the
    part of the map that they see, and T_MG changes slowly.

    Attributes:
        pose: T_MB of the newest frame, as the frames together show it, shape (4, 4); None before the first frame.
        mismatch: Largest distance between where one of the newest frames alone shows the chaser in the map and where
            all together do, plus the largest standard deviation of the latter [m]; infinite before five frames.
    """

    def __init__(self) -> None:
        self._T_MG: FloatArray | None = None
        self._covariance, self._time = np.zeros((6, 6)), 0.0
        self._mismatches: deque[float] = deque([np.inf] * _COMPARED, _COMPARED)
        self.pose: FloatArray | None = None

    @property
    def mismatch(self) -> float:
        """See the class."""
        return max(self._mismatches)

    def expected(self, predicted: FloatArray) -> FloatArray | None:
        """Return T_MB for a predicted T_GB, shape (4, 4); None before the first frame."""
        return None if self._T_MG is None else self._T_MG @ predicted

    def update(self, time: float, predicted: FloatArray, shown: FloatArray, covariance: FloatArray) -> None:
        """Add a frame.

        Args:
            time: Time of the frame [s].
            predicted: Predicted T_GB, shape (4, 4).
            shown: T_MB that the frame shows, shape (4, 4).
            covariance: Covariance of its tangent from the right [rad^2, m^2], shape (6, 6).
        """
        of_frame = shown @ inverse(predicted)
        carry = adjoint(predicted)
        error = carry @ covariance @ carry.T
        if self._T_MG is None:
            self._T_MG, self._covariance = of_frame, error
        else:
            before = self._covariance + (time - self._time) * _CHANGE
            gain = np.linalg.solve(before + error, before).T
            self._T_MG = perturbed(self._T_MG, gain @ difference(self._T_MG, of_frame))
            self._covariance = before - gain @ before
        self._time, self.pose = time, self._T_MG @ predicted
        back = adjoint(inverse(predicted))
        sigma = np.sqrt(np.linalg.eigvalsh((back @ self._covariance @ back.T)[3:, 3:])[-1])
        self._mismatches.append(float(np.linalg.norm(self.pose[:3, 3] - shown[:3, 3]) + sigma))
