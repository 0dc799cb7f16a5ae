"""Thrusters that round, err, fail and use propellant, and the pressure of sunlight, against plain NumPy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.dynamics import MotionLimits
from safe_inspect.environments import TeamEnvironment
from safe_inspect.errors import ArgumentError, ConfigError, InitialStateError
from safe_inspect.tasks.solar_pressure import SolarPressure
from safe_inspect.tasks.thruster_model import ThrusterModel

SIMULATOR = "config.config.env_config.simulator.config"
STEP, MASS, ISP = 10.0, 12.0, 220.0


def environment(num_envs, *overrides, first_slot=0, task="translational-inspection"):
    spec = load_experiment(configs_root() / task / "experiment.yml", list(overrides)).spec
    env = TeamEnvironment(spec, num_envs, seed=5, first_slot=first_slot)
    env.reset()
    return env


def with_thrusters(num_envs, first_slot=0, **fields):
    return environment(
        num_envs, f"{SIMULATOR}.disturbance={{functor: ThrusterModel, config: {fields}}}", first_slot=first_slot
    )


def flown(env, thrust, steps=1):
    """Return the applied control (steps, N, 3) [N] for a commanded thrust."""
    found = []
    for _ in range(steps):
        env.simulation.step(np.broadcast_to(np.asarray(thrust, dtype=float), (env.num_envs, 1, 3)).copy())
        found.append(env.simulation.flown[:, 0].copy())
    return np.array(found)


@pytest.mark.parametrize(
    ("fields", "wanted"),
    [
        # impulses of 10, -3.4 and 0.4 N s
        ({"impulse_resolution": 1.0}, [10.0, -3.0, 0.0]),
        ({"impulse_resolution": "4 N s"}, [12.0, -4.0, 0.0]),
        ({"minimum_impulse": 0.5}, [10.0, -3.4, 0.5]),
        ({"minimum_impulse": 1.0}, [10.0, -3.4, 0.0]),
        ({"minimum_impulse": 5.0}, [10.0, -5.0, 0.0]),
        ({"minimum_impulse": 5.0, "impulse_resolution": 3.0}, [9.0, -5.0, 0.0]),
        ({"minimum_impulse": "100 mN s"}, [10.0, -3.4, 0.4]),
    ],
)
def test_impulses_are_rounded_to_possible_pulses(fields, wanted):
    env = with_thrusters(2, **fields)
    np.testing.assert_allclose(flown(env, [1.0, -0.34, 0.04])[0] * STEP, np.tile(wanted, (2, 1)), atol=1e-12)
    np.testing.assert_array_equal(env.state.control[:, 0], np.tile([1.0, -0.34, 0.04], (2, 1)))


def test_each_thruster_has_its_gain_and_direction_for_an_episode():
    env = with_thrusters(4096, gain_error=0.1, misalignment="5 deg")
    right, again, left = flown(env, [1.0, 0.0, 0.0], 2)[0], flown(env, [0.5, 0.0, 0.0])[0], flown(env, [-1.0, 0, 0])[0]
    np.testing.assert_allclose(again, 0.5 * right, rtol=1e-12)
    gain = np.linalg.norm(right, axis=1)
    angle = np.arctan2(np.hypot(right[:, 1], right[:, 2]), right[:, 0])
    around = np.arctan2(right[:, 2], right[:, 1])
    for share, low, high in ((gain, 0.9, 1.1), (angle, 0.0, math.radians(5.0)), (around, -math.pi, math.pi)):
        assert low <= share.min() < low + 0.01 * (high - low)
        assert high - 0.01 * (high - low) < share.max() <= high
        assert abs(((share - low) / (high - low)).mean() - 0.5) < 0.03, "uniform"
    assert np.all(left[:, 0] < -0.89)
    assert abs(np.corrcoef(gain, np.linalg.norm(left, axis=1))[0, 1]) < 0.06, "thrusters err independently"
    both, up = flown(env, [1.0, 0.0, 1.0])[0], flown(env, [0.0, 0.0, 1.0])[0]
    np.testing.assert_allclose(both, right + up, atol=1e-12)


def test_one_of_six_fails_with_the_stated_probability_at_a_uniform_time():
    env = with_thrusters(3000, failure_probability=0.6, failure_time=100.0)
    outward, inward = [], []
    for _ in range(12):
        outward.append((flown(env, [1.0, 1.0, 1.0])[0] == 0.0).copy())
        inward.append(flown(env, [0.0, 0.0, 0.0])[0])
    dead = np.array(outward)  # (12, N, 3): the six thrusters are equally likely, three of them fire here
    assert not np.any(np.array(inward))
    assert np.all(dead.sum(axis=2) <= 1), "only one fails"
    assert np.all(dead[1:] | ~dead[:-1]), "and it does not recover"
    assert abs(dead[-1].mean() - 0.6 / 6.0) < 0.012
    count = dead.sum(axis=(1, 2)) / dead[-1].sum()  # a step of thrust and one without take 20 s
    np.testing.assert_allclose(count[:6], np.minimum(np.arange(6) * 20.0 / 100.0, 1.0), atol=0.06)
    certain = with_thrusters(600, failure_probability=1.0)
    six = np.concatenate((flown(certain, [1.0] * 3)[0] == 0.0, flown(certain, [-1.0] * 3)[0] == 0.0), axis=1)
    assert np.all(six.sum(axis=1) == 1)
    assert six.mean(axis=0).min() > 0.11


def test_the_mass_falls_with_the_propellant_until_none_is_left():
    env = with_thrusters(1, propellant=0.02, specific_impulse=ISP, gain_error=0.0)
    left, commanded = 0.02, np.array([1.0, -0.5, 0.25])
    for _ in range(4):
        used = min(np.abs(commanded).sum() * STEP / (ISP * 9.80665), left)
        share = used / (np.abs(commanded).sum() * STEP / (ISP * 9.80665))
        expected = share * commanded * MASS / (MASS - 0.02 + left)
        np.testing.assert_allclose(flown(env, commanded)[0, 0], expected, rtol=1e-13)
        left -= used
        assert env.state["propellant"][0, 0] == pytest.approx(left, abs=1e-15)
    assert left == 0.0
    assert not flown(env, commanded).any()
    env.reset()
    assert env.state["propellant"][0, 0] == 0.02


def test_the_thrust_accelerates_the_remaining_mass():
    """Tsiolkovsky: the speed gained in free space is the exhaust speed times the logarithm of the mass ratio."""
    env = environment(
        1, f"{SIMULATOR}.disturbance={{functor: ThrusterModel, config: {{propellant: 3 kg, specific_impulse: 60 s}}}}"
    )
    spent = 0.0
    for _ in range(300):
        spent += flown(env, [1.0, 0.0, 0.0])[0, 0, 0] * STEP / MASS
    used = 300 * STEP / (60.0 * 9.80665)
    assert not used > 3.0 or env.state["propellant"][0, 0] == 0.0
    wanted = 60.0 * 9.80665 * math.log(MASS / (MASS - min(used, 3.0)))
    assert spent == pytest.approx(wanted, rel=2e-3)


def test_a_row_of_a_batch_equals_the_row_alone_and_deputies_differ():
    fields = {
        "gain_error": 0.1, "misalignment": 0.1, "failure_probability": 0.5, "failure_time": 50.0, "propellant": 0.1
    }  # fmt: skip
    batch, alone = with_thrusters(8, **fields), with_thrusters(1, first_slot=5, **fields)
    np.testing.assert_array_equal(flown(batch, [0.3, -0.2, 0.1], 8)[:, 5], flown(alone, [0.3, -0.2, 0.1], 8)[:, 0])
    gains = f"{SIMULATOR}.disturbance={{functor: ThrusterModel, config: {{gain_error: 0.1}}}}"
    team = environment(4, "rta.config.enabled=False", gains, task="multiagent-translational-inspection")
    team.simulation.step(np.ones((4, 3, 3)))
    assert len(np.unique(team.simulation.flown)) == 36


@settings(max_examples=60, deadline=None)
@given(
    minimum=st.floats(0.0, 2.0), resolution=st.just(0.0) | st.floats(1e-6, 2.0), gain=st.floats(0.0, 0.3),
    tilt=st.floats(0.0, 0.1), seed=st.integers(0, 2**16),
)  # fmt: skip
def test_the_bounds_contain_what_is_flown(minimum, resolution, gain, tilt, seed):
    plugin = ThrusterModel(
        minimum_impulse=minimum, impulse_resolution=resolution, gain_error=gain, misalignment=tilt
    )  # fmt: skip
    bounds = plugin.disturbance_bounds(MotionLimits(STEP, MASS, 1.0))
    env = _ENV.setdefault("env", environment(64))
    running = plugin(env.simulation.world, 64)
    state = env.state.take(np.arange(64))
    thrust = np.random.default_rng(seed).uniform(-1.0, 1.0, (64, 1, 3))
    apart = np.linalg.norm(running.actuate(state, thrust) - thrust, axis=2)
    allowed = bounds.thrust_error * np.linalg.norm(thrust, axis=2) + bounds.velocity * MASS / STEP
    assert np.all(apart <= allowed + 1e-12)


_ENV: dict[str, TeamEnvironment] = {}


def test_bounds_are_those_of_each_error():
    limits = MotionLimits(STEP, MASS, 1.0)
    assert ThrusterModel(minimum_impulse=0.3).disturbance_bounds(limits).velocity == pytest.approx(
        math.sqrt(3.0) * 0.15 / MASS
    )
    mixed = ThrusterModel(minimum_impulse=0.3, impulse_resolution=0.1).disturbance_bounds(limits)
    assert mixed.velocity == pytest.approx(math.sqrt(3.0) * 0.2 / MASS)
    only = ThrusterModel(minimum_impulse=0.1, impulse_resolution=0.3).disturbance_bounds(limits)
    assert only.velocity == pytest.approx(math.sqrt(3.0) * 0.15 / MASS)
    assert ThrusterModel(gain_error=0.1).disturbance_bounds(limits).thrust_direction == pytest.approx(math.asin(0.1))
    for plugin in (ThrusterModel(failure_probability=0.1), ThrusterModel(propellant=1.0)):
        with pytest.raises(ValueError, match="no bound"):
            plugin.disturbance_bounds(limits)
    with pytest.raises(ValueError, match="may exceed the thrust"):
        ThrusterModel(gain_error=0.8, misalignment=0.1).disturbance_bounds(limits)


def test_wrong_fields_are_refused_with_their_place():
    with pytest.raises(ConfigError, match=r"disturbance\.config\.minimum_impulse: expected a number of 0 or more"):
        with_thrusters(1, minimum_impulse=-1.0)
    with pytest.raises(ConfigError, match=r"disturbance\.config\.minimum_impulse: 'kg' is not a unit of impulse"):
        with_thrusters(1, minimum_impulse="1 kg")
    with pytest.raises(ValueError, match="`propellant` is 12 kg, which must be less than the deputy's mass of 12 kg"):
        with_thrusters(1, propellant=12.0)
    listed = "[{functor: BoundedDisturbance}, {functor: ThrusterModel, config: {gain_error: 2.0}}]"
    with pytest.raises(ConfigError, match=r"disturbance\[1\]\.config\.gain_error"):
        environment(1, f"{SIMULATOR}.disturbance={listed}")


def test_several_disturbances_act_together():
    bounded = "{functor: BoundedDisturbance, config: {velocity: 1e-3, distribution: extreme}}"
    listed = f"[{bounded}, {{functor: ThrusterModel, config: {{impulse_resolution: 4}}}}]"
    env, plain = environment(16, f"{SIMULATOR}.disturbance={listed}"), environment(16)
    assert [plugin.registered_name for plugin in env.spec.simulator.disturbance] == [
        "BoundedDisturbance",
        "ThrusterModel",
    ]
    np.testing.assert_allclose(flown(env, [0.5, 0.0, 0.0])[0], np.tile([0.4, 0.0, 0.0], (16, 1)), atol=1e-15)
    flown(plain, [0.4, 0.0, 0.0])
    pushed = np.linalg.norm(env.state.velocity[:, 0] - plain.state.velocity[:, 0], axis=1)
    np.testing.assert_allclose(pushed, 1e-3, rtol=1e-9)


@pytest.mark.parametrize("eclipse", [False, True])
def test_sunlight_pushes_deputies_away_from_the_sun(eclipse):
    given_light = [f"{SIMULATOR}.illumination_params.eclipse={eclipse}"] if eclipse else []
    pressed = f"{SIMULATOR}.disturbance={{functor: SolarPressure, config: {{deputy: 2.0, chief: 0.5}}}}"
    env, plain = environment(64, *given_light, pressed), environment(64, *given_light)
    start = env.state.take(np.arange(64))
    for each in (env, plain):
        flown(each, [0.0, 0.0, 0.0])
    lit = start["sunlight"][:, None] if eclipse else 1.0
    wanted = -1.5 * 1361.0 / 299_792_458.0 * lit * start["sun_direction"]
    np.testing.assert_allclose(env.state.velocity[:, 0] - plain.state.velocity[:, 0], STEP * wanted, atol=1e-12)
    np.testing.assert_allclose(env.state.position[:, 0] - plain.state.position[:, 0], 50.0 * wanted, atol=1e-12)
    bounds = SolarPressure(deputy=0.5, chief=2.0).disturbance_bounds(MotionLimits(STEP, MASS, 1.0))
    assert bounds.velocity == pytest.approx(np.linalg.norm(wanted, axis=1).max() * STEP)


def test_the_pressure_of_sunlight_needs_a_sun():
    with pytest.raises(InitialStateError, match="needs the component `Sun`"):
        environment(1, f"{SIMULATOR}.disturbance=SolarPressure", task="docking")


def test_two_components_of_one_class_are_refused_not_lost():
    twice = (
        "[{functor: ThrusterModel}, {functor: BoundedDisturbance}, {functor: ThrusterModel, config: {gain_error: 0.1}}]"
    )
    with pytest.raises(ConfigError, match=r"config\.disturbance: there are 2 components ThrusterModel; combine"):
        environment(1, f"{SIMULATOR}.disturbance={twice}")
    composed = "{type: ComposedSimulator, config: {components: [{functor: SolarPressure}, {functor: SolarPressure}]}}"
    with pytest.raises(ArgumentError, match="there are 2 components SolarPressure; combine them into one"):
        environment(1, f"config.config.env_config.simulator={composed}", task="docking")
