"""A chief that rotates freely in inertial space: Euler's equations, the frames, the draws and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.dynamics.orbit.relative_orbit_row import in_inertial_axes
from safe_inspect.environments import TeamEnvironment
from safe_inspect.errors import ConfigError

SIMULATOR = "config.config.env_config.simulator.config"
N, STEP, INERTIA = 0.001027, 10.0, np.array([3.0, 5.0, 6.0])
TUMBLE = f"{SIMULATOR}.chief_rotation={{inertia: [3, 5, 6], rate: [1 deg/s, 2 deg/s]}}"
ORBIT = f"{SIMULATOR}.dynamics={{functor: RelativeOrbit, config: {{eccentricity: 0.05, inclination: 70 deg}}}}"


def environment(rows, *overrides, first_slot=0):
    spec = load_experiment(configs_root() / "translational-inspection" / "experiment.yml", [TUMBLE, *overrides]).spec
    env = TeamEnvironment(spec, rows, seed=5, first_slot=first_slot)
    env.reset()
    return env


def flown(env, steps, *names):
    found = {name: [env.simulation.state[name].copy()] for name in names}
    for _ in range(steps):
        env.simulation.step(np.zeros((env.num_envs, 1, 3)))
        for name in names:
            found[name].append(env.simulation.state[name].copy())
    return {name: np.array(values) for name, values in found.items()}


def test_the_motion_is_that_of_eulers_equations():
    env = environment(6)
    found = flown(env, 40, "chief_inertial", "chief_spin")

    def rates(_, x):
        q, w = x[:4], x[4:]
        turn = np.array([*w, 0.0])
        x0, y0, z0, w0 = q
        matrix = np.array([[w0, -z0, y0, x0], [z0, w0, -x0, y0], [-y0, x0, w0, z0], [-x0, -y0, -z0, w0]])
        return np.concatenate((0.5 * matrix @ turn, np.cross(INERTIA * w, w) / INERTIA))

    for row in range(6):
        start = np.concatenate((found["chief_inertial"][0, row], found["chief_spin"][0, row]))
        exact = solve_ivp(rates, (0.0, 400.0), start, "DOP853", [400.0], rtol=1e-12, atol=1e-13).y[:, -1]
        apart = Rotation.from_quat(found["chief_inertial"][-1, row]).inv() * Rotation.from_quat(exact[:4])
        assert apart.magnitude() < 1e-6
        np.testing.assert_allclose(found["chief_spin"][-1, row], exact[4:], atol=1e-9)
        assert np.abs(found["chief_spin"][:, row] - found["chief_spin"][0, row]).max() > 1e-3, "it tumbles"


@pytest.mark.parametrize("orbit", [(), (ORBIT,)], ids=["circular", "elliptic"])
def test_the_angular_momentum_is_constant_in_inertial_space(orbit):
    env = environment(5, *orbit)
    names = ("chief_orientation", "chief_spin", "time", *(["chief_orbit"] if orbit else []))
    found = flown(env, 60, *names)
    momenta = []
    for k in range(61):
        hill = Rotation.from_quat(found["chief_orientation"][k]).apply(INERTIA * found["chief_spin"][k])
        if orbit:
            inertial = np.empty_like(hill)
            in_inertial_axes(found["chief_orbit"][k], hill, inertial)
        else:
            inertial = Rotation.from_euler("Z", (N * found["time"][k])[:, None]).apply(hill)
        momenta.append(inertial)
    np.testing.assert_allclose(momenta, np.broadcast_to(momenta[0], np.shape(momenta)), atol=1e-7)
    assert np.linalg.norm(momenta[0], axis=1).min() > 0.05


def test_attitudes_and_directions_are_uniform_and_rates_within_their_range():
    env = environment(4000)
    state = env.simulation.state
    rate = np.degrees(np.linalg.norm(state["chief_spin"], axis=1))
    assert 1.0 <= rate.min() < 1.01
    assert 1.99 < rate.max() <= 2.0
    assert rate.mean() == pytest.approx(1.5, abs=0.02)
    assert (
        np.abs((state["chief_spin"] / np.linalg.norm(state["chief_spin"], axis=1, keepdims=True)).mean(0)).max() < 0.04
    )
    turned = Rotation.from_quat(state["chief_orientation"]).as_matrix()
    assert np.abs(turned.mean(axis=0)).max() < 0.04
    np.testing.assert_allclose((turned**2).mean(axis=0), 1.0 / 3.0, atol=0.02)


def test_bodies_and_sun_are_seen_in_the_axes_of_the_chief():
    env = environment(8)
    flown(env, 3)
    state = env.simulation.state
    back = Rotation.from_quat(state["chief_orientation"]).inv()
    np.testing.assert_allclose(state["axes/chief/position"][:, 0], back.apply(state.position[:, 0]), atol=1e-9)
    np.testing.assert_allclose(state["axes/chief/sun_direction"], back.apply(state["sun_direction"]), atol=1e-12)


def test_a_row_of_a_batch_rotates_as_alone_and_points_are_inspected():
    batch, alone = environment(8), environment(1, first_slot=5)
    for env in (batch, alone):
        flown(env, 20)
    for name in ("chief_orientation", "chief_spin"):
        np.testing.assert_array_equal(batch.simulation.state[name][5], alone.simulation.state[name][0])
    assert batch.state["points/chief/inspector"].max() >= 0, "some points are inspected"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("chief_rotation={inertia: [1, 1, 3]}", "no body has the principal moments 1, 1 and 3 kg m"),
        ("chief_rotation={inertia: [1, 1, 1], rate: [0.1, 0.05]}", "the smallest `rate` 0.1 is above the largest 0.05"),
        ("chief_rotation={inertia: [1, 1]}", "chief_rotation.inertia"),
        ("chief_rotation={inertia: [1, 1, 0]}", r"chief_rotation\.inertia\[2\]"),
        ("chief_angular_velocity=[0, 0, 0.1]", "exclude each other; remove one of them"),
    ],
)
def test_impossible_rotations_are_refused(given, said):
    with pytest.raises(ConfigError, match=said):
        environment(1, f"{SIMULATOR}.{given}")


def test_sensors_that_predict_refuse_a_body_that_rotates():
    path = configs_root() / "translational-inspection" / "experiment-burn-and-coast.yml"
    with pytest.raises(ConfigError, match="needs a body that does not turn"):
        load_experiment(path, [TUMBLE])
