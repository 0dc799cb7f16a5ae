"""Each way in which a plugin of a rendezvous can break its contract, with the exact words of the report."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from safe_inspect.rendezvous.planner.query import PlanStatus
from safe_inspect.rendezvous.plugins import (
    ApproachPlanner,
    EnvisatTarget,
    FrontEnd,
    LQRTracker,
    MeasuredPoses,
    MeasuredState,
    SplineSCPPlanner,
    StateEstimator,
    TargetModel,
    Tracker,
)
from safe_inspect.testing import check_plugin

from .given import Calls
from .making import made
from .reports import assert_recorded, breaches

pytestmark = pytest.mark.usefixtures("clean_registry")

TURN = np.array([0.0, 0.0, 0.0, 1.0])


def target(change: Callable[[Any], Any]) -> type:
    """Return a target model that changes Envisat."""
    return made(TargetModel, __call__=lambda self: change(EnvisatTarget()()))


def run_of(plugin: Any, method: str, change: Callable[..., Any]) -> Callable[..., Any]:
    """Return the call of a plugin whose run changes what a shipped plugin's run gives."""

    def call(self: Any, context: Any) -> Any:
        run = plugin(context)
        return SimpleNamespace(**{method: lambda *given: change(getattr(run, method)(*given), *given)})

    return call


def estimator(change: Callable[..., Any]) -> type:
    """Return an estimator that changes what is measured."""
    return made(
        StateEstimator, reads=property(lambda self: ("state",)), __call__=run_of(MeasuredState(), "update", change)
    )


def front_end(change: Callable[..., Any]) -> type:
    """Return a front end that changes the measured edges."""
    return made(FrontEnd, reads="poses", __call__=run_of(MeasuredPoses(), "step", change))


def tracker(change: Callable[..., Any]) -> type:
    """Return a tracker that changes the force of the linear-quadratic regulator."""
    return made(
        Tracker, design=lambda self, request: LQRTracker().design(request),
        __call__=run_of(LQRTracker(), "step", change),
    )  # fmt: skip


@functools.cache
def _solved(key: bytes, least: float) -> Any:
    query = _queries[key]
    return SplineSCPPlanner()(query if least else replace(query, margin=lambda times: np.full(len(times), -0.08)))


_queries: dict[bytes, Any] = {}


def planner(change: Callable[..., Any], least: float = 1.0) -> type:
    """Return a planner that changes the shipped one's plans."""

    def call(self: Any, query: Any) -> Any:
        key = np.concatenate([query.state, query.orientation, query.angular_velocity, [query.t0]]).tobytes()
        _queries[key] = query
        return change(_solved(key, least), query)

    return made(ApproachPlanner, __call__=call)


def counted(change: Callable[..., Any]) -> Callable[..., Any]:
    """Return a change that is also given the number of the call."""
    count = itertools.count(1)
    return lambda *given: change(next(count), *given)


def _write(array: Any) -> None:
    array += 1e-3


def _box_at_mating_point(body: Any) -> Any:
    centre = body.boxes.centre.copy()
    centre[0] = body.R_MT @ body.mating_point
    return replace(body, boxes=replace(body.boxes, centre=centre))


def _with_force(output: Any, force: Any) -> Any:
    return replace(output, force=force)


