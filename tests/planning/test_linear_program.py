"""The dual simplex method finds the optimum that SciPy's solver finds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import linprog

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.evaluation.optimiser import coverage_problem, coverage_task
from safe_inspect.planning.coverage_problem import CoverageProblem
from safe_inspect.planning.coverage_search import burns_of
from safe_inspect.planning.linear_program import LinearProgram, linear_program, set_row, solve
from safe_inspect.types import FloatArray, IntArray

BEGIN = np.arange(0, 1224, 24)


@pytest.fixture(scope="module")
def problems(spec: EnvironmentSpec) -> list[CoverageProblem]:
    environment = TeamEnvironment(spec, 6, seed=4)
    environment.reset()
    return [coverage_problem(environment, row, coverage_task(spec), 1)[0] for row in range(6)]


def looks_at(problem: CoverageProblem, generator: np.random.Generator, points: int) -> tuple[IntArray, IntArray]:
    """Return some points, and a step at which each is lit."""
    chosen = generator.permutation(len(problem.normals))[:points]
    return chosen, np.array([generator.choice(np.flatnonzero(problem.lit[1:, p])) + 1 for p in chosen])


def asked(problem: CoverageProblem, chosen: IntArray, steps: IntArray) -> LinearProgram:
    program = linear_program(BEGIN, len(chosen), 48)
    for row, (point, step) in enumerate(zip(chosen, steps, strict=True)):
        set_row(problem, program, row, problem.normals[point], int(step), problem.radius)
    return program


def optimum(problem: CoverageProblem, chosen: IntArray, steps: IntArray) -> float:
    """Return the optimum by SciPy [m/s], infinite when there is none; rows and columns are written out here again."""
    matrix = np.zeros((len(chosen), len(BEGIN), 3))
    for row, (point, step) in enumerate(zip(chosen, steps, strict=True)):
        for column, begin in enumerate(BEGIN):
            if begin < step:
                matrix[row, column] = problem.normals[point] @ problem.impulse_response[step - begin]
    flat = matrix.reshape(len(chosen), -1)
    bound = problem.radius - (problem.normals[chosen] * problem.coast[steps]).sum(axis=1)
    found = linprog(np.ones(2 * flat.shape[1]), A_ub=-np.hstack((flat, -flat)), b_ub=-bound, method="highs")
    return float(found.fun) if found.status == 0 else math.inf


@pytest.mark.parametrize("points", [1, 3, 10, 80])
def test_the_optimum_is_that_of_another_solver(problems: list[CoverageProblem], points: int) -> None:
    generator = np.random.default_rng(points)
    for problem in problems:
        chosen, steps = looks_at(problem, generator, min(points, len(problem.normals)))
        cost, _ = solve(problem, asked(problem, chosen, steps), len(chosen), 0, math.inf)
        assert cost == pytest.approx(optimum(problem, chosen, steps), rel=1e-5, abs=1e-9)


def heights(
    problem: CoverageProblem, program: LinearProgram, size: int, chosen: IntArray, steps: IntArray
) -> FloatArray:
    """Return how high above the centre, along each point's normal, the deputy is when it looks [m]."""
    start, delta_v = np.zeros(48, np.int64), np.zeros((48, 3))
    count = burns_of(program, size, start, delta_v)
    assert (np.diff(start[:count]) > 0).all()
    position = problem.coast[steps].copy()
    for k in range(count):
        for row, step in enumerate(steps):
            if step > start[k]:
                position[row] += problem.impulse_response[step - start[k]] @ delta_v[k]
    return np.asarray((problem.normals[chosen] * position).sum(axis=1))


def test_rows_that_are_added_are_met_and_only_add_to_the_cost(problems: list[CoverageProblem]) -> None:
    generator = np.random.default_rng(11)
    for problem in problems:
        chosen, steps = looks_at(problem, generator, 20)
        program, size, before = asked(problem, chosen, steps), 0, 0.0
        for rows in (5, 12, 20):
            cost, size = solve(problem, program, rows, size, math.inf)
            assert cost >= before - 1e-9
            before = cost
            assert (heights(problem, program, size, chosen[:rows], steps[:rows]) >= problem.radius - 1e-6).all()
        assert before == pytest.approx(optimum(problem, chosen, steps), rel=1e-5, abs=1e-9)


def test_a_bar_breaks_the_solution_off(problems: list[CoverageProblem]) -> None:
    chosen, steps = looks_at(problems[0], np.random.default_rng(5), 30)
    cost, _ = solve(problems[0], asked(problems[0], chosen, steps), 30, 0, math.inf)
    assert cost > 0.0
    assert not solve(problems[0], asked(problems[0], chosen, steps), 30, 0, 0.99 * cost)[0] < math.inf
    assert solve(problems[0], asked(problems[0], chosen, steps), 30, 0, 1.01 * cost)[0] < math.inf


def test_no_thrust_across_the_plane_leaves_the_poles(problems: list[CoverageProblem]) -> None:
    answer = problems[0].impulse_response.copy()
    answer[:, 2, 2] = 0.0
    coast = problems[0].coast.copy()
    coast[:, 2] = 0.0
    problem = problems[0]._replace(impulse_response=answer, coast=coast)
    pole = int(np.argmax(problem.slopes[:, 1]))
    normals = problem.normals.copy()
    normals[pole] = (0.0, 0.0, 1.0)
    problem = problem._replace(normals=normals)
    chosen, steps = np.array([pole]), np.array([600])
    assert not solve(problem, asked(problem, chosen, steps), 1, 0, math.inf)[0] < math.inf
    assert optimum(problem, chosen, steps) == math.inf
