"""Leaving the target: an escape to rest outside of the sphere that it sweeps, and a departure in free flight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from safe_inspect.dynamics.cwh import transition
from safe_inspect.dynamics.quaternion import conjugate, rotate, to_matrix
from safe_inspect.dynamics.tide import to_hill
from safe_inspect.rendezvous.estimate import StateEstimate
from safe_inspect.rendezvous.planner.query import Limits
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import BoolArray, FloatArray

# Lengths are fractions of the scenario's length, which is 1 m by default.
#: Distance from the end of an escape to the swept sphere, beyond the chaser's radius.
STANDOFF = 0.3
#: Distance from the end of an escape to the sides of the keep-in box, so that an approach and its tube can start there.
_INSET = 0.25
#: Clearance that an escape keeps beyond the chaser's radius.
ESCAPE_CLEARANCE = 0.02
#: Fraction of the force that an escape may use; the rest is for feedback.
_FORCE_SHARE = 0.8
#: Number of times at which a path is checked; between them the Lipschitz constant of the distance gives a bound.
_SAMPLES = 161
#: Directions to the faces and corners of a cube.
_DIRECTIONS = np.array(
    [[*axis] for axis in (*np.eye(3), *-np.eye(3))] + [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)],
    dtype=np.float64,
)
#: Smallest cosine between the direction of a departure and the direction away from the target.
_LEAST_OPENING = 0.5
#: Directions to the centres of the faces and edges of a cube, and to its corners.
_CUBE = np.array([d / np.linalg.norm(d) for d in np.array([*np.ndindex(3, 3, 3)]) - 1.0 if d.any()])
#: Number of times at which free flight is evaluated.
_FLIGHT_SAMPLES = 200
#: Decrease of the range that counts as a rounding error, as a fraction of the range.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Escape:
    """A path in W from a state to rest.

    Attributes:
        times: Times of the samples [s], shape (K,).
        position: Position relative to the target's centre of mass in W [m], shape (K, 3).
        velocity: Velocity in W [m/s], shape (K, 3).
    """

    times: FloatArray
    position: FloatArray
    velocity: FloatArray

    def at(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return position [m] and velocity [m/s] at times [s], shape (K, 3) each; those of the end after it."""
        from scipy.interpolate import CubicHermiteSpline  # This import is slow.

        inside = np.clip(times, self.times[0], self.times[-1])
        path = CubicHermiteSpline(self.times, self.position, self.velocity)
        return path(inside), path(inside, 1)


def safe_radius(target: Target, limits: Limits, length: float = 1.0) -> float:
    """Return the distance from the target's centre at which an escape ends [m], in a scenario of a given length [m]."""
    return target.swept_radius + limits.radius + STANDOFF * length


def find_escape(
    estimate: StateEstimate, target: Target, limits: Limits, durations: Sequence[float], length: float = 1.0
) -> Escape | None:
    """Return the shortest certified escape, outwards or along the axes and diagonals of T; None without one.

    An escape is ``p = R_WT(tau) s``, where s is a polynomial of degree five from the chaser's state to a goal at rest.
    With tau = 0 the polynomial is in W. Otherwise tau' decreases from 1 to 0, and the path first rotates with the
    target.

    A certified path keeps its clearance from the target's boxes, with the predicted rotation of the target, also
    between its samples, because the distance changes at most by ``(|v| + |w| |p|) dt``. It satisfies the limits of
    force and the keep-in box; from outside of the box it leads back into it. The speed limit is that of plans and does
    not apply.

    Args:
        estimate: The estimate of chaser and target.
        target: The target.
        limits: The chaser's limits.
        durations: Durations to try, the shortest first [s].
        length: Length of the scenario [m].
    """
    position = estimate.chaser.position - estimate.target.position
    outwards = position[None] if position.any() else np.empty((0, 3))
    directions = np.concatenate([outwards, _DIRECTIONS @ to_matrix(estimate.target.orientation).T])
    goals = _goals(directions, safe_radius(target, limits, length), limits.keep_in, length)
    for duration in durations:
        times = estimate.time + duration * np.linspace(0.0, 1.0, _SAMPLES)
        q, w = estimate.predict(times)
        for turning in (False, True):
            position, velocity = _paths(estimate, goals, duration, turning)
            fits = _within_limits(position, velocity, duration, limits)
            if fits.any():
                distance = _lowest_distances(target, (q, w), position, velocity, duration, limits)
                fits &= distance >= limits.radius + ESCAPE_CLEARANCE * length
            if fits.any():
                first = int(fits.argmax())
                return Escape(times, position[first], velocity[first])
    return None


