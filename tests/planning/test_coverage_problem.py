"""The plan's own account of positions and inspected points is the simulator's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.evaluation.optimiser import _thrust_reach, coverage_problem, coverage_task
from safe_inspect.planning.coverage_problem import write_positions
from safe_inspect.planning.record import Burn
from safe_inspect.policies.open_loop import OpenLoopPlan

STEPS = 400
SLOTS = 4


@pytest.mark.parametrize(("hold", "seed"), [(1, 0), (3, 0), (4, 5)])
def test_positions_and_inspected_points_are_those_of_the_environment(
    spec: EnvironmentSpec, hold: int, seed: int
) -> None:
    environment = TeamEnvironment(spec, SLOTS, seed=seed)
    environment.reset()
    world, task = environment.simulation.world, coverage_task(spec)
    generator = np.random.default_rng(seed)
    # Burns that overlap may cancel, and then spend less than their sum.
    start = np.stack([8 * np.sort(generator.choice(STEPS // 8 - 5, 5, replace=False)) for _ in range(SLOTS)])
    delta_v = generator.uniform(-0.04, 0.04, (SLOTS, 5, 3))
    force = world.masses[0] / (hold * world.step_size)
    plans = [
        tuple(
            Burn(step=int(step), steps=hold, thrust=tuple(thrust))
            for step, thrust in zip(start[row], (delta_v[row] * force).tolist(), strict=True)
        )
        for row in range(SLOTS)
    ]
    pilot = OpenLoopPlan.of(zip(environment.state.key.tolist(), plans, strict=True))
    flown = TeamEnvironment(
        replace(spec, agents=tuple(replace(agent, scripted_policy=pilot, dones=()) for agent in spec.agents)),
        SLOTS,
        seed=seed,
    )
    flown.reset()
    positions = np.zeros((SLOTS, task.horizon + 1, 3))
    problems = [coverage_problem(environment, row, task, hold) for row in range(SLOTS)]
    for row, (problem, _) in enumerate(problems):
        write_positions(problem, start[row], delta_v[row], 5, 1, positions[row])
    for step in range(1, STEPS + 1):
        flown.step(())
        np.testing.assert_allclose(flown.state.position[:, 0], positions[:, step], rtol=0.0, atol=1e-8)
        for row, (problem, needed) in enumerate(problems):
            heights = positions[row, 1 : step + 1] @ problem.normals.T
            far_enough = (positions[row, 1 : step + 1] ** 2).sum(axis=-1)[:, None] >= problem.radius**2
            seen = ((heights >= problem.radius) & problem.lit[1 : step + 1] & far_enough).any(axis=0)
            inspected = flown.state.points["chief"].inspector[row, needed] >= 0
            np.testing.assert_array_equal(inspected, seen)
    np.testing.assert_allclose(flown.state.delta_v[:, 0], np.abs(delta_v).sum(axis=(1, 2)), rtol=1e-12)


def test_only_points_that_are_left_after_the_reset_are_asked_for(spec: EnvironmentSpec) -> None:
    environment = TeamEnvironment(spec, SLOTS, seed=2)
    environment.reset()
    for row in range(SLOTS):
        problem, needed = coverage_problem(environment, row, coverage_task(spec), 1)
        assert len(needed) == len(problem.normals) == 100 - environment.state.points["chief"].team_count[row]


def test_the_reach_of_a_step_is_thrust_by_time_over_mass(spec: EnvironmentSpec) -> None:
    np.testing.assert_allclose(_thrust_reach(TeamEnvironment(spec, 1)), 10.0 / 12.0)
