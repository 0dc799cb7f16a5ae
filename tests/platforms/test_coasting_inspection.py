"""What would be left after coasting: against the environment itself."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import BatchedEnvironment
from safe_inspect.platforms.outlook_sensors import CoastingInspectionSensor
from safe_inspect.tasks.inspection.points import InspectionPoints
from safe_inspect.tasks.inspection.rotation import ChiefRotation

TASK = configs_root() / "translational-inspection" / "experiment-burn-and-coast.yml"
STEPS = 400
PARTS = (50, 100, 200, 400)


def environment(num_envs, horizon=1224):
    env = BatchedEnvironment(load_experiment(TASK, [f"horizon={horizon}"]).spec, num_envs, seed=4)
    env.reset()
    return env


def read(env, **fields):
    found = CoastingInspectionSensor(**fields)(env.view())
    assert found.shape == (env.num_envs, 7)
    return found


def coasted(env, steps):
    """Return which points each environment has inspected after coasting, and whether its episode continues."""
    goes_on = np.ones(env.num_envs, dtype=np.bool_)
    for _ in range(steps):
        goes_on &= ~env.step(np.zeros((env.num_envs, 1, 4))).done[:, 0]
    return env.view().points("chief").inspected.copy(), goes_on


def test_what_is_left_is_what_the_environment_leaves():
    """Looks are up to 0.05 rad apart, so a point that is seen for less than that may be missed, and none added."""
    ahead = read(environment(40), duration=STEPS * 10.0)
    compared = 0
    for column, steps in enumerate(PARTS):
        inspected, goes_on = coasted(env := environment(40), steps)
        share = 1.0 - inspected.mean(axis=1)
        more = ahead[goes_on, column] - share[goes_on]
        assert more.min() > -1e-12
        assert more.mean() < 0.003
        if steps == STEPS:
            units = env.view().points("chief").model.points / 10.0
            exact = goes_on & (np.abs(ahead[:, column] - share) < 1e-9)
            for row in np.flatnonzero(exact):
                left = units[~inspected[row]]
                expected = left.mean(axis=0) if len(left) else np.zeros(3)
                np.testing.assert_allclose(ahead[row, 4:], expected, atol=1e-12)
                compared += 1
    assert compared > 10


def test_nothing_is_inspected_behind_the_horizon():
    near, far = read(environment(8), horizon=100, duration=4000.0), read(environment(8), duration=4000.0)
    np.testing.assert_array_equal(near[:, :2], far[:, :2])
    np.testing.assert_array_equal(near[:, 3], near[:, 1])
    assert (far[:, 3] < near[:, 3]).any()


def test_a_body_that_turns_is_refused():
    sensor = CoastingInspectionSensor()

    def turning(entity):
        return SimpleNamespace(compose=lambda: (None, (InspectionPoints(), ChiefRotation(entity_name=entity))))

    with pytest.raises(ValueError, match="a body that does not turn, but 'chief' turns"):
        sensor.in_task(turning("chief"), 300)
    assert sensor.in_task(turning("other"), 300).horizon == 300
