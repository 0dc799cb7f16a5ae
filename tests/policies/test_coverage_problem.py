"""The positions and the inspected points of a plan, as the optimiser computes them, are the simulator's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.evaluation.optimiser import coverage_problem, coverage_task
from safe_inspect.policies.open_loop import OpenLoopPlan
from safe_inspect.policies.plan_record import flight_plan
from safe_inspect.policies.plan_refinement import _path

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
    delta_v = np.zeros((SLOTS, task.horizon, 3))
    for row in range(SLOTS):
        for start in 8 * generator.choice(STEPS // 8 - 5, 5, replace=False):
            delta_v[row, start : start + hold] += generator.uniform(-0.04, 0.04, 3) / hold
    plans = [flight_plan(changes * world.masses[0] / world.step_size) for changes in delta_v]
    pilot = OpenLoopPlan.of(zip(environment.state.key.tolist(), plans, strict=True))
    flown = TeamEnvironment(
        replace(spec, agents=tuple(replace(agent, scripted_policy=pilot, dones=()) for agent in spec.agents)),
        SLOTS,
        seed=seed,
    )
    flown.reset()
    problems = [coverage_problem(environment, row, task) for row in range(SLOTS)]
    maps = problems[0][0].maps
    response = np.zeros((task.horizon + 1, 3, 3))
    response[1:] = maps.phi[:-1, :3] @ maps.gamma[1] / maps.step_size
    positions = [_path(maps.phi[:, :3] @ problems[row][1], response, delta_v[row]) for row in range(SLOTS)]
    for step in range(1, STEPS + 1):
        flown.step(())
        for row, (problem, _) in enumerate(problems):
            np.testing.assert_allclose(flown.state.position[row, 0], positions[row][step], rtol=0.0, atol=1e-8)
            path = positions[row][1 : step + 1]
            far_enough = (path**2).sum(axis=-1)[:, None] >= problem.radius**2
            heights = path @ problem.points.T / problem.radius
            seen = ((heights >= problem.radius) & problem.lit[1 : step + 1] & far_enough).any(axis=0)
            inspected = flown.state.points["chief"].inspector[row] >= 0
            np.testing.assert_array_equal(inspected[problem.needed], seen[problem.needed])
    np.testing.assert_allclose(flown.state.delta_v[:, 0], np.abs(delta_v).sum(axis=(1, 2)), rtol=1e-12)


def test_only_points_that_are_left_after_the_reset_are_asked_for(spec: EnvironmentSpec) -> None:
    environment = TeamEnvironment(spec, SLOTS, seed=2)
    environment.reset()
    for row in range(SLOTS):
        problem, _ = coverage_problem(environment, row, coverage_task(spec))
        assert problem.needed.sum() == 100 - environment.state.points["chief"].team_count[row]
        np.testing.assert_allclose(problem.reach, 10.0 / 12.0)  # thrust by time over mass
