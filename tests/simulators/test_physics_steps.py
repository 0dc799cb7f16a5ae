"""A step of several physics steps against one as long, and against the equations of motion."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from safe_inspect.dynamics.attitude.clohessy_wiltshire_attitude import ClohessyWiltshireAttitude
from safe_inspect.dynamics.clohessy_wiltshire import ClohessyWiltshire
from safe_inspect.dynamics.double_integrator import DoubleIntegrator
from safe_inspect.simulators.resets.initializers import PositionVelocityInitializer
from safe_inspect.simulators.resets.parameters import ConstantParameter
from safe_inspect.simulators.resets.plan import BodyReset, ResetPlan
from safe_inspect.simulators.simulator import ComposedSimulator, Simulation

N, MASS, STEP, STEPS = 0.001027, {"heavy": 12.0, "light": 4.0}, 20.0, 5
STARTS = {"heavy": (80.0, -30.0, 20.0, 0.05, -0.1, 0.02), "light": (-50.0, 10.0, 5.0, 0.0, 0.03, -0.04)}
CHIEF = (1.0, 2.0, -3.0, 0.001, 0.002, 0.003)
AXES = ("x", "y", "z", "x_dot", "y_dot", "z_dot")
CWH, FREE, TURNING = ClohessyWiltshire(mean_motion=N), DoubleIntegrator(), ClohessyWiltshireAttitude(mean_motion=N)


def start(values):
    return BodyReset(
        PositionVelocityInitializer(),
        {name: ConstantParameter(value=value) for name, value in zip(AXES, values, strict=True)},
    )


def flown(dynamics, decimation, control):
    """Return a simulation after `STEPS` steps of the controls (N, 2, C)."""
    plan = ResetPlan({}, {name: start(values) for name, values in STARTS.items()}, {"chief": start(CHIEF)})
    simulator = ComposedSimulator(dynamics=dynamics, decimation=decimation)
    simulation = Simulation(
        *simulator(), decimation=decimation, masses=MASS, groups=(), reset=plan, step_size=STEP, num_envs=len(control),
        seed=0, first_slot=0,
    )  # fmt: skip
    simulation.reset(np.arange(len(control)))
    for _ in range(STEPS):
        simulation.step(control)
    return simulation.state


def thrusts(dynamics):
    control = np.random.default_rng(4).uniform(-1.0, 1.0, (3, 2, dynamics.control_size))
    control[..., 3:] *= 1e-6  # moments
    return control


@pytest.mark.parametrize("dynamics", [CWH, FREE, TURNING], ids=["cwh", "free", "turning"])
@pytest.mark.parametrize("decimation", [2, 5])
def test_several_physics_steps_are_one_as_long(dynamics, decimation):
    control = thrusts(dynamics)
    one, several = flown(dynamics, 1, control), flown(dynamics, decimation, control)
    for name in dynamics.arrays:
        np.testing.assert_allclose(several[name], one[name], rtol=1e-6, atol=1e-8, err_msg=name)
    np.testing.assert_allclose(several.delta_v, one.delta_v, rtol=1e-12)
    np.testing.assert_allclose(several.time, STEP * STEPS, rtol=1e-12)
    np.testing.assert_array_equal(several.step, STEPS)


@pytest.mark.parametrize(("dynamics", "n"), [(CWH, N), (FREE, 0.0)], ids=["cwh", "free"])
@pytest.mark.parametrize("decimation", [1, 4])
def test_bodies_follow_the_equations_of_motion(dynamics, n, decimation):
    """Those without thrusters too; each deputy by its own thrust and mass."""
    control = thrusts(dynamics)
    state = flown(dynamics, decimation, control)
    for row in range(len(control)):
        for body, (name, values) in enumerate({**STARTS, "chief": CHIEF}.items()):
            push = control[row, body] / MASS[name] if name in MASS else np.zeros(3)

            def rate(_, x, push=push):
                x, _, z, vx, vy, vz = x
                pull = np.array([3.0 * n**2 * x + 2.0 * n * vy, -2.0 * n * vx, -(n**2) * z])
                return np.concatenate(((vx, vy, vz), pull + push))

            found = solve_ivp(rate, (0.0, STEP * STEPS), values, rtol=1e-10, atol=1e-12).y[:, -1]
            np.testing.assert_allclose(state.position[row, body], found[:3], rtol=1e-7, atol=1e-7)
            np.testing.assert_allclose(state.velocity[row, body], found[3:], rtol=1e-7, atol=1e-9)
            if name in MASS:
                spent = np.abs(control[row, body]).sum() / MASS[name] * STEP * STEPS
                assert state.delta_v[row, body] == pytest.approx(spent)
