"""The free flyer and its actuators, against closed forms and integrators of SciPy."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from safe_inspect.dynamics.base import advance_kernel
from safe_inspect.dynamics.cwh import transition
from safe_inspect.dynamics.free_flyer import FreeFlyer
from safe_inspect.dynamics.quaternion import exp, rotate
from safe_inspect.dynamics.tide import largest_tide, tidal_acceleration, to_hill
from safe_inspect.simulators.resets.initializers import PositionVelocityInitializer
from safe_inspect.simulators.resets.parameters import ConstantParameter
from safe_inspect.simulators.resets.plan import BodyReset, ResetPlan
from safe_inspect.simulators.simulator import Simulation
from safe_inspect.tasks.thruster_model import Actuators

_MASS = 9.583788668
_INERTIA = np.array([0.153427995, 0.14271405, 0.162302759])
_LEVEL = np.array([0.0, 0.0, 0.0, 1.0])


def _start(rows: int = 1) -> dict[str, np.ndarray]:
    generator = np.random.default_rng(0)
    return {
        "position": generator.normal(size=(rows, 1, 3)),
        "velocity": generator.normal(size=(rows, 1, 3)),
        "orientation": exp(generator.normal(size=(rows, 1, 3))),
        "angular_velocity": 0.1 * generator.normal(size=(rows, 1, 3)),
        "wrench": np.zeros((rows, 1, 6)),
        "orbit_angle": np.zeros((rows, 1, 1)),
    }


def _fly(
    flyer: FreeFlyer,
    start: Mapping[str, np.ndarray],
    control: np.ndarray,
    steps: int,
    step: float = 0.008,
    mass: float = _MASS,
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], np.ndarray]:
    """Return the arrays at the end, their trace, and the velocity that was spent, after a held control (N, 6)."""
    arrays = {name: array.copy() for name, array in start.items()}
    rows = len(control)
    trace = {name: np.zeros((rows, 1, steps, *array.shape[2:])) for name, array in arrays.items()}
    spent, time, count = np.zeros((rows, 1)), np.zeros(rows), np.zeros(rows, np.int64)
    advance_kernel(flyer, step, traced=True)(
        *flyer(step), *arrays.values(), *trace.values(), control[:, None], np.array([mass]), step, steps, spent, time,
        count,
    )  # fmt: skip
    return arrays, trace, spent


def test_a_force_and_a_torque_along_the_axes_of_the_body_move_it() -> None:
    start, command = _start(), np.array([[0.1, -0.2, 0.05, 0.01, -0.02, 0.015]])
    end, _, spent = _fly(FreeFlyer(), start, command, 2000)

    def rates(_: float, x: np.ndarray) -> np.ndarray:
        q, w = x[6:10], x[10:]
        turned = np.array(
            [
                q[3] * w[0] + q[1] * w[2] - q[2] * w[1],
                q[3] * w[1] - q[0] * w[2] + q[2] * w[0],
                q[3] * w[2] + q[0] * w[1] - q[1] * w[0],
                -q[:3] @ w,
            ]
        )
        spin = (command[0, 3:] - np.cross(w, _INERTIA * w)) / _INERTIA
        return np.concatenate([x[3:6], rotate(q, command[0, :3]) / _MASS, 0.5 * turned, spin])

    begin = np.concatenate([start[name][0, 0] for name in ("position", "velocity", "orientation", "angular_velocity")])
    exact = solve_ivp(rates, (0.0, 16.0), begin, rtol=1e-12, atol=1e-13, method="DOP853").y[:, -1]
    np.testing.assert_allclose(end["position"][0, 0], exact[:3], atol=2e-6)
    np.testing.assert_allclose(end["velocity"][0, 0], exact[3:6], atol=2e-6)
    np.testing.assert_allclose(end["orientation"][0, 0], exact[6:10], atol=1e-8)
    np.testing.assert_allclose(end["angular_velocity"][0, 0], exact[10:], atol=1e-8)
    np.testing.assert_allclose(spent, 16.0 * 0.35 / _MASS, rtol=1e-12)


def test_a_body_that_does_not_turn_is_moved_exactly() -> None:
    start = {**_start(), "orientation": _LEVEL[None, None], "angular_velocity": np.zeros((1, 1, 3))}
    command = np.array([[0.1, -0.2, 0.05, 0.0, 0.0, 0.0]])
    end, _, _ = _fly(FreeFlyer(), start, command, 2000)
    phi, gamma = transition(0.0, _MASS, 16.0)
    state = phi @ np.concatenate([start["position"][0, 0], start["velocity"][0, 0]]) + gamma @ command[0, :3]
    np.testing.assert_allclose(end["position"][0, 0], state[:3], rtol=1e-12)
    np.testing.assert_allclose(end["velocity"][0, 0], state[3:], rtol=1e-12)


def test_actuators_saturate_scale_lag_and_err() -> None:
    actuators = Actuators(force=0.3, torque=0.025, scale_error=0.1, force_noise=0.003, torque_noise=1e-4)
    axes = {name: ConstantParameter(value=0.0) for name in PositionVelocityInitializer.parameters}
    plan = ResetPlan({}, {"chaser": BodyReset(PositionVelocityInitializer(), axes)}, {})
    simulation = Simulation(
        FreeFlyer(lag=0.1, keeps_trace=True), (actuators,), masses={"chaser": _MASS}, groups=(), reset=plan,
        step_size=4.0, decimation=500, num_envs=50, seed=0, first_slot=0,
    )  # fmt: skip
    simulation.reset(np.arange(50))
    command = np.array([5.0, -5.0, 0.1, 1.0, 0.0, -1.0])
    simulation.step(np.tile(command, (50, 1, 1)))
    middle = 1.1 * np.array([0.3, -0.3, 0.1, 0.025, 0.0, -0.025])
    error = (simulation.flown[:, 0] - middle) / np.repeat([0.003, 1e-4], 3)
    assert np.abs(error).max() <= 1.0
    assert np.abs(error).max() > 0.95
    np.testing.assert_allclose(error.mean(axis=0), 0.0, atol=4.0 / np.sqrt(3.0 * 50))
    assert np.abs(np.corrcoef(error.T)[np.triu_indices(6, 1)]).max() < 0.6
    wrench = simulation.trace["wrench"][:, 0]
    np.testing.assert_allclose(wrench[:, -1], simulation.flown[:, 0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(wrench[:, 0], simulation.flown[:, 0] * -np.expm1(-0.08), rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(simulation.state.control[:, 0], np.tile(command, (50, 1)))
    before = simulation.flown.copy()
    simulation.step(np.tile(command, (50, 1, 1)))
    assert (simulation.flown != before).all()


def test_a_row_alone_and_in_a_batch_agree_bit_for_bit() -> None:
    flyer = FreeFlyer(lag=0.05, mean_motion=1e-3)
    start, command = _start(5), np.random.default_rng(1).normal(size=(5, 6))
    together, _, _ = _fly(flyer, start, command, 25)
    for row in range(5):
        one = slice(row, row + 1)
        alone, _, _ = _fly(flyer, {name: array[one] for name, array in start.items()}, command[one], 25)
        for name, array in alone.items():
            assert together[name][one].tobytes() == array.tobytes()


@pytest.mark.parametrize("steps", [1, 25])
def test_the_trace_has_the_state_after_each_physics_step(steps: int) -> None:
    flyer, command = FreeFlyer(lag=0.05, mean_motion=1e-3), np.full((1, 6), 0.01)
    state = _start()
    _, trace, _ = _fly(flyer, state, command, steps)
    for step in range(steps):
        state, _, _ = _fly(flyer, state, command, 1)
        for name, array in state.items():
            assert array[:, 0].tobytes() == np.ascontiguousarray(trace[name][:, 0, step]).tobytes(), name


@pytest.mark.parametrize("began", [0.0, 1234.5])
def test_on_an_orbit_it_moves_as_in_hills_frame_and_as_gravity_pulls(began: float) -> None:
    n, mass, seconds = 1.0454e-3, 1600.0, 600.0
    flyer = FreeFlyer(inertia=(1500.0, 1500.0, 1200.0), mean_motion=n)
    p, v = np.array([5.0, -30.0, 8.0]), np.array([0.02, 0.01, -0.03])
    start = {
        "position": p[None, None], "velocity": v[None, None], "orientation": _LEVEL[None, None],
        "angular_velocity": np.zeros((1, 1, 3)), "wrench": np.zeros((1, 1, 6)),
        "orbit_angle": np.full((1, 1, 1), n * began),
    }  # fmt: skip

    def flown(control: np.ndarray) -> np.ndarray:
        end, _, _ = _fly(flyer, start, control[None], 3000, 0.2, mass)
        return np.concatenate([end["position"][0, 0], end["velocity"][0, 0]])

    phi, _ = transition(n, mass, seconds)
    expected = phi @ to_hill(n, began, np.concatenate([p, v]))
    np.testing.assert_allclose(to_hill(n, began + seconds, flown(np.zeros(6))), expected, rtol=1e-9, atol=1e-9)

    # Two satellites about the Earth, with a constant force in inertial axes; the difference is linear up to |p| / r.
    mu = 3.986004418e14
    r = (mu / n**2) ** (1.0 / 3.0)
    force = np.array([0.1, -0.2, 0.05])

    def fall(t: float, x: np.ndarray) -> np.ndarray:
        target = r * np.array([np.cos(n * t), np.sin(n * t), 0.0])
        whole = target + x[:3]
        pull = -mu * whole / np.linalg.norm(whole) ** 3 + n**2 * target
        return np.concatenate([x[3:], pull + force / mass])

    begin, span = np.concatenate([p, v]), (began, began + seconds)
    exact = solve_ivp(fall, span, begin, rtol=1e-12, atol=1e-12, method="DOP853").y[:, -1]
    np.testing.assert_allclose(flown(np.append(force, np.zeros(3))), exact, rtol=0.0, atol=3e-3)
    straight = p + seconds * v + 0.5 * seconds**2 * force / mass
    assert np.linalg.norm(exact[:3] - straight) > 5.0  # what the tide makes of it is far more than the tolerance


def test_the_tide_is_the_acceleration_of_the_motion_on_an_orbit() -> None:
    n, position = 1.0454e-3, np.array([[5.0, -30.0, 8.0]])
    start = {**_start(), "position": position[None], "velocity": np.zeros((1, 1, 3))}
    end, _, _ = _fly(FreeFlyer(mean_motion=n), start, np.zeros((1, 6)), 1, 1e-2)
    tide = tidal_acceleration(n, np.zeros(1), position)[0]
    np.testing.assert_allclose(end["velocity"][0, 0] / 1e-2, tide, rtol=1e-4, atol=1e-12)
    assert np.linalg.norm(tidal_acceleration(n, np.arange(9.0), position), axis=1).max() <= largest_tide(n, 32.0)
