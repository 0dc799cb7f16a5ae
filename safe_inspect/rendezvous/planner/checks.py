"""What a query must satisfy before anything is optimised."""

from __future__ import annotations

import numpy as np

from safe_inspect.dynamics.quaternion import to_matrix
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.rendezvous.planner.problem import ApproachProblem
from safe_inspect.rendezvous.planner.query import PlanQuery
from safe_inspect.rendezvous.planner.spline import FIXED
from safe_inspect.types import FloatArray

_CLEAR_FOR = 2.0  # s: the chaser must not touch the target that soon, whatever it does
_AT_REST = 5e-3  # m/s: the chaser holds its position during a wait


def start_problem(query: PlanQuery) -> str:
    """Return what is wrong with the start, or an empty string."""
    limits, p, v = query.limits, query.state[:3], query.state[3:]
    if limits.keep_in is not None and (np.abs(p) > limits.keep_in).any():
        return f"the start {_text(p)} m is outside the keep-in box of half sizes {_text(limits.keep_in)} m"
    if (np.abs(v) > limits.speed).any():
        return f"the speed at the start is {np.abs(v).max():.3f} m/s along an axis; the limit is {limits.speed:.3f} m/s"
    spare = hover_clearance(query, np.array([0.0]))[0] - float(query.margin(np.zeros(1))[0])
    if spare < 0.0:
        return f"the start is {-spare:.3f} m closer to the target than radius and margin allow"
    if np.linalg.norm(p) < limits.least_range:
        return f"the start is within {limits.least_range:.2f} m of the target's centre of mass"
    rate = float(np.linalg.norm(np.cross(p, v)) / (p @ p))
    if rate > limits.line_of_sight_rate:
        return f"the line of sight turns at {rate:.3f} rad/s; the limit is {limits.line_of_sight_rate:.3f} rad/s"
    drift = hover_clearance(query, np.linspace(0.0, _CLEAR_FOR, 21), coasting=True).min()
    if drift < 0.0:
        return f"the chaser would touch the target within {_CLEAR_FOR:.0f} s"
    return ""


def hover_clearance(query: PlanQuery, times: FloatArray, coasting: bool = False) -> FloatArray:
    """Return distance less radius of a chaser that stays where it is, or coasts [m], shape (k,).

    Args:
        query: The query.
        times: Times since t0 [s], shape (k,).
        coasting: Whether the chaser keeps its velocity.
    """
    q, _ = tumble(query.inertia, query.orientation[None], query.angular_velocity[None], times)
    p = query.state[:3] + (times[:, None] * query.state[3:] if coasting else 0.0)
    p = np.broadcast_to(p, (len(times), 3))
    in_model = np.einsum("kji,kj->ki", to_matrix(q[0]), p) @ query.R_MT.T
    return query.boxes.distance(in_model) - query.limits.radius


def possible_waits(query: PlanQuery) -> tuple[float, ...]:
    """Return the waits during which the chaser, at rest, keeps clear of the target: the first ones, up to a touch."""
    waits = tuple(sorted(query.waits))
    if np.linalg.norm(query.state[3:]) > _AT_REST:
        return tuple(wait for wait in waits if wait == 0.0)
    if waits[-1] == 0.0:
        return waits
    times = np.arange(0.0, waits[-1] + 0.25, 0.25)
    touching = times[hover_clearance(query, times) < query.margin(np.zeros(1))[0]]
    return tuple(wait for wait in waits if not len(touching) or wait < touching[0])


def terminal_problem(problem: ApproachProblem) -> str:
    """Return what is wrong with the state at the mating point, or an empty string."""
    limits, (p, v, _) = problem.limits, problem.end
    rate = float(np.linalg.norm(np.cross(p, v)) / (p @ p))
    spare = float(problem.query.boxes.distance((problem.R_MW[-1] @ p)[None])[0] - limits.radius - problem.margin[-1])
    ends = problem.basis.velocity_hull @ problem.ends
    pushes = problem.basis.acceleration_hull @ problem.ends
    free = problem.basis.free
    fast = np.abs(ends[np.abs(problem.basis.velocity_hull[:, free]).max(axis=1) == 0.0]).max()
    hard = np.abs(pushes[np.abs(problem.basis.acceleration_hull[:, free]).max(axis=1) == 0.0]).max()
    if limits.keep_in is not None:
        outside = (np.abs(problem.ends) - limits.keep_in).max(axis=1) > 1e-9  # control points: a hull of the ends
        if outside[-FIXED:].any():
            return f"the mating point {_text(p)} m is outside the keep-in box of half sizes {_text(limits.keep_in)} m"
        if outside[:FIXED].any():
            return f"the velocity at the start leads out of the keep-in box of half sizes {_text(limits.keep_in)} m"
    if spare < 0.0:
        return f"the mating point is {-spare:.3f} m closer to the target than radius and margin allow"
    if fast > limits.speed:
        return f"the mating point moves at {fast:.3f} m/s along an axis; the limit is {limits.speed:.3f} m/s"
    most = problem.query.planned_acceleration
    if hard > most:
        needed, allowed = limits.mass * hard, limits.mass * most
        return f"following the mating point takes {needed:.3f} N along an axis; the limit is {allowed:.3f} N"
    if rate > limits.line_of_sight_rate:
        most = limits.line_of_sight_rate
        return f"the line of sight turns at {rate:.3f} rad/s at the mating point; the limit is {most:.3f} rad/s"
    if np.linalg.norm(p) < limits.least_range:
        return f"the mating point is within {limits.least_range:.2f} m of the target's centre of mass"
    return ""


def _text(vector: FloatArray) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in vector) + ")"
