"""The pilots of docking and of turning vehicles, and plans, give the thrusts of their formulas, deputy by deputy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from safe_inspect.environments import TeamEnvironment, load_spec
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.policies import with_scripted
from safe_inspect.policies import DockingAutopilot, SixDofInspector, ZeroThrust
from safe_inspect.policies.base import ScriptedPolicy, ThrustLimits
from safe_inspect.policies.docking import DockingController
from safe_inspect.policies.open_loop import OpenLoopPlan
from safe_inspect.policies.plan_record import Burn

ROWS, N = 40, 0.001027
WIDE = ThrustLimits(np.full(3, -1e9), np.full(3, 1e9))


def begun(task: str, policy: ScriptedPolicy) -> TeamEnvironment:
    environment = TeamEnvironment(with_scripted(load_spec(f"safe_inspect/{task}"), policy), ROWS, seed=4)
    environment.reset()
    return environment


def scattered(environment: TeamEnvironment, far: float, fast: float) -> np.random.Generator:
    """Draw positions and velocities of all deputies, and their masses."""
    draws, state = np.random.default_rng(8), environment.state
    state.position[:, 0] = draws.normal(size=(ROWS, 3)) * far
    state.velocity[:, 0] = draws.normal(size=(ROWS, 3)) * fast
    return draws


def within(thrust: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return a thrust shortened to its limits, its direction kept."""
    share = min([1.0, *(bound / value for value, bound in zip(thrust, high, strict=True) if value > bound),
                 *(bound / value for value, bound in zip(thrust, low, strict=True) if value < bound)])  # fmt: skip
    return share * thrust


@pytest.mark.parametrize("share", [0.98, 0.5])
@pytest.mark.parametrize(("low", "high"), [(-1e9, 1e9), (-0.7, 1.0)])
def test_the_autopilot_points_the_velocity_at_the_origin(share: float, low: float, high: float) -> None:
    autopilot = DockingAutopilot(share=share)
    environment = begun("Docking-v0", autopilot)
    scattered(environment, 40.0, 0.3)
    state, step = environment.state, environment.simulation.world.step_size
    state.position[0, 0], state.velocity[0, 0] = (0.2, 0.0, 0.0), 0.0  # inside the docking region
    limits = ThrustLimits(np.full(3, low), np.full(3, high))
    found = autopilot(environment.view(0), limits)
    rates = np.zeros((6, 6))
    rates[:3, 3:] = np.eye(3)
    rates[3, 0], rates[3, 4], rates[4, 3], rates[5, 2] = 3.0 * N * N, 2.0 * N, -2.0 * N, -N * N
    phi = expm(rates * step)
    mass = environment.simulation.world.masses[0]
    for row in range(ROWS):
        coasted = phi @ np.concatenate((state.position[row, 0], state.velocity[row, 0]))
        distance = np.linalg.norm(coasted[:3])
        speed = share * (0.2 + 2.0 * N * max(distance - 0.5, 0.0))
        gain = [math.sin(N * step) / N, 4.0 * math.sin(N * step) / N - 3.0 * step, math.sin(N * step) / N]
        thrust = mass * (-speed * coasted[:3] / distance - coasted[3:]) / np.array(gain)
        np.testing.assert_allclose(found[row], within(thrust, limits.low, limits.high), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("limit", [1e9, 0.02])
@pytest.mark.parametrize(
    "controller",
    [
        DockingController(),
        DockingController(frequency=0.2, lead=0.3),
    ],
)  # fmt: skip
def test_the_controller_follows_the_reference_that_turns_with_the_target(controller, limit) -> None:
    environment = begun("TumblingRendezvous-v0", controller)
    scattered(environment, 1.0, 0.1)
    view = environment.view(0)
    found = controller(view, ThrustLimits(np.full(3, -limit), np.full(3, limit)))
    standoff, corridor, approach_speed = 1.35, 0.6, 0.1  # the documented ones
    wn, zeta, near = controller.frequency, 1.0, 0
    for row in range(ROWS):
        mating, position, velocity = (
            array[row].copy() for array in (view.mating_point_position, view.position, view.velocity)
        )  # fmt: skip
        turn = Rotation.from_quat(view.target_orientation[row].copy()).apply(view.target_angular_velocity[row].copy())
        reach, angle = (
            np.linalg.norm(mating),
            math.acos(mating @ position / np.linalg.norm(mating) / np.linalg.norm(position)),
        )
        if angle < corridor:
            reference = mating / reach * (reach + (standoff - reach) * angle / corridor)
            near += 1
        else:
            axis = np.cross(position, mating)
            turned = Rotation.from_rotvec(min(angle, controller.lead) * axis / np.linalg.norm(axis)).apply(position)
            reference = standoff * turned / np.linalg.norm(position)
        pull = wn / (2.0 * zeta) * (reference - position)
        pull *= min(1.0, approach_speed / np.linalg.norm(pull))
        moves = np.cross(turn, reference)
        wanted = np.cross(turn, moves) + 2.0 * zeta * wn * (pull + moves - velocity)
        thrust = np.broadcast_to(view.mass, ROWS)[row] * wanted
        np.testing.assert_allclose(found[row], np.clip(thrust, -limit, limit), rtol=1e-6, atol=1e-9)
    assert 2 < near < ROWS - 2


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, -2.0, 1.0)])
def test_the_camera_turns_to_the_chief_in_two_steps(axis) -> None:
    pilot = SixDofInspector(translation=Push(), initial_sensor_unit_vec=axis)
    environment = begun("WeightedSixDofInspection-v0", pilot)
    draws = scattered(environment, 60.0, 0.1)
    state, world = environment.state, environment.simulation.world
    attitudes = Rotation.from_quat(draws.normal(size=(ROWS, 4)))
    state.orientation[:, 0], state.angular_velocity[:, 0] = attitudes.as_quat(), draws.normal(size=(ROWS, 3)) * 0.005
    vehicle, step = world.turning_body, world.step_size
    inertia, boresight = np.array(vehicle.inertia), np.array(axis) / np.linalg.norm(axis)
    wide = ThrustLimits(np.full(6, -1e9), np.full(6, 1e9))
    narrow = ThrustLimits(np.array([-0.1] * 3 + [-2e-4] * 3), np.array([0.2] * 3 + [1e-4] * 3))
    for limits in (wide, narrow):
        found, limited = pilot(environment.view(0), limits), 0
        for row in range(ROWS):
            body, w = attitudes[row], state.angular_velocity[row, 0]
            way, rate = -state.position[row, 0], -state.velocity[row, 0]
            frame = body.inv().apply([0.0, 0.0, vehicle.frame_rate])
            sight = body.inv().apply(np.cross(way, rate) / (way @ way)) + frame
            seen = body.inv().apply(way / np.linalg.norm(way))
            normal = np.cross(boresight, seen)
            phi = math.acos(boresight @ seen) * normal / np.linalg.norm(normal)
            wanted = w + phi / step - 1.5 * (w - sight)
            most = 0.98 * vehicle.rate_limit
            limited += np.linalg.norm(wanted) > most
            wanted *= min(1.0, most / np.linalg.norm(wanted))
            moment = within(inertia * (wanted - w) / step, limits.low[3:], limits.high[3:])
            middle = body * Rotation.from_rotvec(0.5 * step * (w - frame + 0.25 * step * moment / inertia))
            thrust = within(middle.inv().apply([0.3, -0.2, 0.1]), limits.low[:3], limits.high[:3])
            np.testing.assert_allclose(found[row, 3:], moment, rtol=1e-6, atol=1e-12)
            np.testing.assert_allclose(found[row, :3], thrust, rtol=1e-6, atol=1e-9)
        assert limited > 2
    # straight behind, the camera turns about some axis across
    for sign in (1.0, -1.0):
        turn = pilot._rotation(sign * 5.0 * boresight[None])[0]
        assert np.linalg.norm(turn) == pytest.approx(0.0 if sign > 0 else math.pi)
        assert turn @ boresight == pytest.approx(0.0, abs=1e-12)


