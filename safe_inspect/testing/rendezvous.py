"""Contract of the plugins of a rendezvous: shapes, equal results for equal inputs, and unchanged inputs."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from safe_inspect.dynamics.quaternion import to_matrix
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.geometry.pointing import R_BC
from safe_inspect.missions.truth import ChaserTrace, SensorSuite, estimator_context
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.control.bound import BoundQuery, ConformalBound
from safe_inspect.rendezvous.control.design import DesignRequest
from safe_inspect.rendezvous.control.tube import Axis, TrackedReference, TrackingLimits
from safe_inspect.rendezvous.depth_camera import TimeOfFlightCamera
from safe_inspect.rendezvous.estimate import BodyState, EstimateErrors
from safe_inspect.rendezvous.experiment import RendezvousConfig
from safe_inspect.rendezvous.front_end.base import FrontEndContext
from safe_inspect.rendezvous.measured_poses import PoseFrame, PoseSensor, PoseSensorRun
from safe_inspect.rendezvous.models import Fault, MissionConfig
from safe_inspect.rendezvous.planner.checks import certify, plan_mistake
from safe_inspect.rendezvous.planner.query import Plan, PlanQuery, PlanStatus
from safe_inspect.rendezvous.plugins import (
    ApproachPlanner,
    EnvisatTarget,
    FrontEnd,
    SplineSCPPlanner,
    StateEstimator,
    TargetModel,
    Tracker,
)
from safe_inspect.rendezvous.poses import MODEL, Edge, inverse, pose
from safe_inspect.rendezvous.readings import Command
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.testing.calls import Check, SampleParts
from safe_inspect.testing.report import WRITES, Report
from safe_inspect.types import AnyArray, FloatArray

#: T_WB of a chaser that looks at the origin along y of W.
LOOKING = pose(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([0.0, -1.5, 0.0]))


def _check_target_model(plugin: TargetModel, report: Report) -> None:
    """Check a target model: its mating point must be outside of it."""
    target, again = plugin(), plugin()
    _same(report, "the target", _arrays(target), _arrays(again))
    _finite(report, "the mating point", target.mating_point, (3,))
    _finite(report, "the mesh", target.mesh.vertices, (len(target.mesh.vertices), 3))
    outside = target.solid.distance((target.R_MT @ target.mating_point)[None])[0]
    report.expect(outside > 0.0, "mating point", "the mating point is inside the target", "move it out of the target")


def _check_state_estimator(plugin: StateEstimator, report: Report) -> None:
    """Check an estimator: its estimates for a chaser at rest in front of a target, with a camera that fails later."""
    chaser, body = _bodies()
    camera = Fault(kind="camera", start=1.5, duration=10.0)
    config = RendezvousConfig.model_validate({"mission": MissionConfig(faults=(camera,))})
    context = estimator_context(config, _target(), _streams())
    still = ChaserTrace(*(np.tile(array, (config.mission.control_ticks, 1)) for array in (*chaser, np.zeros(6))))

    def estimates() -> list[AnyArray]:
        run = plugin(context)
        suite = SensorSuite(config, _target(), _streams(), plugin.reads)
        found = []
        for k in range(12):
            held = (still, Command(np.zeros(3), np.zeros(3))) if k else ()
            found.append(run.update(suite.read(config.mission.step * k, chaser, body, *held)))
        return [array for estimate in found for array in (*estimate.chaser, *estimate.target)]

    with _unchanged([*chaser, *body], report, "the estimator"):
        first = estimates()
    for array in first:
        _finite(report, "an estimate", array, array.shape)
    _same(report, "the estimates", first, estimates())


def _check_approach_planner(plugin: ApproachPlanner, report: Report) -> None:
    """Check a planner: it must return a plan that a mission can fly, with its certificate, or a status without one."""
    query, easy, blocked = _query(), _still_query(-1.0), _still_query(1.0)
    with _unchanged([query.state, query.orientation, query.angular_velocity], report, "the planner"):
        plan, again = plugin(query), plugin(query)
    _same(report, "the plan", [plan.position, plan.velocity], [again.position, again.velocity])
    straight = plugin(easy)
    report.expect(
        straight.solved,
        "easy",
        f"there is no plan straight ahead to a target that hardly turns ({straight.report.message})",
        "solve a query whose straight path is free",
    )
    for asked, found in ((query, plan), (easy, straight), (blocked, plugin(blocked))):
        if found.solved:
            _expect_flyable(asked, found, report)
    inside = plugin(_query(np.array([0.01, 0.0, 0.0, 0.0, 0.0, 0.0])))
    report.expect(
        not inside.solved and isinstance(inside.status, PlanStatus),
        "status",
        "a start inside the target gives a plan that may be flown",
        "return a status that says why there is no plan",
    )


def _expect_flyable(query: PlanQuery, plan: Plan, report: Report) -> None:
    """Add a breach if a mission would reject a plan, because it does not match the query or comes too close."""
    mistake = plan_mistake(query, plan)
    report.expect(not mistake, "plan", mistake, "return another status than SOLVED, or a path that satisfies the query")
    if mistake or plan.path is None:
        return
    proof = certify(query, plan.path, plan.t_start - query.t0)
    report.expect(
        proof.certified,
        "certificate",
        f"the clearance is {proof.clearance:.3g} m beyond radius and margin {proof.time:.3g} s after the start",
        "keep `query.margin`; use `certify(query, path, wait)` to check a path",
    )


def _check_front_end(plugin: FrontEnd, report: Report) -> None:
    """Check a front end: edges between frames that it has received, the same for the same frames."""
    camera, T_BC = TimeOfFlightCamera(profile="clean"), pose(R_BC, np.array([0.13, 0.0, 0.0]))  # noqa: N806
    poses, renderer, streams = watched_poses(_target(), 4), camera(_target()), _streams()

    def edges() -> list[Edge]:
        run = plugin(FrontEndContext(camera.geometry, T_BC, _target(), streams))
        sensor, found = PoseSensorRun(PoseSensor(), streams), list[Edge]()
        for number, T_MB in enumerate(poses):  # noqa: N806
            T_MC = T_MB @ T_BC  # noqa: N806
            frame = renderer.render(T_MC[:3, :3], T_MC[:3, 3], streams, number, float(number))
            if plugin.reads == "poses":
                measured = sensor.measure(number, T_MB, in_view=True)
                frame = PoseFrame(**vars(frame), number=number, poses=measured)
            own = run.step(frame, None, np.eye(3))
            right = all(edge.first < edge.second <= number and edge.first >= MODEL for edge in own)
            report.expect(right, "frames", "an edge refers to a frame that does not exist", "count frames by calls")
            found += own
        return found

    first, second = edges(), edges()
    for edge in first:
        definite = edge.covariance.shape == (6, 6) and bool((np.linalg.eigvalsh(edge.covariance) > 0.0).all())
        report.expect(definite, "covariance", "a covariance is not positive definite", "state an error of all axes")
    same = len(first) == len(second) and all(np.array_equal(a.pose, b.pose) for a, b in zip(first, second, strict=True))
    report.expect(same, "repeatable", "the edges differ for the same input", "draw from the given streams alone")


def _check_tracker(plugin: Tracker, report: Report) -> None:
    """Check a tracker: a force within the limits, the same for the same sequence of estimates."""
    plan, limits = _plan(), TrackingLimits()
    query = BoundQuery(plan, _target().principal, EstimateErrors(0.005, 0.0005), 1.0, 0.5)
    bound = ConformalBound()(query, _streams())
    far = np.ones(len(plan.times))
    design = plugin.design(DesignRequest(plan, bound, far, Axis(query.mass), limits, 3e-3, 5))
    reference = TrackedReference(plan.position, plan.velocity)
    estimate = np.concatenate([plan.position[0] + 0.01, plan.velocity[0]])

    def forces() -> AnyArray:
        run = plugin(design)
        return np.array([run.step(estimate, reference, k).force for k in range(3)])

    with _unchanged([estimate, plan.position, plan.velocity], report, "the tracker"):
        found = forces()
    _finite(report, "the forces", found, (3, 3))
    largest = np.abs(found).max()
    report.expect(largest <= limits.force, "limits", f"it commands {largest} N", "clip the force at the limits")
    _same(report, "the forces", [found], [forces()])


_KINDS: dict[str, Callable[[Any, Report], None]] = {
    "approach_planner": _check_approach_planner,
    "front_end": _check_front_end,
    "state_estimator": _check_state_estimator,
    "target_model": _check_target_model,
    "tracker": _check_tracker,
}


def _check(plugin: Any, parts: SampleParts, report: Report) -> None:
    """Check a plugin of a rendezvous, whatever its kind; it refers to no parts of a deputy."""
    with report.attempt(f"the {plugin.kind.replace('_', ' ')}", "it must work for the sample target"):
        _KINDS[plugin.kind](plugin, report)


RENDEZVOUS_CHECKS: dict[str, Check] = dict.fromkeys(_KINDS, _check)


def _streams() -> Streams:
    return Streams(3, np.zeros(1, np.int64), np.zeros(1, np.int64))


@functools.cache
def _target() -> Target:
    return EnvisatTarget()()


def _bodies() -> tuple[BodyState, BodyState]:
    still, level, rate = np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), 0.05 * np.array([0.7, 0.5, 0.5])
    return BodyState(np.array([0.0, -1.5, 0.0]), still, level, still), BodyState(still, still, level, rate)


def watched_poses(target: Target, frames: int) -> list[FloatArray]:
    """Return the poses T_MB of a chaser at rest that observes a tumble, one per second, shape (4, 4) each."""
    start, rate = np.array([[0.1, -0.3, 0.5, 0.8]]) / np.sqrt(0.99), 0.09 * np.array([[0.7, 0.5, 0.5]])
    q, _ = tumble(target.principal, start, rate, np.arange(float(frames)))
    turned = to_matrix(q[0]) @ target.R_MT.T
    return [inverse(pose(rotation, np.zeros(3))) @ LOOKING for rotation in turned]


def _query(state: AnyArray | None = None) -> PlanQuery:
    chaser, body = _bodies()
    target = _target()
    return PlanQuery(
        t0=0.0,
        state=np.concatenate([chaser.position, chaser.velocity]) if state is None else state,
        orientation=body.orientation,
        angular_velocity=body.angular_velocity,
        inertia=target.principal,
        mating_point=target.mating_point,
        solid=target.solid,
        R_MT=target.R_MT,
    )


def _still_query(side: float) -> PlanQuery:
    """Return a query with a nearly still target; its mating point faces the chaser (side -1) or faces away (side 1)."""
    target = _target()
    ahead, facing = target.mating_point / np.linalg.norm(target.mating_point), np.array([0.0, side, 0.0])
    turn = np.append(np.cross(ahead, facing), 1.0 + ahead @ facing)
    return replace(
        _query(), orientation=turn / np.linalg.norm(turn), angular_velocity=np.array([0.0, 0.0, 1e-4]), t0=10.0
    )


@functools.cache
def _plan() -> Plan:
    return SplineSCPPlanner()(_query())


def _arrays(target: Target) -> list[AnyArray]:
    return [target.solid.vertices, target.mesh.vertices, target.inertia, target.mating_point]


def _finite(report: Report, what: str, array: Any, shape: tuple[int, ...]) -> None:
    right = isinstance(array, np.ndarray) and array.shape == shape and bool(np.isfinite(array).all())
    found = f"shape {array.shape}" if isinstance(array, np.ndarray) else type(array).__name__
    report.expect(right, "shape", f"{what}: {found}, or not finite", f"return finite floats of shape {shape}")


def _same(report: Report, what: str, first: Sequence[AnyArray], second: Sequence[AnyArray]) -> None:
    equal = all(one.tobytes() == other.tobytes() for one, other in zip(first, second, strict=True))
    remedy = "draw from `streams` alone, and remember nothing between calls"
    report.expect(equal, "repeat", f"{what} of two calls with the same inputs differ", remedy)


@contextmanager
def _unchanged(arrays: Sequence[AnyArray], report: Report, what: str) -> Iterator[None]:
    """Add a breach if an array changes within the block."""
    before = [array.tobytes() for array in arrays]
    yield
    kept = all(array.tobytes() == bytes_before for array, bytes_before in zip(arrays, before, strict=True))
    report.expect(kept, "read-only", f"{what} changes an array that it is given", WRITES)
