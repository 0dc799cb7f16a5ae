"""Bounded disturbances of the motion, the thrust and the estimates."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import TeamEnvironment
from safe_inspect.errors import ConfigError
from safe_inspect.tasks.bounded_disturbance import BoundedDisturbance

SIMULATOR = "config.config.env_config.simulator.config.disturbance"
BOUNDS = {
    "velocity": 1e-3, "position_error": 0.1, "velocity_error": 2e-3, "thrust_gain": 0.05, "thrust_direction": 0.1
}  # fmt: skip


def environment(num_envs=32, task="translational-inspection", **kwargs):
    first, overrides = kwargs.pop("first_slot", 0), kwargs.pop("overrides", ())
    value = {"functor": "BoundedDisturbance", "config": kwargs} if kwargs else None
    given = [*overrides, *([f"{SIMULATOR}={value}"] if value else [])]
    spec = load_experiment(configs_root() / task / "experiment.yml", given).spec
    env = TeamEnvironment(spec, num_envs, seed=5, first_slot=first)
    env.reset()
    return env


def fly(env, steps=3, choice=(2.0, 0.0, 1.0)):
    """Fly thrusts of -1, 0 and 1 N, by the index of the choice, along the axes; return the state."""
    action = [np.tile(choice, (env.num_envs, group.size, 1)) for group in env.acting]
    for _ in range(steps):
        env.step(action)
    return env.state


def lengths(x):
    return np.sqrt((x**2).sum(axis=-1))


@pytest.mark.parametrize("distribution", ["uniform", "extreme"])
def test_velocities_and_estimates_stay_within_their_bounds_and_reach_them(distribution):
    exact, disturbed = environment(1024), environment(1024, **BOUNDS | {"thrust_gain": 0.0, "thrust_direction": 0.0},
                                                      distribution=distribution)  # fmt: skip
    added = lengths(fly(disturbed, 1).velocity[:, 0] - fly(exact, 1).velocity[:, 0])
    state = disturbed.state
    errors = {
        "velocity": added,
        "position_error": lengths(state.arrays["estimated_position"][:, 0] - state.position[:, 0]),
        "velocity_error": lengths(state.arrays["estimated_velocity"][:, 0] - state.velocity[:, 0]),
    }
    for name, error in errors.items():
        share = error / BOUNDS[name]
        assert share.max() < 1.0 + 1e-9
        if distribution == "extreme":
            assert share.min() > 1.0 - 1e-9
        else:  # uniform in a ball: the median of the cube of the radius is one half
            assert abs((share**3).mean() - 0.5) < 0.05


def test_thrust_errors_are_those_of_gain_and_direction():
    exact, disturbed = environment(512), environment(512, thrust_gain=0.05, thrust_direction=0.1)
    coast = environment(512)
    fly(coast, 1, (1.0, 1.0, 1.0))
    for env in (exact, disturbed):
        fly(env, 1)
    wanted = exact.state.velocity[:, 0] - coast.state.velocity[:, 0]
    flown = disturbed.state.velocity[:, 0] - coast.state.velocity[:, 0]
    gain = lengths(flown) / lengths(wanted)
    angle = np.arccos((wanted * flown).sum(axis=1) / (lengths(wanted) * lengths(flown)))
    assert 0.95 - 2e-3 < gain.min() < 0.955
    assert 1.045 < gain.max() < 1.05 + 2e-3
    assert 0.095 < angle.max() < 0.1 + 2e-3
    bound = BoundedDisturbance(thrust_gain=0.05, thrust_direction=0.1).thrust_error
    assert 0.9 * bound < (lengths(flown - wanted) / lengths(wanted)).max() < bound + 2e-3
    assert np.array_equal(disturbed.state.control, exact.state.control)


def test_the_thrust_error_bound_is_that_of_the_worst_thrust():
    bounds = BoundedDisturbance(thrust_gain=0.2, thrust_direction=0.3)
    g, a = np.meshgrid(np.linspace(0.8, 1.2, 201), np.linspace(0.0, 0.3, 201))
    worst = np.sqrt((g * np.cos(a) - 1.0) ** 2 + (g * np.sin(a)) ** 2).max()
    assert worst <= bounds.thrust_error < worst + 1e-12


def test_a_row_of_a_batch_is_disturbed_as_it_is_alone():
    batch, alone = environment(8, **BOUNDS), environment(1, **BOUNDS, first_slot=5)
    for env in (batch, alone):
        fly(env, 4)
    for name in ("position", "velocity", "estimated_position", "estimated_velocity"):
        assert np.array_equal(batch.state.arrays[name][5], alone.state.arrays[name][0])


def test_deputies_and_steps_are_disturbed_differently():
    env = environment(2, "multiagent-translational-inspection", overrides=("rta.config.enabled=False",), **BOUNDS)
    seen = []
    for _ in range(3):
        fly(env, 1)
        seen.append((env.state.arrays["estimated_position"] - env.state.position[:, :3]).reshape(-1, 3))
    errors = np.concatenate(seen)
    assert len(np.unique(errors[:, 0])) == len(errors)


def test_sensors_read_the_estimates_and_done_functions_the_truth():
    env = environment(16, position_error=5.0)
    fly(env, 1)
    view = env.view()
    read = view.reading(next(name for name in env.groups[0].agent.sensors if "Position" in name))
    assert np.array_equal(read, view.estimated_position)
    assert not np.array_equal(read, view.position)
    assert np.allclose(view.range_to(None), lengths(view.position))


def test_without_a_disturbance_nothing_is_added():
    env = environment(2)
    assert env.spec.simulator.disturbance == ()
    assert "estimated_position" not in env.state.arrays


def test_a_wrong_bound_is_refused_where_it_stands():
    with pytest.raises(ConfigError, match=r"disturbance\.config\.velocity: expected a number of 0 or more"):
        environment(1, velocity=-1e-3)
    with pytest.raises(ConfigError, match="thrust_gain"):
        environment(1, thrust_gain=1.5)
