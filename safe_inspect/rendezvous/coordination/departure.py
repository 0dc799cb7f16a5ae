"""A departure: one push away from the target, then free flight without the need for poses and accelerometers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from safe_inspect.dynamics.cwh import transition
from safe_inspect.dynamics.tide import to_hill
from safe_inspect.rendezvous.estimate import StateEstimate
from safe_inspect.types import FloatArray

#: Smallest cosine between the direction of a departure and the direction away from the target.
_LEAST_OPENING = 0.5
#: Directions to the centres of the faces and edges of a cube, and to its corners.
_DIRECTIONS = np.array([d / np.linalg.norm(d) for d in np.array([*np.ndindex(3, 3, 3)]) - 1.0 if d.any()])
#: Number of times at which free flight is evaluated.
_SAMPLES = 200
#: Decrease of the range that counts as a rounding error, as a fraction of the range.
_ROUNDING = 1e-9


@dataclass(eq=False)
class CommandedMotion:
    """The chaser's motion since the last pose, computed from the commanded forces.

    The velocity from an accelerometer with a bias b is wrong by ``b t`` after a time t, even at rest. The velocity from
    the commands is wrong by a fraction of the commanded change, and exact while the thrusters are off.

    Attributes:
        position: Position in W [m], shape (3,).
        velocity: Velocity in W [m/s], shape (3,).
    """

    position: FloatArray
    velocity: FloatArray

    @classmethod
    def of(cls, estimate: StateEstimate) -> CommandedMotion:
        """Return the motion that starts from an estimate to which a pose has just contributed."""
        return cls(estimate.chaser.position.copy(), estimate.chaser.velocity.copy())

    def advance(self, acceleration: FloatArray, duration: float) -> None:
        """Add a commanded acceleration in W [m/s^2], shape (3,), that was held for a duration [s]."""
        self.position = self.position + duration * (self.velocity + 0.5 * duration * acceleration)
        self.velocity = self.velocity + duration * acceleration


def departure_velocity(
    position: FloatArray,
    speed: float,
    duration: float,
    keep_in: FloatArray | None = None,
    orbit: tuple[float, float] = (0.0, 0.0),
) -> FloatArray:
    """Return a velocity at which free flight leaves the target [m/s], shape (3,).

    The candidates are the direction away from the target, and the axes and diagonals of W within 60 degrees of it. In
    free space the range grows along all of them. On an orbit only those candidates remain along which the range falls
    least below its present value during one revolution. Of these the function returns the one that stays longest in the
    keep-in box within the duration; if there are several, the one that leads away most directly.

    Args:
        position: Position of the chaser relative to the target in W [m], shape (3,).
        speed: Speed of the departure [m/s].
        duration: Time for which the chaser should stay in the keep-in box [s].
        keep_in: Half sizes of the box about the target [m], shape (3,); None for no box.
        orbit: Mean motion of the target's orbit [rad/s], 0 for free space, and the current time [s].
    """
    mean_motion, time = orbit
    distance = float(np.linalg.norm(position))
    away = position / distance if distance > 0.0 else np.array([0.0, 0.0, 1.0])
    directions = np.concatenate([away[None], _DIRECTIONS])
    directions = directions[directions @ away >= _LEAST_OPENING]
    states = np.hstack([np.broadcast_to(position, directions.shape), speed * directions])
    horizon = max(duration, 2.0 * np.pi / mean_motion) if mean_motion else duration
    hill = to_hill(mean_motion, time, states)
    paths = np.stack([hill @ transition(mean_motion, 1.0, at)[0].T for at in np.linspace(0.0, horizon, _SAMPLES)])
    least = np.minimum(np.linalg.norm(paths[..., :3], axis=2).min(axis=0), (1.0 - _ROUNDING) * distance)
    inside = np.full(len(directions), duration)
    if keep_in is not None:
        rest = np.maximum(np.asarray(keep_in) - np.sign(directions) * position, 0.0)
        times = np.divide(rest, speed * np.abs(directions), out=np.full(rest.shape, np.inf), where=directions != 0.0)
        inside = np.minimum(times.min(axis=1), duration)
    best = np.lexsort((directions @ away, np.round(inside, 6), least))[-1]
    return np.asarray(speed * directions[best])
