"""An approach with a given start time and duration, with the target's motion predicted at its samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, rotate, to_matrix
from safe_inspect.dynamics.tide import tidal_acceleration
from safe_inspect.dynamics.tumble import angular_acceleration, tumble
from safe_inspect.rendezvous.planner.paths import ApproachPath, SplineBasis, spline_basis
from safe_inspect.rendezvous.planner.query import Limits, Plan, PlanQuery, PlanReport, PlanStatus
from safe_inspect.types import FloatArray


class Path(NamedTuple):
    """The motion of a point in one frame: its components and their first and second derivatives.

    Attributes:
        position: Position [m], shape (..., 3).
        velocity: Velocity [m/s], shape (..., 3).
        acceleration: Acceleration [m/s^2], shape (..., 3).
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


def to_inertial(
    inertia: FloatArray, q: FloatArray, w: FloatArray, path: Path, centre: FloatArray | float = 0.0
) -> Path:
    """Transform a path from T to W for a target that turns without torque.

    ``r = c + R p``, ``r' = R (v + w x p)`` and ``r'' = R (a + 2 w x v + w' x p + w x (w x p))``, where p, v and a are
    the components in T and their derivatives, ``w' = -J^-1 (w x J w)``, and the centre of mass c is at rest.

    Args:
        inertia: Principal moments J, up to a common factor, shape (..., 3).
        q: Attitude q_WT, shape (..., 4).
        w: Angular velocity in T [rad/s], shape (..., 3).
        path: The path in T.
        centre: The target's centre of mass in W [m], shape (..., 3).
    """
    p, v, a = path
    wp, dw = np.cross(w, p), angular_acceleration(inertia, w)
    return Path(
        centre + rotate(q, p),
        rotate(q, v + wp),
        rotate(q, a + 2.0 * np.cross(w, v) + np.cross(dw, p) + np.cross(w, wp)),
    )


def to_target(inertia: FloatArray, q: FloatArray, w: FloatArray, path: Path, centre: FloatArray | float = 0.0) -> Path:
    """Transform a path from W to T, the inverse of `to_inertial`.

    ``p = R' (r - c)``, ``v = R' r' - w x p``, ``a = R' r'' - 2 w x v - w' x p - w x (w x p)``.
    """
    back, dw = conjugate(q), angular_acceleration(inertia, w)
    p = rotate(back, path.position - centre)
    wp = np.cross(w, p)
    v = rotate(back, path.velocity) - wp
    a = rotate(back, path.acceleration) - 2.0 * np.cross(w, v) - np.cross(dw, p) - np.cross(w, wp)
    return Path(p, v, a)


@dataclass(frozen=True, eq=False)
class ApproachProblem:
    """The problem of optimising the control points of an approach.

    Attributes:
        query: The query.
        wait: Time before the approach starts [s].
        basis: Basis of the spline.
        ends: Control points at the two ends, zero between them [m], shape (n, 3).
        start: Rows with position, velocity and acceleration in W at the start, shape (3, 3).
        end: Rows with the same at the mating point, shape (3, 3).
        R_MW: Rotations that take coordinates in W to M at the samples, shape (K, 3, 3).
        mating_direction: Unit vectors to the mating point in W at the samples [-], shape (K, 3).
        margin: Clearance required beyond the chaser's radius at the samples [m], shape (K,).
    """

    query: PlanQuery
    wait: float
    basis: SplineBasis
    ends: FloatArray
    start: FloatArray
    end: FloatArray
    R_MW: FloatArray
    mating_direction: FloatArray
    margin: FloatArray

    @property
    def limits(self) -> Limits:
        """The chaser's limits."""
        return self.query.limits

    def cost(self, points: FloatArray) -> float:
        """Return half the integral of the squared force, ``m^2 / 2 int |a|^2`` [N^2 s].

        Args:
            points: Control points [m], shape (n, 3).
        """
        return 0.5 * self.limits.mass**2 * float(np.einsum("ia,ij,ja->", points, self.basis.gram, points))

    @property
    def hessian(self) -> FloatArray:
        """Hessian of the cost for the control points of each axis [N^2 s / m^2], shape (n, n)."""
        return np.asarray(self.limits.mass**2 * self.basis.gram)

    def cold(self) -> FloatArray:
        """Return the control points with the lowest cost, without regard to the constraints."""
        return self.basis.cheapest(self.ends)