def remains_clear(escape: Escape, estimate: StateEstimate, target: Target, limits: Limits) -> bool:
    """Return whether the rest of an escape is clear of the target with its newest predicted rotation.

    Args:
        escape: The escape that the chaser follows.
        estimate: The newest estimate of chaser and target.
        target: The target.
        limits: The chaser's limits.
    """
    later = escape.times >= estimate.time
    if later.sum() < 2:
        return True
    turning = estimate.predict(escape.times[later])
    position, velocity = escape.position[None, later], escape.velocity[None, later]
    duration = float(escape.times[-1] - escape.times[0])
    return bool(_lowest_distances(target, turning, position, velocity, duration, limits)[0] >= limits.radius)


def _goals(directions: FloatArray, radius: float, keep_in: FloatArray, length: float) -> FloatArray:
    """Return the points at a radius along directions, moved into the keep-in box less an inset where possible."""
    goals = radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    longest = int(np.argmax(keep_in))
    keep_in = np.maximum(keep_in - _INSET * length, 0.5 * keep_in)
    goals = np.clip(goals, -keep_in, keep_in)
    others = np.delete(np.arange(3), longest)
    along = np.sqrt(np.maximum(radius**2 - (goals[:, others] ** 2).sum(axis=1), 0.0))
    side = np.where(goals[:, longest] < 0.0, -1.0, 1.0)
    goals[:, longest] = side * np.minimum(along, keep_in[longest])
    return np.asarray(goals)


def _paths(estimate: StateEstimate, goals: FloatArray, duration: float, turning: bool) -> tuple[FloatArray, FloatArray]:
    """Return positions [m] and velocities [m/s] in W of the paths to each goal, shape (G, K, 3) each."""
    share = np.linspace(0.0, 1.0, _SAMPLES)
    start = estimate.chaser.position - estimate.target.position
    velocity = estimate.chaser.velocity
    if not turning:
        return _polynomials(start, velocity, goals, duration, share)
    # tau' = 1 - 3 s^2 + 2 s^3 decreases from 1 to 0 with the fraction s of the duration.
    tau = duration * (share - share**3 + 0.5 * share**4)
    slope = 1.0 - 3.0 * share**2 + 2.0 * share**3
    q, w = estimate.predict(estimate.time + tau)
    in_target = rotate(conjugate(q[0]), start)
    moving = rotate(conjugate(q[0]), velocity) - np.cross(w[0], in_target)
    p, v = _polynomials(in_target, moving, rotate(conjugate(q[-1]), goals), duration, share)
    return rotate(q, p), rotate(q, v + slope[:, None] * np.cross(w, p))


