"""The dual simplex method finds the optimum that SciPy's solver finds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import linprog

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.planning.course import Course
from safe_inspect.planning.descent import burns_of
from safe_inspect.planning.programme import Programme, programme, set_row, solve
from safe_inspect.planning.task import course_of, demands_of
from safe_inspect.types import FloatArray, IntArray

BEGIN = np.arange(0, 1224, 24)


@pytest.fixture(scope="module")
def courses(spec: EnvironmentSpec) -> list[Course]:
    environment = TeamEnvironment(spec, 6, seed=4)
    environment.reset()
    return [course_of(environment, row, demands_of(spec), 1)[0] for row in range(6)]


def looks_at(course: Course, generator: np.random.Generator, points: int) -> tuple[IntArray, IntArray]:
    """Return some points, and a step at which each is lit."""
    chosen = generator.permutation(len(course.normals))[:points]
    return chosen, np.array([generator.choice(np.flatnonzero(course.lit[1:, p])) + 1 for p in chosen])


def asked(course: Course, chosen: IntArray, steps: IntArray) -> Programme:
    work = programme(BEGIN, len(chosen), 48)
    for row, (point, step) in enumerate(zip(chosen, steps, strict=True)):
        set_row(course, work, row, course.normals[point], int(step), course.radius)
    return work


def optimum(course: Course, chosen: IntArray, steps: IntArray) -> float:
    """Return the optimum by SciPy [m/s], infinite when there is none; rows and columns are written out here again."""
    matrix = np.zeros((len(chosen), len(BEGIN), 3))
    for row, (point, step) in enumerate(zip(chosen, steps, strict=True)):
        for column, begin in enumerate(BEGIN):
            if begin < step:
                matrix[row, column] = course.normals[point] @ course.answer[step - begin]
    flat = matrix.reshape(len(chosen), -1)
    bound = course.radius - (course.normals[chosen] * course.coast[steps]).sum(axis=1)
    found = linprog(np.ones(2 * flat.shape[1]), A_ub=-np.hstack((flat, -flat)), b_ub=-bound, method="highs")
    return float(found.fun) if found.status == 0 else math.inf


@pytest.mark.parametrize("points", [1, 3, 10, 80])
def test_the_optimum_is_that_of_another_solver(courses: list[Course], points: int) -> None:
    generator = np.random.default_rng(points)
    for course in courses:
        chosen, steps = looks_at(course, generator, min(points, len(course.normals)))
        found = solve(course, asked(course, chosen, steps), len(chosen), 0, math.inf)
        assert found.solved
        assert found.cost == pytest.approx(optimum(course, chosen, steps), rel=1e-5, abs=1e-9)


def heights(course: Course, work: Programme, size: int, chosen: IntArray, steps: IntArray) -> FloatArray:
    """Return how high above the centre, along each point's normal, the deputy is when it looks [m]."""
    start, delta_v = np.zeros(48, np.int64), np.zeros((48, 3))
    count = burns_of(work, size, start, delta_v)
    assert (np.diff(start[:count]) > 0).all()
    position = course.coast[steps].copy()
    for k in range(count):
        for row, step in enumerate(steps):
            if step > start[k]:
                position[row] += course.answer[step - start[k]] @ delta_v[k]
    return np.asarray((course.normals[chosen] * position).sum(axis=1))


def test_rows_that_are_added_are_met_and_only_add_to_the_cost(courses: list[Course]) -> None:
    generator = np.random.default_rng(11)
    for course in courses:
        chosen, steps = looks_at(course, generator, 20)
        work, size, before = asked(course, chosen, steps), 0, 0.0
        for rows in (5, 12, 20):
            found = solve(course, work, rows, size, math.inf)
            size = found.size
            assert found.cost >= before - 1e-9
            before = found.cost
            assert (heights(course, work, size, chosen[:rows], steps[:rows]) >= course.radius - 1e-6).all()
        assert before == pytest.approx(optimum(course, chosen, steps), rel=1e-5, abs=1e-9)


def test_a_bar_breaks_the_solution_off(courses: list[Course]) -> None:
    chosen, steps = looks_at(courses[0], np.random.default_rng(5), 30)
    cost = solve(courses[0], asked(courses[0], chosen, steps), 30, 0, math.inf).cost
    assert cost > 0.0
    assert not solve(courses[0], asked(courses[0], chosen, steps), 30, 0, 0.99 * cost).solved
    assert solve(courses[0], asked(courses[0], chosen, steps), 30, 0, 1.01 * cost).solved


def test_no_thrust_across_the_plane_leaves_the_poles(courses: list[Course]) -> None:
    answer = courses[0].answer.copy()
    answer[:, 2, 2] = 0.0
    coast = courses[0].coast.copy()
    coast[:, 2] = 0.0
    course = courses[0]._replace(answer=answer, coast=coast)
    pole = int(np.argmax(course.slopes[:, 1]))
    normals = course.normals.copy()
    normals[pole] = (0.0, 0.0, 1.0)
    course = course._replace(normals=normals)
    chosen, steps = np.array([pole]), np.array([600])
    assert not solve(course, asked(course, chosen, steps), 1, 0, math.inf).solved
    assert optimum(course, chosen, steps) == math.inf
