"""Checks of queries and plans, and the proof that a plan keeps its clearance between its samples too."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safe_inspect.dynamics.quaternion import rotate, to_matrix
from safe_inspect.dynamics.tumble import largest_rate, tumble
from safe_inspect.rendezvous.planner.paths import FIXED, ApproachPath
from safe_inspect.rendezvous.planner.problem import ApproachProblem
from safe_inspect.rendezvous.planner.query import ALLOWANCE, Plan, PlanQuery
from safe_inspect.types import FloatArray

_INTERVALS = 60
_CLEAR_FOR = 2.0  # s: The coasting chaser must not touch the target within this time.
_AT_REST = 5e-3  # m/s: Below this speed the chaser can hold its position during a wait.
#: Largest difference of a plan's ends from those of the query [length, length/s], and largest excess of its samples
#: over a limit, as a fraction of the limit.
_END_ERROR, _EXCESS = 1e-3, 0.01


class Certificate(NamedTuple):
    """The result of a proof of clearance.

    Attributes:
        certified: Whether the clearance is proved.
        clearance: Lower bound of (distance - radius - margin) if certified, else a value that the path reaches [m].
        time: Time since the plan's start at which the proof failed [s]; NaN if certified.
    """

    certified: bool
    clearance: float
    time: float


def certify(query: PlanQuery, path: ApproachPath, wait: float = 0.0, resolution: float = 1e-3) -> Certificate:
    """Prove that ``distance >= radius + margin - 1 cm`` at all times of a path; the 1 cm scales with the length of 1 m.

    In T the chaser's speed is at most ``L = max |v| + max |w| max |p|``, where the path (`ApproachPath`) bounds the
    first and the last factor, and the distance is 1-Lipschitz. In an interval of length h the distance is therefore at
    least d(mid) - L h / 2. Intervals for which this does not prove the clearance are halved. The margin in an interval
    is the largest of its values at the two ends and in the middle.

    Args:
        query: The query.
        path: The path of a plan.
        wait: Time before the approach starts [s].
        resolution: Uncertainty of the distance below which an interval is not halved but counts as not clear [length].
    """
    allowance, resolution = ALLOWANCE * query.length, resolution * query.length
    rate = largest_rate(query.inertia, query.angular_velocity[None])[0]
    speed = float(path.largest_speed + rate * path.largest_distance)
    edges = np.linspace(0.0, path.duration, _INTERVALS + 1)
    left, right = edges[:-1], edges[1:]
    least = np.inf
    while len(left):
        middle = 0.5 * (left + right)
        p, _, _ = path.at(middle)
        q, _ = tumble(query.inertia, query.orientation[None], query.angular_velocity[None], wait + middle)
        in_target = np.einsum("kji,kj->ki", to_matrix(q[0]), p)
        margin = np.max([query.margin(left), query.margin(middle), query.margin(right)], axis=0)
        spare = query.solid.distance(in_target @ query.R_MT.T) - query.limits.radius - margin
        bound = spare - 0.5 * speed * (right - left)
        clear = bound >= -allowance
        least = min(least, float(bound[clear].min(initial=np.inf)))
        failed = ~clear & ((spare < -allowance) | (speed * (right - left) < 2.0 * resolution))
        if failed.any():
            worst = int(np.where(failed, spare, np.inf).argmin())
            return Certificate(False, float(spare[worst]), float(middle[worst]))
        left, middle, right = left[~clear], middle[~clear], right[~clear]
        left, right = np.concatenate((left, middle)), np.concatenate((middle, right))
    return Certificate(True, least, float("nan"))


def start_problem(query: PlanQuery) -> str:
    """Return the problem of the start; an empty string if there is none."""
    limits, p, v = query.limits, query.state[:3], query.state[3:]
    if (np.abs(p) > limits.keep_in).any():
        return f"the start {_text(p)} m is outside the keep-in box of half sizes {_text(limits.keep_in)} m"
    if (np.abs(v) > limits.speed).any():
        return f"the speed at the start is {np.abs(v).max():.3f} m/s along an axis; the limit is {limits.speed:.3f} m/s"
    spare = _hover_clearance(query, np.array([0.0]))[0] - float(query.margin(np.zeros(1))[0])
    if spare < 0.0:
        return f"the start is {-spare:.3f} m closer to the target than radius and margin allow"
    if np.linalg.norm(p) < limits.least_range:
        return f"the start is within {limits.least_range:.2f} m of the target's centre of mass"
    rate = float(np.linalg.norm(np.cross(p, v)) / (p @ p))
    if rate > limits.line_of_sight_rate:
        return f"the line of sight turns at {rate:.3f} rad/s; the limit is {limits.line_of_sight_rate:.3f} rad/s"
    drift = _hover_clearance(query, np.linspace(0.0, _CLEAR_FOR, 21), coasting=True).min()
    if drift < 0.0:
        return f"the chaser would touch the target within {_CLEAR_FOR:.0f} s"
    return ""


def plan_mistake(query: PlanQuery, plan: Plan) -> str:
    """Return why a solved plan does not match its query; an empty string if it does.

    A planner may come from another package. The mission relies on the samples, on the path that the certificate
    evaluates, and on the limits, so they are compared with the query. The clearance is checked by the certificate.

    Args:
        query: The query.
        plan: The plan that the planner returned for it.
    """
    path, limits = plan.path, query.limits
    if path is None:
        return "the plan has no path; return `sampled_plan(query, path)`"
    count = round(plan.duration / query.step) + 1
    since = query.step * np.arange(count, dtype=np.float64)
    if abs(since[-1] - plan.duration) > 1e-6 * query.step or abs(path.duration - plan.duration) > 1e-6 * query.step:
        return f"the duration of {path.duration:g} s is not a multiple of the control step, {query.step:g} s"
    if min(abs(plan.t_start - query.t0 - wait) for wait in query.waits) > 1e-6:
        return f"it starts after {plan.t_start - query.t0:g} s, which is none of the waits in the query"
    if plan.times.shape != since.shape or not np.allclose(plan.times, plan.t_start + since, rtol=0.0, atol=1e-6):
        return f"its samples are not {query.step:g} s apart from its start to its end"
    position, velocity, _ = path.at(since)
    for name, value, expected in (("position", plan.position, position), ("velocity", plan.velocity, velocity)):
        if value.shape != expected.shape or not np.allclose(value, expected, rtol=0.0, atol=1e-6 * query.length):
            return f"its samples of the {name} are not those of its path"
    if not all(np.isfinite(value).all() for value in (plan.force, plan.position_target, plan.acceleration_target)):
        return "its samples are not finite"
    fastest, farthest = (float(np.linalg.norm(value, axis=1).max()) for value in (velocity, position))
    if fastest > path.largest_speed * (1.0 + 1e-9) or farthest > path.largest_distance * (1.0 + 1e-9):
        stated = f"{path.largest_speed:.4g} m/s and {path.largest_distance:.4g} m"
        return f"its path states bounds of {stated}, and reaches {fastest:.4g} m/s and {farthest:.4g} m"
    for what, error in (
        ("starts {} m from the chaser", plan.position[0] - query.state[:3]),
        ("starts {} m/s off the chaser's velocity", plan.velocity[0] - query.state[3:]),
        ("ends {} m from the mating point", plan.position_target[-1] - query.mating_point),
        ("ends {} m/s off the mating point's velocity", plan.velocity_target[-1]),
    ):
        if float(np.linalg.norm(error)) > _END_ERROR * query.length:
            return f"it {what.format(f'{float(np.linalg.norm(error)):.3g}')}"
    force, speed = np.abs(plan.force).max(), np.abs(velocity).max()
    for name, unit, value, most in (("force", "N", force, limits.planned_force), ("speed", "m/s", speed, limits.speed)):
        if value > most * (1.0 + _EXCESS):
            return f"its {name} is {value:.3g} {unit} along an axis; the limit is {most:.3g} {unit}"
    if (np.abs(position) > limits.keep_in * (1.0 + _EXCESS)).any():
        return f"it leaves the keep-in box of half sizes {_text(limits.keep_in)} m"
    return ""


def _hover_clearance(query: PlanQuery, times: FloatArray, coasting: bool = False) -> FloatArray:
    """Return the clearance of a chaser that holds its position or coasts [m], shape (k,).

    Args:
        query: The query.
        times: Times since t0 [s], shape (k,).
        coasting: Whether the chaser keeps its velocity.
    """
    q, _ = tumble(query.inertia, query.orientation[None], query.angular_velocity[None], times)
    p = query.state[:3] + (times[:, None] * query.state[3:] if coasting else 0.0)
    p = np.broadcast_to(p, (len(times), 3))
    in_model = np.einsum("kji,kj->ki", to_matrix(q[0]), p) @ query.R_MT.T
    return query.solid.distance(in_model) - query.limits.radius


def possible_waits(query: PlanQuery) -> tuple[float, ...]:
    """Return the waits during which a chaser at rest keeps its margin from the target; only 0 s if it moves."""
    waits = tuple(sorted(query.waits))
    if np.linalg.norm(query.state[3:]) > _AT_REST:
        return tuple(wait for wait in waits if wait == 0.0)
    if waits[-1] == 0.0:
        return waits
    times = np.arange(0.0, waits[-1] + 0.25, 0.25)
    touching = times[_hover_clearance(query, times) < query.margin(np.zeros(1))[0]]
    return tuple(wait for wait in waits if not len(touching) or wait < touching[0])


def terminal_problem(problem: ApproachProblem) -> str:
    """Return the problem of the state at the mating point; an empty string if there is none."""
    limits, (p, v, _) = problem.limits, problem.end
    rate = float(np.linalg.norm(np.cross(p, v)) / (p @ p))
    spare = float(problem.query.solid.distance((problem.R_MW[-1] @ p)[None])[0] - limits.radius - problem.margin[-1])
    ends = problem.basis.velocity_hull @ problem.ends
    pushes = problem.basis.acceleration_hull @ problem.ends
    free = problem.basis.free
    fast = np.abs(ends[np.abs(problem.basis.velocity_hull[:, free]).max(axis=1) == 0.0]).max()
    hard = np.abs(pushes[np.abs(problem.basis.acceleration_hull[:, free]).max(axis=1) == 0.0]).max()
    outside = (np.abs(problem.ends) - limits.keep_in).max(axis=1) > 1e-9  # Control points are a hull of the ends.
    if outside[-FIXED:].any():
        return f"the mating point {_text(p)} m is outside the keep-in box of half sizes {_text(limits.keep_in)} m"
    if outside[:FIXED].any():
        return f"the velocity at the start leads out of the keep-in box of half sizes {_text(limits.keep_in)} m"
    if _leaves_box(problem):
        return f"the mating point leaves the keep-in box of half sizes {_text(limits.keep_in)} m while it is held"
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


def _leaves_box(problem: ApproachProblem) -> bool:
    """Return whether the mating point leaves the keep-in box within the query's `hold` after the approach."""
    query, keep_in = problem.query, problem.limits.keep_in
    if np.linalg.norm(query.mating_point) <= keep_in.min():
        return False
    held = np.linspace(0.0, query.hold, round(query.hold / query.step) + 1)
    times = problem.wait + problem.basis.duration + held
    q, _ = tumble(query.inertia, query.orientation[None], query.angular_velocity[None], times)
    return bool((np.abs(rotate(q[0], query.mating_point)) > keep_in).any())


def _text(vector: FloatArray) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in vector) + ")"