def approach_problem(query: PlanQuery, wait: float, duration: float, count: int, samples: int) -> ApproachProblem:
    """Return the problem of an approach.

    Args:
        query: The query.
        wait: Time before the approach starts [s].
        duration: Duration of the approach [s].
        count: Number of control points of an axis.
        samples: Number of samples at which the constraints must hold.
    """
    return approach_problems(query, (wait,), duration, count, samples)[0]


def approach_problems(
    query: PlanQuery, waits: tuple[float, ...], duration: float, count: int, samples: int
) -> list[ApproachProblem]:
    """Return the problems of several waits, with the target's motion computed together; see `approach_problem`."""
    basis = spline_basis(count, samples, float(duration))
    times = np.asarray(waits)[:, None] + basis.times
    motion = tumble(query.inertia, query.orientation[None], query.angular_velocity[None], times.ravel())
    orientation, rate = (value.reshape(*times.shape, -1) for value in motion)
    start = np.stack((query.state[:3], query.state[3:], np.zeros(3)))
    direction = np.broadcast_to(query.mating_point / np.linalg.norm(query.mating_point), (samples, 3))
    margin = np.asarray(query.margin(basis.times), dtype=np.float64)
    problems = []
    for wait, q, w in zip(waits, orientation, rate, strict=True):
        end = mating_state(query, q[-1], w[-1])
        to_model = query.R_MT @ np.swapaxes(to_matrix(q), -1, -2)
        ends, toward = basis.ends(start, end), rotate(q, direction)
        problems.append(ApproachProblem(query, wait, basis, ends, start, end, to_model, toward, margin))
    return problems


def mating_state(query: PlanQuery, q: FloatArray, w: FloatArray) -> FloatArray:
    """Return rows with position [m], velocity [m/s] and acceleration [m/s^2] of the mating point in W, shape (3, 3).

    They are ``p = R m``, ``v = R (w x m)`` and ``a = R (w' x m + w x (w x m))``.

    Args:
        query: The query.
        q: The target's attitude q_WT, shape (4,).
        w: The target's angular velocity in T [rad/s], shape (3,).
    """
    point = Path(query.mating_point, np.zeros(3), np.zeros(3))
    return np.stack(to_inertial(query.inertia, q, w, point))


def sampled_plan(query: PlanQuery, path: ApproachPath, wait: float = 0.0, report: PlanReport | None = None) -> Plan:
    """Return the solved plan of a path, sampled at the query's step or at a slightly smaller one.

    Args:
        query: The query.
        path: The path.
        wait: Time before the approach starts [s], one of the waits in the query.
        report: Report of how the plan was found.
    """
    count = int(np.ceil(path.duration / query.step - 1e-9)) + 1
    times = np.linspace(0.0, path.duration, count)
    outside = Path(*path.at(times))
    q, w = tumble(query.inertia, query.orientation[None], query.angular_velocity[None], wait + times)
    inside = to_target(query.inertia, q[0], w[0], outside)
    p, v, a = outside
    tide = tidal_acceleration(query.mean_motion, query.t0 + wait + times, p) if query.mean_motion else None
    return Plan(
        status=PlanStatus.SOLVED,
        t_start=query.t0 + wait,
        duration=path.duration,
        path=path,
        times=query.t0 + wait + times,
        position=p,
        velocity=v,
        acceleration=a,
        force=query.limits.mass * (a if tide is None else a - tide),
        position_target=inside.position,
        velocity_target=inside.velocity,
        acceleration_target=inside.acceleration,
        orientation=q[0],
        angular_velocity=w[0],
        report=report or PlanReport(),
        tide=tide,
    )
