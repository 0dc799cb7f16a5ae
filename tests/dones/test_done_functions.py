"""Done functions that the episode by hand does not cover: their settings and statuses."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.dones import DoneStatus
from safe_inspect.dones.limits import EpisodeLengthDone
from safe_inspect.dones.motion import CrashDoneFunction, MaxDistanceDoneFunction
from safe_inspect.dones.success import SuccessfulInspectionDoneFunction
from safe_inspect.environments import BatchedEnvironment

STILL = np.zeros((1, 1, 3))


@pytest.fixture
def step(fixed_start):
    """Return the first step of an episode from 60 m, the sun behind."""
    env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0)))
    env.reset()
    return env.step(STILL).step


@pytest.mark.parametrize(("limit", "over"), [(59.9, True), (61.0, False), ("61 m", False), ("0.0599 km", True)])
def test_the_range_limit(step, limit, over):
    assert MaxDistanceDoneFunction(max_distance=limit)(step).tolist() == [over]


@pytest.mark.parametrize(("radius", "crashed"), [(59.9, False), (61.0, True)])
def test_the_crash_region(step, radius, crashed):
    assert CrashDoneFunction(crash_region_radius=radius)(step).tolist() == [crashed]


def test_limits_themselves_are_inside(step):
    distance = float(step.after.range_to(None)[0])
    assert not MaxDistanceDoneFunction(max_distance=distance)(step)[0]
    assert not CrashDoneFunction(crash_region_radius=distance)(step)[0]


def test_success_at_a_summed_weight(step):
    points = step.after.points("chief")
    weight = points.inspected.sum() / 100.0  # all weigh the same
    assert SuccessfulInspectionDoneFunction(weight_threshold=weight - 1e-9)(step)[0]
    assert not SuccessfulInspectionDoneFunction(weight_threshold=weight + 1e-9)(step)[0]
    assert not SuccessfulInspectionDoneFunction()(step)[0]


def test_weights_of_a_priority_count(shipped):
    from safe_inspect.config.experiment import load_experiment

    env = BatchedEnvironment(load_experiment(shipped).spec, 3, seed=1)
    env.reset()
    step = env.step(np.zeros((3, 1, 3))).step
    points = step.after.points("chief")
    rows = zip(points.weights, points.inspected, strict=True)
    by_hand = [sum(weight for weight, seen in zip(*row, strict=True) if seen) for row in rows]
    np.testing.assert_allclose(points.inspected_weight, by_hand)
    middle = sorted(by_hand)[1]
    done = SuccessfulInspectionDoneFunction(weight_threshold=middle - 1e-9)(step)
    assert done.tolist() == [weight >= middle for weight in by_hand]


@pytest.mark.parametrize("horizon", [1, 2])
def test_the_time_limit(step, horizon):
    assert EpisodeLengthDone(horizon=horizon)(step).tolist() == [horizon == 1]


def test_statuses():
    assert MaxDistanceDoneFunction.status is CrashDoneFunction.status is DoneStatus.LOSE
    assert SuccessfulInspectionDoneFunction.status is DoneStatus.WIN
    assert EpisodeLengthDone.status is DoneStatus.DRAW
    assert EpisodeLengthDone.truncates
    assert not any(
        done.truncates for done in (MaxDistanceDoneFunction, CrashDoneFunction, SuccessfulInspectionDoneFunction)
    )


@pytest.mark.parametrize(
    ("done", "field", "value"),
    [
        (MaxDistanceDoneFunction, "max_distance", 0.0),
        (CrashDoneFunction, "crash_region_radius", -1.0),
        (SuccessfulInspectionDoneFunction, "weight_threshold", 1.1),
        (EpisodeLengthDone, "horizon", 0),
    ],
)
def test_impossible_limits_are_refused(done, field, value):
    with pytest.raises(ValueError, match=field):
        done(**{field: value})