def _polynomials(
    position: FloatArray, velocity: FloatArray, goals: FloatArray, duration: float, share: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities from a state with zero acceleration to rest at goals, shape (G, K, 3) each."""
    first = velocity * duration
    rest = goals - position - first
    zero = np.zeros_like(rest)
    higher = (10.0 * rest + 4.0 * first, -15.0 * rest - 7.0 * first, 6.0 * rest + 3.0 * first)
    coefficients = np.stack([zero + position, zero + first, zero, *higher])
    powers = share[:, None] ** np.arange(6)
    slopes = np.arange(1, 6) * share[:, None] ** np.arange(5) / duration
    return np.einsum("kn,nga->gka", powers, coefficients), np.einsum("kn,nga->gka", slopes, coefficients[1:])


def _within_limits(position: FloatArray, velocity: FloatArray, duration: float, limits: Limits) -> BoolArray:
    """Return a mask of the paths that satisfy the limit of force and the keep-in box, shape (G,)."""
    acceleration = np.diff(velocity, axis=1) / (duration / (_SAMPLES - 1))
    fits: BoolArray = limits.mass * np.abs(acceleration).max(axis=(1, 2)) <= _FORCE_SHARE * limits.force
    keep_in = limits.keep_in + 1e-9
    allowed = np.where(np.abs(position[:, :1]) > keep_in, np.inf, keep_in)  # From outside it must brake first.
    return fits & (np.abs(position) <= allowed).all(axis=(1, 2))


def _lowest_distances(
    target: Target,
    turning: tuple[FloatArray, FloatArray],
    position: FloatArray,
    velocity: FloatArray,
    duration: float,
    limits: Limits,
) -> FloatArray:
    """Return lower bounds of the distances between paths and boxes [m], shape (G,).

    Between two samples with a time difference h and the distances a and b, the distance is at least
    ``(a + b - L h) / 2``.

    Args:
        target: The target.
        turning: Attitudes of the target, shape (K, 4), and its rates [rad/s], shape (K, 3), at the samples.
        position: Positions of the paths in W [m], shape (G, K, 3).
        velocity: Velocities of the paths in W [m/s], shape (G, K, 3).
        duration: Duration of the paths [s].
        limits: The chaser's limits.
    """
    q, w = turning
    step = duration / (_SAMPLES - 1)
    in_model = rotate(conjugate(q), position) @ target.R_MT.T
    distance = target.solid.distance(in_model.reshape(-1, 3)).reshape(position.shape[:2])
    rate = np.linalg.norm(velocity, axis=2) + np.linalg.norm(w, axis=1) * np.linalg.norm(position, axis=2)
    lipschitz = np.maximum(rate[:, 1:], rate[:, :-1]) + np.sqrt(3.0) * limits.force / limits.mass * step
    return np.asarray(0.5 * (distance[:, 1:] + distance[:, :-1] - lipschitz * step).min(axis=1))


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
    position: FloatArray, speed: float, duration: float, keep_in: FloatArray, orbit: tuple[float, float] = (0.0, 0.0)
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
        keep_in: Half sizes of the box about the target [m], shape (3,).
        orbit: Mean motion of the target's orbit [rad/s], 0 for free space, and the current time [s].
    """
    mean_motion, time = orbit
    distance = float(np.linalg.norm(position))
    away = position / distance if distance > 0.0 else np.array([0.0, 0.0, 1.0])
    directions = np.concatenate([away[None], _CUBE])
    directions = directions[directions @ away >= _LEAST_OPENING]
    states = np.hstack([np.broadcast_to(position, directions.shape), speed * directions])
    horizon = max(duration, 2.0 * np.pi / mean_motion) if mean_motion else duration
    hill = to_hill(mean_motion, time, states)
    times = np.linspace(0.0, horizon, _FLIGHT_SAMPLES)
    paths = np.stack([hill @ transition(mean_motion, 1.0, at)[0].T for at in times])
    least = np.minimum(np.linalg.norm(paths[..., :3], axis=2).min(axis=0), (1.0 - _ROUNDING) * distance)
    rest = np.maximum(keep_in - np.sign(directions) * position, 0.0)
    times = np.divide(rest, speed * np.abs(directions), out=np.full(rest.shape, np.inf), where=directions != 0.0)
    inside = np.minimum(times.min(axis=1), duration)
    best = np.lexsort((directions @ away, np.round(inside, 6), least))[-1]
    return np.asarray(speed * directions[best])