REFUSED = {
    "mating point in a box": lambda: target(_box_at_mating_point),
    "mating point in a plane": lambda: target(lambda body: replace(body, mating_point=body.mating_point[:2])),
    "mesh without an end": lambda: target(
        lambda body: replace(body, mesh=replace(body.mesh, vertices=np.inf * np.ones_like(body.mesh.vertices)))
    ),
    "target that grows": lambda: target(
        counted(lambda call, body: replace(body, mating_point=body.mating_point * (1.0 + 0.01 * call)))
    ),
    "target that fails": lambda: target(lambda body: body.no_such_name),
    "estimate without an end": lambda: estimator(
        lambda estimate, readings: replace(estimate, chaser=estimate.chaser._replace(velocity=np.full(3, np.inf)))
    ),
    "estimate of the target as a number": lambda: estimator(
        lambda estimate, readings: replace(estimate, target=estimate.target._replace(position=0.0))
    ),
    "estimate that drifts": lambda: estimator(
        counted(
            lambda call, estimate, readings: replace(
                estimate, target=estimate.target._replace(orientation=estimate.target.orientation + 1e-6 * call)
            )
        )
    ),
    "edge from a later frame": lambda: front_end(
        lambda edges, *given: [replace(edge, first=edge.second) for edge in edges]
    ),
    "edge to a frame that is not there": lambda: front_end(
        lambda edges, *given: [replace(edge, second=edge.second + 1) for edge in edges]
    ),
    "edge from before the model": lambda: front_end(lambda edges, *given: [replace(edge, first=-2) for edge in edges]),
    "certain edge": lambda: front_end(
        lambda edges, *given: [replace(edge, covariance=np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 0.0])) for edge in edges]
    ),
    "edge that drifts": lambda: front_end(
        counted(lambda call, edges, *given: [replace(edge, pose=edge.pose + 1e-6 * call) for edge in edges])
    ),
    "edge that is lost": lambda: front_end(counted(lambda call, edges, *given: edges if call < 5 else [])),
    "force beyond the limits": lambda: tracker(lambda output, *given: _with_force(output, output.force - 0.5)),
    "force of two numbers": lambda: tracker(lambda output, *given: _with_force(output, output.force[:2])),
    "force that drifts": lambda: tracker(
        counted(lambda call, output, *given: _with_force(output, 0.9 * output.force + 1e-4 * call))
    ),
    "estimate that is written to": lambda: tracker(lambda output, estimate, *given: (_write(estimate), output)[1]),
    "planner that gives up": lambda: planner(
        lambda plan, query: replace(plan, status=PlanStatus.NOT_CONVERGED, path=None)
    ),
    "planner without a path": lambda: planner(lambda plan, query: replace(plan, path=None)),
    "planner of another start": lambda: planner(lambda plan, query: replace(plan, position=plan.position + 0.1)),
    "planner that drifts": lambda: planner(
        counted(lambda call, plan, query: replace(plan, velocity=plan.velocity + 1e-9 * call))
    ),
    "planner that writes": lambda: planner(lambda plan, query: (_write(query.state), plan)[1]),
    "planner without a status": lambda: planner(
        lambda plan, query: plan if plan.solved else replace(plan, status="none")
    ),
    "planner that comes too close": lambda: planner(lambda plan, query: plan, 0.0),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_plugin_of_a_rendezvous_is_refused_in_exact_words(name: str) -> None:
    assert breaches(REFUSED[name]())


def _noting(calls: Calls, plugin: Any, *methods: str) -> Callable[..., Any]:
    """Return the call of a plugin that notes what it and its run are given."""

    def call(self: Any, *given: Any) -> Any:
        calls.note("", *given)
        run = plugin(*given)

        def method(name: str) -> Callable[..., Any]:
            return lambda *inputs: (calls.note(name, *inputs), getattr(run, name)(*inputs))[1]

        return SimpleNamespace(**{name: method(name) for name in methods}) if methods else run

    return call


KINDS = {
    "estimator": lambda calls: made(
        StateEstimator, reads=property(lambda self: ("state", "inertial")),
        __call__=_noting(calls, MeasuredState(), "update"),
    ),
    "front end": lambda calls: made(FrontEnd, reads="poses", __call__=_noting(calls, MeasuredPoses(), "step")),
    "front end of frames": lambda calls: made(
        FrontEnd, __call__=_noting(calls, lambda context: SimpleNamespace(step=lambda *given: []), "step")
    ),
    "tracker": lambda calls: made(
        Tracker, design=calls.spied(lambda request: LQRTracker().design(request), "design"),
        __call__=_noting(calls, LQRTracker(), "step"),
    ),
    "planner": lambda calls: made(ApproachPlanner, __call__=_noting(calls, SplineSCPPlanner())),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_a_plugin_of_a_rendezvous_is_called_with_what_is_on_record(kind: str) -> None:
    calls = Calls()
    check_plugin(KINDS[kind](calls))
    assert_recorded(calls.text())
