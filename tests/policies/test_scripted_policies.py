"""Scripted policies fly the shipped task: what they promise of thrust, fuel, distance and prediction holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from safe_inspect.config.experiment import load_experiment
from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.policies import with_scripted
from safe_inspect.policies import SCRIPTED_POLICY, NaturalMotionInspector, RandomThrust, ScriptedPolicy, ZeroThrust
from safe_inspect.policies.burn_execution import take_turns
from safe_inspect.policies.docking import DockingAutopilot, DockingController
from safe_inspect.policies.inspector import SixDofInspector
from safe_inspect.rta.inspection import RTAGlueCWHInspection1v1
from safe_inspect.types import AnyArray, FloatArray

HORIZON = 1224


@dataclass
class Flown:
    """Episodes up to their ends: a step is one entry, and arrays have the environments first."""

    inspected: AnyArray
    delta_v: FloatArray
    length: AnyArray
    nearest: float
    apart: float
    farthest: float


def team_of(
    shipped: Path, pilot: ScriptedPolicy, deputies: int = 1, overrides: tuple[str, ...] = ()
) -> EnvironmentSpec:
    """Return the shipped task with some deputies that one scripted policy flies."""
    spec = load_experiment(shipped, overrides).spec
    names = [f"blue{index}" for index in range(deputies)]
    platform, start = next(iter(spec.platforms.values())), next(iter(spec.reset.deputies.values()))
    return replace(
        spec,
        platforms=dict.fromkeys(names, platform),
        agents=tuple(
            replace(spec.agents[0], name=f"{name}_ctrl", platform=name, scripted_policy=pilot) for name in names
        ),
        reset=replace(spec.reset, deputies=dict.fromkeys(names, start), separation=20.0 if deputies > 1 else 0.0),
    )


def fly(environment: TeamEnvironment, steps: int = HORIZON) -> Flown:
    """Fly each environment until all points are inspected."""
    environment.reset()
    rows, deputies = environment.num_envs, environment.simulation.world.num_deputies
    running = np.ones(rows, dtype=np.bool_)
    flown = Flown(
        np.zeros(rows, dtype=np.int64),
        np.zeros((rows, deputies)),
        np.zeros(rows, dtype=np.int64),
        nearest=np.inf,
        apart=np.inf,
        farthest=0.0,
    )
    for _ in range(steps):
        environment.step(())
        state, team = environment.state, environment.team()
        flown.inspected[running] = state.points["chief"].team_count[running]
        flown.delta_v[running] = state.delta_v[running]
        flown.length += running
        ranges = np.linalg.norm(team.position[running], axis=-1)
        flown.nearest, flown.farthest = min(flown.nearest, ranges.min()), max(flown.farthest, ranges.max())
        flown.apart = min(flown.apart, team.distance[running].min(initial=np.inf))
        running &= state.points["chief"].team_count < 100
        state.finished[~running] = 1
        if not running.any():
            break
    return flown


def memory(environment: TeamEnvironment) -> Mapping[str, AnyArray]:
    """Return what the first group's policy remembers."""
    view = environment.view()
    return {
        name: view.memory(SCRIPTED_POLICY, name)
        for name in environment.groups[0].agent.scripted_policy.memory(view.world)
    }  # type: ignore[union-attr]


def test_zero_thrust_coasts(shipped: Path) -> None:
    environment = TeamEnvironment(team_of(shipped, ZeroThrust(), 2), 3)
    environment.reset()
    environment.step(())
    assert not environment.state.control.any()
    assert not environment.state.delta_v.any()


def random_thrusts(shipped: Path, first_slot: int, rows: int, steps: int = 30) -> FloatArray:
    """Return the thrusts of two deputies that fly at random [N], shape (steps, rows, 2, 3)."""
    environment = TeamEnvironment(team_of(shipped, RandomThrust(), 2), rows, first_slot=first_slot)
    environment.reset()
    thrusts = []
    for _ in range(steps):
        environment.step(())
        thrusts.append(environment.state.control.copy())
    return np.stack(thrusts)


def test_random_thrust_is_uniform_between_the_limits(shipped: Path) -> None:
    thrusts = random_thrusts(shipped, 0, 400, steps=3).ravel()  # all still fly
    assert thrusts.min() >= -1.0
    assert thrusts.max() <= 1.0
    # 7,200 numbers: mean 0 and variance 1/3 within four standard errors.
    assert abs(thrusts.mean()) < 4.0 * np.sqrt(1.0 / 3.0 / thrusts.size)
    assert abs(thrusts.var() - 1.0 / 3.0) < 4.0 * np.sqrt(4.0 / 45.0 / thrusts.size)
    assert len(np.unique(thrusts)) == thrusts.size


