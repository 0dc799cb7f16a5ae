"""Motion of a chaser relative to an unknown target before the centre of mass is known."""

from __future__ import annotations

import numpy as np

from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.types import FloatArray

#: Time constant of keeping the distance from what is seen [s], and number of frames that show what the distance is.
_STATION, _AVERAGED = 100.0, 100


class Station:
    """Motion of the chaser relative to what it sees, from the commands and the mean of the points of each frame.

    The mean moves about as the target turns, so that it corrects the motion slowly, by its difference from the mean
    over the first ones. A part that points to the chaser may hide the target's centre, which is then farther away.

    Args:
        start: The chaser at the start.
        distance: Distance from the target's centre at which the chaser is known to start at least [m].

    Attributes:
        position: Position of the chaser in W [m], shape (3,).
        velocity: Its velocity [m/s], shape (3,).
        seen: Time of the last frame with points [s].
    """

    def __init__(self, start: BodyState, distance: float) -> None:
        self.position, self.velocity = start.position, start.velocity
        self._start, self._distance = start.position, distance
        self._mean, self._frames = np.zeros(3), 0
        self.seen = 0.0

    @property
    def centre(self) -> FloatArray | None:
        """Centre of the target in W as far as it is known [m], shape (3,); None before the first frame."""
        if not self._frames:
            return None
        away = self._mean - self._start
        return self._start + max(self._distance / float(np.linalg.norm(away)), 1.0) * away

    def advance(self, acceleration: FloatArray, step: float) -> None:
        """Advance by a step [s] with the commanded acceleration in W [m/s^2], shape (3,)."""
        self.position = self.position + step * self.velocity + 0.5 * step**2 * acceleration
        self.velocity = self.velocity + step * acceleration

    def correct(self, seen: FloatArray, period: float) -> None:
        """Correct the motion by the chaser's position from the mean of the points, in axes of W [m], shape (3,)."""
        self._frames += 1
        shown = self.position - seen
        if self._frames <= _AVERAGED:
            self._mean = self._mean + (shown - self._mean) / self._frames
        error = self._mean - shown
        self.position = self.position + min(2.0 * period / _STATION, 1.0) * error
        self.velocity = self.velocity + period / _STATION**2 * error
