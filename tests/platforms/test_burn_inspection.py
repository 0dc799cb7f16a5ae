"""What a burn would add to the points that coasting inspects: against the sensor of coasting, with the burn flown."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import BatchedEnvironment
from safe_inspect.platforms import BurnInspectionSensor, CoastingInspectionSensor

TASK = configs_root() / "translational-inspection" / "experiment-burn-and-coast.yml"
DIRECTIONS = np.concatenate([[sign * axis for sign in (1.0, -1.0)] for axis in np.eye(3)])


@pytest.fixture(name="env")
def make_env():
    env = BatchedEnvironment(load_experiment(TASK).spec, 30, seed=4)
    env.reset()
    for _ in range(60):
        env.step(np.zeros((30, 1, 4)))
    return env


def left_after(env, change):
    """Return the shares that coasting leaves [-] once the velocity has changed by so much [m/s], shape (N,)."""
    state = env.view().writable
    before = state.velocity.copy()
    state.velocity += change
    left = CoastingInspectionSensor()(env.view())[:, 3]
    state.velocity[:] = before
    return left


@pytest.mark.parametrize("horizon", [1224, 100])
def test_a_burn_adds_what_coasting_leaves_less(env, horizon, monkeypatch):
    monkeypatch.setattr(CoastingInspectionSensor, "looks_every", BurnInspectionSensor.looks_every)
    sensor = BurnInspectionSensor(delta_v=(0.02, 0.06), horizon=horizon)
    found = sensor(env.view())
    assert found.shape == (30, 12)
    if horizon == 100:
        assert np.abs(found).max() < np.abs(BurnInspectionSensor()(env.view())).max()
        return
    without = left_after(env, 0.0)
    expected = [without - left_after(env, size * axis) for size in (0.02, 0.06) for axis in DIRECTIONS]
    np.testing.assert_allclose(found, np.stack(expected, axis=1), atol=1e-12)
    assert (found > 0.05).any()
    assert (found < -0.05).any()


def test_elements_name_the_burns():
    assert BurnInspectionSensor(delta_v=(0.05,)).element_names == tuple(
        f"{sign}{axis}_0.05" for axis in "xyz" for sign in "+-"
    )
    assert BurnInspectionSensor(delta_v=("5 cm/s",)).delta_v == (0.05,)