def test_random_thrust_does_not_depend_on_the_batch(shipped: Path) -> None:
    whole, part = random_thrusts(shipped, 0, 6), random_thrusts(shipped, 4, 1)
    np.testing.assert_array_equal(whole[:, 4:5], part)


def test_the_inspector_sees_every_point_for_little_fuel(shipped: Path) -> None:
    flown = fly(TeamEnvironment(team_of(shipped, NaturalMotionInspector()), 24))
    assert (flown.inspected == 100).mean() >= 0.95
    assert flown.delta_v.mean() < 0.15
    assert flown.nearest > 15.0
    assert flown.farthest < 790.0


def test_the_flight_is_the_plan(shipped: Path) -> None:
    environment = TeamEnvironment(team_of(shipped, NaturalMotionInspector(restarts=1)), 4, seed=11)
    environment.reset()
    burning = np.zeros(4, dtype=np.int64)
    for step in range(HORIZON):
        environment.step(())
        state, kept = environment.state, memory(environment)
        np.testing.assert_allclose(kept["expected"][:, :3], state.position[:, 0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(kept["expected"][:, 3:], state.velocity[:, 0], rtol=0, atol=1e-12)
        burning += state.control.any(axis=(1, 2))
        done = state.points["chief"].team_count == 100
        # The next review is planned for the step after the last point.
        np.testing.assert_array_equal(done, step + 1 >= kept["review"] - 1)
        if done.all():
            break
    assert done.all()
    assert burning.max() <= 3  # one step for each burn


def test_a_second_look_at_a_state_changes_nothing(shipped: Path) -> None:
    environment = TeamEnvironment(team_of(shipped, NaturalMotionInspector(restarts=1), 2), 3)
    environment.reset()
    for _ in range(4):
        thrust = environment.groups[0].fly(environment.view())
        kept = {name: array.copy() for name, array in memory(environment).items()}
        np.testing.assert_array_equal(environment.groups[0].fly(environment.view()), thrust)
        for name, array in memory(environment).items():
            np.testing.assert_array_equal(array, kept[name])
        environment.step(())


def test_a_weak_engine_burns_longer(shipped: Path) -> None:
    overrides = tuple(f"agent_config.blue0_ctrl.config.config.parts.{axis}.config.properties.{side}={value}"
                      for axis in range(3) for side, value in (("low", -0.01), ("high", 0.01)))  # fmt: skip
    environment = TeamEnvironment(team_of(shipped, NaturalMotionInspector(), 1, overrides), 4, seed=3)
    np.testing.assert_allclose(environment.groups[0].limits.high, 0.01)
    environment.reset()
    thrusting = np.zeros(4, dtype=np.int64)
    for _ in range(HORIZON):
        environment.step(())
        assert np.abs(environment.state.control).max() <= 0.01
        thrusting += environment.state.control.any(axis=(1, 2))
        won = environment.state.points["chief"].team_count == 100
        environment.state.finished[won] = 1
        if won.all():
            break
    assert won.all()
    assert thrusting.max() > 3


def test_the_inspector_does_not_depend_on_the_batch(shipped: Path) -> None:
    spec = team_of(shipped, NaturalMotionInspector(restarts=1, iterations=200), 2)
    whole, part = TeamEnvironment(spec, 4), TeamEnvironment(spec, 1, first_slot=2)
    for environment in (whole, part):
        environment.reset()
        for _ in range(120):
            environment.step(())
    np.testing.assert_array_equal(whole.state.position[2:3], part.state.position)
    np.testing.assert_array_equal(memory(whole)["delta_v"][4:6], memory(part)["delta_v"])


def test_several_inspectors_share_the_work_and_keep_apart(shipped: Path) -> None:
    flown = fly(TeamEnvironment(team_of(shipped, NaturalMotionInspector(restarts=2), 3), 12))
    assert (flown.inspected == 100).all()
    assert flown.delta_v.mean() < 0.12  # of one deputy
    assert flown.length.mean() < 700
    assert flown.apart > 15.0
    assert flown.nearest > 15.0


def test_an_inspector_off_its_course_plans_again(shipped: Path) -> None:
    environment = TeamEnvironment(team_of(shipped, NaturalMotionInspector()), 6, seed=5)
    environment.reset()
    for _ in range(40):
        environment.step(())
    environment.state.velocity[:, 0] += 0.05
    for _ in range(HORIZON - 40):
        environment.step(())
    assert (environment.state.points["chief"].team_count == 100).all()
    assert np.linalg.norm(environment.state.position[:, 0], axis=-1).min() > 10.0


@pytest.mark.parametrize("glare", [0.0, 0.56])
def test_limits_of_speed_and_glare_hold(shipped: Path, glare: float) -> None:
    pilot = NaturalMotionInspector(restarts=2, glare=glare)
    environment = TeamEnvironment(team_of(shipped, pilot), 8, seed=2)
    environment.reset()
    for _ in range(HORIZON):
        environment.step(())
        state = environment.state
        won = state.points["chief"].team_count == 100
        state.finished[won] = 1
        position, velocity = state.position[~won, 0], state.velocity[~won, 0]
        ranges = np.linalg.norm(position, axis=1)
        assert (np.linalg.norm(velocity, axis=1) <= 0.2 + 2.0 * 0.001027 * (ranges - 10.0)).all()
        if glare:
            away = -(position * state.sun_direction[~won]).sum(axis=1) / ranges
            assert (away <= np.cos(np.pi / 6.0)).all()
        if won.all():
            break
    assert won.all()


def test_a_plan_within_the_limits_is_not_filtered(shipped: Path) -> None:
    overrides = ("agent_config.blue0_ctrl.config.config.glues.0.config.enabled=True",)
    environment = TeamEnvironment(team_of(shipped, NaturalMotionInspector(glare=0.56), 1, overrides), 12)
    assert isinstance(environment.groups[0].safety_filter, RTAGlueCWHInspection1v1)
    flown = fly(environment)
    assert (flown.inspected == 100).mean() >= 0.9
    assert environment.state.interventions.mean() < 1.0


def test_deputies_on_a_collision_course_step_aside(shipped: Path) -> None:
    environment = TeamEnvironment(team_of(shipped, NaturalMotionInspector(), 3), 2)
    environment.reset()
    state = environment.state
    # Head on from 25 m at 0.5 m/s: 50 s are left, five steps, until they meet.
    state.position[:, :3] = [[60.0, 0.0, 0.0], [0.0, 0.0, 70.0], [0.0, 25.0, 70.0]]
    state.velocity[:, :3] = [[0.0, -0.12, 0.0], [0.0, 0.25, 0.0], [0.0, -0.25, 0.0]]
    apart = np.inf
    for _ in range(60):
        environment.step(())
        apart = min(apart, environment.team().distance.min())
    assert apart > 19.0


def test_who_meets_first_plans_first() -> None:
    from safe_inspect.dynamics.step_maps import step_maps

    # Deputies 2 and 4 close head on from 30 m, 1 and 3 from 60 m; 0 is alone.
    position = np.zeros((1, 5, 3))
    position[0, :, 0] = (0.0, 200.0, 100.0, 260.0, 130.0)
    position[0, 0, 2] = 500.0
    velocity = np.zeros((1, 5, 3))
    velocity[0, :, 0] = (0.0, 0.4, 0.4, -0.4, -0.4)
    turn = np.full(5, -1)
    take_turns(turn, np.arange(5), 5, position, velocity, step_maps(0.001027, 10.0, 100), 20.0)
    assert turn.tolist() == [2, 1, 0, 3, 4]


class NeedsATarget(ScriptedPolicy):
    """Declares what it reads."""

    needs = ("target_orientation",)

    def __call__(self, view, limits):
        raise AssertionError("no episode starts")


class ReadsATarget(ScriptedPolicy):
    """Declares nothing."""

    def __call__(self, view, limits):
        return view.target_orientation


@pytest.mark.parametrize(
    ("task", "policy", "lacking"),
    [
        ("TranslationalInspection-v1", DockingController(), "`mating_point_position`, `target_orientation`"),
        ("TranslationalInspection-v1", SixDofInspector(), "`turning_body`, `orientation`, `angular_velocity`, which"),
        ("Docking-v0", SixDofInspector(), "`angular_velocity`, `points`, `sun_angle`, which"),
        ("TumblingRendezvous-v0", DockingAutopilot(), "`mean_motion`, which"),
        ("TranslationalInspection-v1", NeedsATarget(), "`target_orientation`, which"),
    ],
)
def test_a_task_that_lacks_what_a_policy_needs_is_refused_before_an_episode_starts(task, policy, lacking):
    spec = load_experiment(f"safe_inspect/{task}").spec
    with pytest.raises(SafeInspectError, match=f"{policy.registered_name} cannot fly .*: it reads .*{lacking}"):
        TeamEnvironment(with_scripted(spec, policy), 2)


def test_a_policy_that_declares_nothing_is_named_when_it_reads_what_is_not_there():
    spec = load_experiment("safe_inspect/TranslationalInspection-v1").spec
    environment = TeamEnvironment(with_scripted(spec, ReadsATarget()), 2, _fused=False)
    environment.reset()
    with pytest.raises(
        SafeInspectError, match=r"ReadsATarget reads a missing value \(.*policies.py:\d+\): the view of"
    ):
        environment.step(())
