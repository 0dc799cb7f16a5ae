"""Results of bounds, tubes, trackers, ways out and attitude control on fixed inputs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from safe_inspect.dynamics.quaternion import exp
from safe_inspect.geometry.oriented_boxes import OrientedBoxes
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.control.attitude import AttitudeCommand, AttitudeController, CameraPointing
from safe_inspect.rendezvous.control.bound import Bound, BoundQuery, ConformalBound
from safe_inspect.rendezvous.control.design import (
    DesignRequest,
    TubeDesign,
    design_by_clearance,
    design_tube,
    design_without_tube,
)
from safe_inspect.rendezvous.control.tracker import LinearFeedback
from safe_inspect.rendezvous.control.tube import Axis, TrackedReference, TrackingLimits
from safe_inspect.rendezvous.coordination.actions import reference_of, reference_problem
from safe_inspect.rendezvous.coordination.context import PlanDemands
from safe_inspect.rendezvous.coordination.escape import departure_velocity, find_escape, remains_clear, safe_radius
from safe_inspect.rendezvous.coordination.pilot import TABLE
from safe_inspect.rendezvous.estimate import BodyState, EstimateErrors, JointErrors, StateEstimate
from safe_inspect.rendezvous.planner.paths import SplinePath
from safe_inspect.rendezvous.planner.problem import approach_problem, sampled_plan
from safe_inspect.rendezvous.planner.query import Limits, Plan, PlanQuery
from safe_inspect.rendezvous.target.boxes import EnvisatTarget

#: What is recorded: a name for each result, and how it is computed.
Pieces = dict[str, Callable[[], Any]]
STREAMS = Streams(11, np.zeros(1, np.int64), np.zeros(1, np.int64))
AXIS = Axis(9.583788668)


def query(**changes: Any) -> PlanQuery:
    """Return an approach from 1.5 m at rest, to a target that turns at 5 degrees per second."""
    rate = np.array([0.7, 0.5, 0.5])
    base = PlanQuery(
        t0=3.0,
        state=np.array([0.1, -1.5, 0.2, 0.0, 0.0, 0.0]),
        orientation=np.array([0.1, -0.3, 0.5, 0.8]) / np.sqrt(0.99),
        angular_velocity=np.deg2rad(5.0) * rate / np.linalg.norm(rate),
        inertia=np.array([0.1314, 0.9661, 1.0]),
        mating_point=np.array([0.25, 0.0, 0.42]),
        solid=OrientedBoxes(np.array([[0.1, 0.0, 0.0]]), np.full((1, 3), 0.1), np.eye(3)[None]),
        R_MT=np.eye(3),
    )
    return replace(base, **changes)


@cache
def plan(mean_motion: float = 0.0) -> Plan:
    """Return the cheapest approach, whatever is in its way."""
    asked = query(mean_motion=mean_motion)
    problem = approach_problem(asked, 0.0, 30.0, 12, 61)
    return sampled_plan(asked, SplinePath(problem.basis, problem.cold()))


def bound(scale: float = 1.0) -> Bound:
    """Return a bound that shrinks from 2 cm to 5 mm."""
    shrinking = np.linspace(1.0, 0.25, len(plan().times))
    return Bound(plan().times, scale * 0.02 * shrinking, scale * 2e-3 * shrinking, scale * 2e-3 * shrinking, 0.95, 100)


def _bounds() -> Any:
    errors = EstimateErrors(0.02, 1e-3, 4e-3, 0.3, 2e-3, 1e-3)
    root = np.random.default_rng(4).normal(size=(14, 14)) * np.repeat([0.2, 0.02, 1e-3, 4e-3, 1e-3], [2, 3, 3, 3, 3])
    joint = JointErrors(0.02, 1e-3, 4e-3, 0.3, 0.0, 1e-3, 0.1 * root.T @ root)
    cases = {
        "updates": (errors, (1.0, 0.8), 9.0),
        "once": (errors, (None,), 9.5),
        "exact inertia": (EstimateErrors(0.02, 1e-3), (2.0,), 9.0),
        "joint": (joint, (1.0, 0.5), 9.0),
    }
    found = {}
    for name, (own, updates, mass) in cases.items():
        asked = BoundQuery(plan(), query().inertia, own, *updates, mass=mass)
        one = ConformalBound(epsilon=0.2, trials=24)(asked, STREAMS)
        found[name] = [one.position, one.velocity, one.force, one.level, one.trials]
    return found


def _design(found: TubeDesign) -> Any:
    tube = found.tube
    return {
        "gain": tube.gain, "tube": [tube.position, tube.velocity, tube.clearance, tube.force],
        "force": found.force_reserve, "room": found.state_reserve, "margin": found.margin, "refusal": found.refusal,
        "between": found.margin_at(np.array([-1.0, 0.1, 0.2, 3.0 + 1e-9, 29.9, 40.0])),
    }  # fmt: skip


def request(clearance: float = 1.0, **changes: Any) -> DesignRequest:
    """Return a request for the plan whose clearance shrinks from the given one [m] to 60 %."""
    distance = np.linspace(clearance, 0.6 * clearance, len(plan().times))
    return replace(DesignRequest(plan(), bound(), distance, AXIS, TrackingLimits(), 4e-3), **changes)


def _designs() -> Any:
    stiff = np.array([[-2.0, -7.0], [-3.0, -9.0], [-4.0, -10.0]])
    requests = {
        "wide": request(),
        "narrow": request(0.13, limits=TrackingLimits(force=0.5)),
        "long": request(2.0, length=2.0),
        "gain": request(gain=np.array([-1.5, -6.0])),
        "gains": request(gain=stiff),
        "gain that is too stiff": request(gain=np.array([-20.0, -25.0])),
        "force": request(limits=TrackingLimits(force=0.09)),
        "box": request(limits=TrackingLimits(keep_in=np.array([0.8, 1.51, 0.8]))),
        "speed": request(limits=TrackingLimits(speed=0.03)),
        "no box": request(limits=TrackingLimits(keep_in=np.full(3, np.inf))),
    }
    found = {name: _design(design_by_clearance(one, (0.2, 0.35, 0.6, 1.0))) for name, one in requests.items()}
    found["greedy"] = _design(design_tube(request(length=2.0, force_error=3e-3), reserve=5.0))
    found["none"] = _design(design_without_tube(request(length=3.0)))
    return found


def _trackers() -> Any:
    design = design_by_clearance(request(), (0.35, 0.6))
    reference = TrackedReference(plan().position, plan().velocity)
    moved = TrackedReference(plan().position + 0.01, plan().velocity)
    random, found = np.random.default_rng(2), {}
    for name, error, force in (
        ("near", 0.004, 0.3), ("far", 0.05, 0.3), ("weak", 0.15, 0.2), ("weaker", 0.3, 0.2), ("beyond", 1.0, 0.3),
    ):  # fmt: skip
        run = LinearFeedback(AXIS, design.tube, force)
        steps = []
        for k in range(14):
            offset = error * random.normal(size=6) * np.repeat([1.0, 0.1], 3) * (k < 6)
            followed = moved if k > 8 else reference
            out = run.step(np.concatenate([followed.position[k], followed.velocity[k]]) + offset, followed, k)
            steps.append([out.force, out.outside])
        found[name] = steps
    orbit = plan(1e-3)
    run, followed = LinearFeedback.of_lqr(AXIS, 0.2), TrackedReference(orbit.position, orbit.velocity, orbit.tide)
    off = np.array([0.004, 0.003, -0.02, 0.0, 0.01, 0.003])
    for k in (0, 3, len(orbit.times) - 1):
        at = np.concatenate([orbit.position[k], orbit.velocity[k]]) + off
        found[f"regulator {k}"] = [run.step(at, followed, k).force, run.step(at, followed, k).outside]
    return found


def _problems() -> Any:
    design = design_by_clearance(request(), (0.35, 0.6))
    endless = np.full(len(plan().times), np.inf)
    wide = replace(bound(), position=endless, velocity=endless)
    at, speed = plan().position, plan().velocity
    late = np.arange(len(at))[:, None] > 100
    cases = {
        "position": (bound(), at + 0.021 * late, speed, 0),
        "velocity": (bound(), at, speed - 3e-3 * late, 4),
        "before": (bound(), at + 0.1 * ~late, speed, 120),
        "box": (wide, at + np.array([0.0, -1.49, 0.0]), speed, 0),
        "speed": (wide, at, speed + np.linspace(0.0, 0.16, len(at))[:, None], 2),
        "force": (wide, at, speed + 0.08 * late, 90),
    }
    return {
        name: reference_problem(design, plan(), limit, TrackedReference(p, v), k)
        for name, (limit, p, v, k) in cases.items()
    }


def _estimate(position: tuple[float, ...], velocity: tuple[float, ...] = (0.0, 0.0, 0.0)) -> StateEstimate:
    asked, centre = query(), np.array([0.02, -0.01, 0.03])
    chaser = BodyState(np.array(position), np.array(velocity), np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3))
    target = BodyState(centre, np.zeros(3), asked.orientation, asked.angular_velocity)
    return StateEstimate(7.0, 7.0, chaser, target, asked.inertia, EstimateErrors(0.01, 1e-3), 0.9)


def _escapes() -> Any:
    target, found = EnvisatTarget(mating_point=(0.25, 0.0, 0.42))(), {}
    room, strong = Limits(), Limits(force=0.8, keep_in=np.full(3, np.inf))
    for name, estimate, limits, length in (
        ("far", _estimate((0.1, -1.4, 0.2)), room, 1.0),
        ("near", _estimate((0.45, -0.2, 0.35)), room, 1.0),
        ("moving", _estimate((0.1, -0.75, 0.1), (0.03, 0.06, -0.02)), room, 1.0),
        ("outside", _estimate((0.85, -1.2, 0.1), (0.02, 0.0, 0.0)), room, 1.0),
        ("strong", _estimate((0.2, 0.6, 0.6), (0.0, 0.02, 0.0)), strong, 1.2),
        ("turning", _estimate((0.6, -0.15, 0.33), (0.0, 0.0, 0.01)), strong, 0.5),
        ("inside", _estimate((0.1, 0.0, 0.0)), room, 1.0),
    ):
        escape = find_escape(estimate, target, limits, (6.0, 10.0, 20.0, 40.0), length)
        if escape is None:
            found[name] = None
            continue
        turned = replace(
            estimate, time=9.0, target=estimate.target._replace(angular_velocity=np.array([0.6, 0.1, 0.4]))
        )
        position, velocity = escape.at(np.array([0.0, 8.0, 9.5, 99.0]))
        found[name] = [
            escape.times, escape.position, escape.velocity, position, velocity, safe_radius(target, limits, length),
            remains_clear(escape, estimate, target, limits), remains_clear(escape, turned, target, limits),
            remains_clear(escape, replace(turned, time=float(escape.times[-1])), target, limits),
        ]  # fmt: skip
    return found


def _departures() -> Any:
    box = np.array([0.8, 3.0, 0.8])
    return [
        departure_velocity(np.array([0.7, 0.9, -0.5]), 0.02, 60.0, np.full(3, np.inf)),
        departure_velocity(np.array([0.7, 0.9, -0.5]), 0.02, 60.0, box),
        departure_velocity(np.array([0.3, -0.2, 0.79]), 0.05, 20.0, box),
        departure_velocity(np.array([0.0, 0.0, 0.0]), 0.05, 20.0, box),
        departure_velocity(np.array([3.0, -20.0, 6.0]), 0.1, 600.0, np.full(3, 40.0), (1e-3, 500.0)),
        departure_velocity(np.array([20.0, 1.0, -2.0]), 0.02, 60.0, np.full(3, np.inf), (1.1e-3, 0.0)),
    ]


def _demands() -> Any:
    found: list[Any] = []
    first, times, position = PlanDemands.first(1.5), np.array([0.0, 10.0, 29.0]), np.array([0.75, -1.5, 0.1])
    requests = (
        request(limits=TrackingLimits(force=0.09)), request(limits=TrackingLimits(keep_in=np.array([0.8, 1.51, 0.8]))),
        request(limits=TrackingLimits(speed=0.03)),
    )  # fmt: skip
    demands = first
    for one in (*requests, *requests):
        demands = demands.after(design_by_clearance(one, (0.35, 0.6)))
        later, limits = demands.later(5.0), demands.limits(Limits(), position)
        found.append(
            [demands.margin(times), later.margin(times), demands.gain, demands.growth, demands.keep_in, demands.speed,
             demands.force, later.gain, limits.keep_in, limits.speed, limits.planned_force],
        )  # fmt: skip
    free = demands.limits(Limits(keep_in=np.full(3, np.inf)), position)
    untold = demands.after(design_without_tube(request()))
    return [*found, first.margin(times), free.keep_in, untold.gain, untold.growth, demands.after(
        design_by_clearance(request(), (0.35,))).growth]  # fmt: skip


def _references() -> Any:
    estimate, point = _estimate((0.0, -1.0, 0.0)), query().mating_point
    free = reference_of(plan(), estimate, point, 4, 0.2, 0.0)
    orbit = reference_of(plan(), estimate, point, 2, 0.2, 1e-3)
    assert orbit.tide is not None
    return [free.position, free.velocity, free.tide, orbit.position, orbit.tide, orbit.tide[-1]]


def _attitudes() -> Any:
    pointing, found = CameraPointing(exp(np.array([0.1, 0.2, -0.3])), 0.15, 0.1), []
    controller = AttitudeController(np.array([0.15, 0.14, 0.16]), 0.02, 0.8, 0.7)
    for k in range(6):
        at = np.array([0.3 * np.sin(k), -1.5 + 0.2 * k, 0.1 * k])
        command = pointing.step(at, np.array([0.1, 0.0, 0.02 * k]), 0.4)
        turned, rate = exp(np.array([0.1 * k, -0.3, 0.02])), np.array([0.05, -0.02 * k, 0.03])
        found.append([command.orientation, command.angular_velocity, controller(turned, rate, command)])
        small = AttitudeCommand(turned, np.array([0.01, 0.0, -0.01]))
        found.append([controller(-exp(np.array([0.1 * k, -0.29, 0.03])), 0.1 * rate, small)])
    return found


def _table() -> Any:
    return [[row.state.value, row.guard.__name__, row.action.__name__, row.next.value] for row in TABLE]


PIECES: Pieces = {
    "bounds": _bounds, "designs": _designs, "trackers": _trackers, "problems of references": _problems,
    "escapes": _escapes, "departures": _departures, "demands": _demands, "references": _references,
    "attitudes": _attitudes, "table": _table,
}  # fmt: skip
