"""The time that the flight computer takes for a plan with its tube, and for a frame."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.errors import ConfigError
from safe_inspect.missions.mission import Mission
from safe_inspect.rendezvous.control.tracker import LinearFeedback
from safe_inspect.rendezvous.control.tube import Axis, TrackedReference
from safe_inspect.rendezvous.coordination.actions import _state_after
from safe_inspect.rendezvous.coordination.context import Following, Phase, PlanDemands
from safe_inspect.rendezvous.experiment import load_rendezvous

_TRUTH = configs_root() / "tumbling-rendezvous" / "experiment-truth.yml"
_ESTIMATED = configs_root() / "tumbling-rendezvous" / "experiment.yml"
_QUICK = ("mission.observe=1 s", "mission.checkout=0.4 s")
_AXIS = Axis(9.6, 0.2)
_CENTRE = np.array([0.3, -0.2, 0.1])


def _context(state: np.ndarray, following: Any, tide: np.ndarray | None = None) -> Any:
    estimate = SimpleNamespace(
        translation=state,
        target=SimpleNamespace(position=_CENTRE),
        relative=np.concatenate([state[:3] - _CENTRE, state[3:]]),
    )
    config = SimpleNamespace(tracker=lambda design: LinearFeedback.of_lqr(_AXIS))
    return SimpleNamespace(estimate=estimate, following=following, axis=_AXIS, step=7, config=config, tide=tide)


def _reference(steps: int, tide: np.ndarray | None) -> TrackedReference:
    """Return a path with a constant acceleration."""
    times, acceleration = _AXIS.step * np.arange(steps)[:, None], np.array([0.004, -0.002, 0.003])
    shape = np.zeros((steps, 3))
    return TrackedReference(0.5 * acceleration * times**2, acceleration * times, None if tide is None else shape + tide)


@pytest.mark.parametrize("tide", [None, np.array([2e-3, -1e-3, 5e-4])])
def test_planning_starts_from_where_the_tracker_will_have_taken_the_chaser(tide: np.ndarray | None) -> None:
    reference, tracker = _reference(60, tide), LinearFeedback.of_lqr(_AXIS)
    nothing: Any = None
    following = Following(nothing, nothing, nothing, reference, 4, tracker)
    k, steps, error = 3, 10, np.array([[0.01, -0.004, 0.002], [0.001, 0.0, -0.002]])
    state = np.concatenate([reference.position[k], reference.velocity[k]])
    found = _state_after(_context(state + error.ravel(), following, tide), steps)
    after = np.linalg.matrix_power(_AXIS.closed_loop(tracker.tube.gain_at(0)), steps) @ error
    expected = np.stack([reference.position[k + steps] - _CENTRE, reference.velocity[k + steps]]) + after
    np.testing.assert_allclose(found, expected.ravel(), atol=1e-12)


def test_planning_starts_from_the_held_position_without_a_reference() -> None:
    state = np.array([0.0, -1.5, 0.0, 1e-4, 0.0, -1e-4])
    np.testing.assert_array_equal(_state_after(_context(state, None), 10), _context(state, None).estimate.relative)


@pytest.mark.parametrize("seconds", [0.0, 3.0])
def test_a_plan_is_flown_when_its_planning_time_is_over(seconds: float) -> None:
    options = [f"mission.planning_time={seconds} s", "mission.wait_limit=6 s", "mission.time_limit=15 s"]
    config = load_rendezvous(_TRUTH, [*_QUICK, *options]).config
    events = Mission(config).run().log.events
    plans = [event for event in events if event["event"] == "plan"]
    changes = {event["data"]["to"]: event["t"] for event in events if event["event"] == "transition"}
    assert plans[0]["data"]["t_start"] >= plans[0]["t"] + seconds - 1e-9
    # The last plan is made one planning time before the start, for the start.
    assert plans[-1]["data"]["t_start"] == pytest.approx(plans[-1]["t"] + seconds)
    assert changes["TRACK"] == pytest.approx(plans[-1]["data"]["t_start"])


def test_a_margin_that_no_plan_can_keep_is_forgotten() -> None:
    mission = Mission(load_rendezvous(_TRUTH, _QUICK).config)
    plans: list[Any] = []
    for readings, _, _ in mission.steps():
        if readings.time == 0.0:
            continue  # the pilot has not acted yet
        context = mission.pilot.context
        if context.phase is Phase.OBSERVE:
            context.demands = PlanDemands(margin=lambda times: np.full(np.shape(times), 2.0))
        if context.plan is not None and context.plan not in plans:
            plans.append(context.plan)
        if len(plans) == 2:
            break
    assert [plan.status.value for plan in plans] == ["start infeasible", "solved"]


@pytest.mark.parametrize("attempts", [1, 3])
def test_the_target_is_observed_as_often_as_attempts_allow(attempts: int) -> None:
    faults = "mission.faults=[{kind: planner, start: 0 s, duration: 900 s}]"
    config = load_rendezvous(_TRUTH, [*_QUICK, faults, f"mission.attempts={attempts}"]).config
    result = Mission(config).run()
    states = [event["data"]["to"] for event in result.log.events if event["event"] == "transition"]
    assert states.count("OBSERVE") == attempts
    assert states[-1] == "ABORTED"


def test_a_planning_time_between_two_control_steps_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"planning_time: 0.3 s is not a multiple of the control step, 0.2 s"):
        load_rendezvous(_TRUTH, ["mission.planning_time=0.3 s"])


def test_the_poses_of_a_frame_are_known_a_control_step_later() -> None:
    options = [*_QUICK, "estimator.config.front_end=MeasuredPoses", "mission.time_limit=4 s"]
    mission = Mission(load_rendezvous(_ESTIMATED, options).config)
    known = []
    for readings, _, _ in mission.steps():
        if known:
            known[-1] = (*known[-1], mission.pilot.context.estimate.updated)
        known.append((readings.time, readings.frame is not None))
    frames = [index for index, (_, has_frame, *_) in enumerate(known[:-2]) if has_frame and index]
    assert len(frames) == 4
    for index in frames:
        assert known[index][2] < known[index][0] - 0.5
        assert known[index + 1][2] == pytest.approx(known[index][0])