class Push(ScriptedPolicy):
    """Push one way."""

    def __call__(self, view, limits):
        assert limits.low.shape == limits.high.shape == (3,)
        return np.tile([0.3, -0.2, 0.1], (view.num_rows, 1))


def test_what_commands_the_attitude_does_not_give_the_thrust_of_another() -> None:
    with pytest.raises(ValidationError, match="SixDofInspector commands the attitude itself"):
        SixDofInspector(translation=SixDofInspector())


def test_a_plan_is_flown_in_its_episode_at_its_steps() -> None:
    environment = begun("TranslationalInspection-v1", ZeroThrust())
    keys = environment.view(0).per_environment(environment.state.key).tolist()
    burns = (Burn(step=1, steps=2, thrust=(0.5, 0.0, -0.25)), Burn(step=2, steps=1, thrust=(0.25, 1.0, 0.0)))
    plans = [(key, burns if row == 3 else ()) for row, key in enumerate(keys)]
    pilot = OpenLoopPlan.of(plans)
    shown = {0: (0.0, 0.0, 0.0), 1: (0.5, 0.0, -0.25), 2: (0.75, 1.0, -0.25), 3: (0.0, 0.0, 0.0)}
    for step, wanted in shown.items():
        found = pilot(environment.view(0), WIDE)
        assert environment.view(0).step.tolist() == [step] * ROWS
        np.testing.assert_array_equal(found[3], wanted)
        assert not np.delete(found, 3, axis=0).any()
        environment.step(())
    assert not OpenLoopPlan()(environment.view(0), WIDE).any()
    with pytest.raises(SafeInspectError, match="has no plan for this episode"):
        OpenLoopPlan.of(plans[:-1])(environment.view(0), WIDE)
    with pytest.raises(ValidationError, match="must be a hexadecimal number, got 'xyz'"):
        OpenLoopPlan(plans={"xyz": ()})
