"""Limon's programme: its optimum against an oracle, and its properties on his double integrator."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog, minimize

from safe_inspect.rendezvous.control.gains import TrackingWeights
from safe_inspect.rendezvous.control.mpc import TrackingQP
from safe_inspect.rendezvous.control.tightening import AxisLimits
from safe_inspect.rendezvous.control.tube import Axis

AXIS = Axis(9.583788668)
LIMITS = AxisLimits(np.array([-0.06, -0.03]), np.array([0.1, 0.04]), -0.05, 0.08)

# The double integrator of Limon et al. 2008 (with one input): |x| <= 5, |u| <= 0.3, Q = I, R = I.
A, B = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([0.5, 1.0])
WEIGHTS = TrackingWeights(1.0, 1.0, 1.0, 1e4)
BOX = AxisLimits(np.full(2, -5.0), np.full(2, 5.0), -0.3, 0.3)


def shifted(limits: AxisLimits, target: float) -> AxisLimits:
    """Return limits of the error about a position that shall be reached."""
    offset = np.array([target, 0.0])
    return AxisLimits(limits.lower - offset, limits.upper - offset, limits.least_force, limits.largest_force)


def oracle(programme: TrackingQP, state: np.ndarray, limits: AxisLimits) -> float | None:
    """Return the optimal cost by SciPy's SLSQP, or None where linear programming finds no feasible point."""
    right, lower, upper, least, largest = programme.bounds(state, limits)
    matrix = programme.inequalities
    feasible = linprog(
        np.zeros(matrix.shape[1]),
        A_ub=np.vstack((matrix, -matrix)),
        b_ub=np.concatenate((upper, -lower)),
        A_eq=programme.equalities,
        b_eq=right,
        bounds=list(zip(least, largest, strict=True)),
    )
    if feasible.status == 2:
        return None
    scale = 1e-2
    result = minimize(
        lambda x: scale * 0.5 * x @ programme.cost @ x,
        feasible.x,
        jac=lambda x: scale * programme.cost @ x,
        method="SLSQP",
        bounds=[(lo if lo > -1e30 else None, hi if hi < 1e30 else None) for lo, hi in zip(least, largest, strict=True)],
        constraints=[
            {"type": "eq", "fun": lambda x: programme.equalities @ x - right, "jac": lambda x: programme.equalities},
            {
                "type": "ineq",
                "fun": lambda x: np.concatenate((upper - matrix @ x, matrix @ x - lower)),
                "jac": lambda x: np.vstack((-matrix, matrix)),
            },
        ],
        options={"maxiter": 500, "ftol": 1e-13},
    )
    return float(result.fun / scale)


def test_the_optimum_agrees_with_an_oracle():
    programme = TrackingQP(AXIS.A, AXIS.B, 10)
    generator = np.random.default_rng(0)
    solved = refused = 0
    for _ in range(25):
        state = generator.uniform(-1.0, 1.0, 2) * [0.08, 0.03]
        solution, expected = programme.solve(state, LIMITS), oracle(programme, state, LIMITS)
        assert (solution is None) == (expected is None)
        if solution is None or expected is None:
            refused += 1
            continue
        solved += 1
        x = np.concatenate((solution.states[0], solution.forces, [solution.steady]))
        assert 0.5 * x @ programme.cost @ x == pytest.approx(expected, rel=1e-5, abs=1e-7)
    assert solved >= 5
    assert refused >= 1


def test_a_solution_obeys_the_model_and_the_limits():
    programme = TrackingQP(AXIS.A, AXIS.B, 20)
    solution = programme.solve(np.array([0.05, 0.01]), LIMITS)
    assert solution is not None
    states, forces = solution.states, solution.forces
    np.testing.assert_allclose(states[1:], states[:-1] @ AXIS.A.T + forces[:, None] * AXIS.B, atol=1e-12)
    np.testing.assert_allclose(states[0], (0.05, 0.01), atol=1e-8)
    np.testing.assert_allclose(states[-1], (solution.steady, 0.0), atol=1e-8)
    assert np.all(states[1:] <= LIMITS.upper + 1e-7)
    assert np.all(states[1:] >= LIMITS.lower - 1e-7)
    assert np.all((forces <= LIMITS.largest_force + 1e-7) & (forces >= LIMITS.least_force - 1e-7))


def test_an_optimal_rest_is_zero():
    solution = TrackingQP(AXIS.A, AXIS.B).solve(np.zeros(2), LIMITS)
    assert solution is not None
    np.testing.assert_allclose(solution.forces, 0.0, atol=1e-8)


def test_a_later_problem_does_not_overwrite_a_solution():
    programme = TrackingQP(AXIS.A, AXIS.B)
    first = programme.solve(np.array([0.03, 0.0]), LIMITS)
    kept = first.forces.copy()
    programme.solve(np.array([-0.03, 0.01]), LIMITS)
    np.testing.assert_array_equal(first.forces, kept)


def test_empty_limits_have_no_solution():
    empty = AxisLimits(np.array([0.1, -1.0]), np.array([-0.1, 1.0]), -1.0, 1.0)
    assert TrackingQP(AXIS.A, AXIS.B).solve(np.zeros(2), empty) is None


def test_limons_double_integrator_starts_where_regulation_to_the_target_cannot():
    """A short horizon reaches no far target, but some steady state: that is what the artificial one is for."""
    programme = TrackingQP(A, B, 5, WEIGHTS)
    start, target = np.array([-4.5, 0.0]), 4.5
    to_the_target = AxisLimits(np.full(2, -5.0), np.full(2, 5.0), -0.3, 0.3)
    states = np.linalg.matrix_power(A, 5) @ (start - [target, 0.0])
    reach = 0.3 * sum(abs((np.linalg.matrix_power(A, k) @ B)[0]) for k in range(5))
    assert abs(states[0]) > reach  # no sequence of five inputs ends there
    assert programme.solve(start - [target, 0.0], shifted(to_the_target, target)) is not None


def fly(programme: TrackingQP, state: np.ndarray, target: float, steps: int) -> np.ndarray:
    """Return the states of the closed loop, shape (steps + 1, 2); every step must have a solution."""
    states = [state]
    for _ in range(steps):
        solution = programme.solve(states[-1] - [target, 0.0], shifted(BOX, target))
        assert solution is not None
        assert abs(solution.forces[0]) <= 0.3 + 1e-7
        states.append(A @ states[-1] + B * solution.forces[0])
        assert np.abs(states[-1]).max() <= 5.0 + 1e-6
    return np.array(states)


def test_limons_double_integrator_follows_targets_that_change():
    programme = TrackingQP(A, B, 5, WEIGHTS)
    state = np.array([-4.0, 0.0])
    for target in (4.5, -3.0, 0.0):
        state = fly(programme, state, target, 60)[-1]
        np.testing.assert_allclose(state, (target, 0.0), atol=1e-3)


def test_limons_double_integrator_settles_next_to_a_target_out_of_reach():
    last = fly(TrackingQP(A, B, 5, WEIGHTS), np.array([0.0, 0.0]), 7.0, 60)[-1]
    np.testing.assert_allclose(last, (5.0, 0.0), atol=5e-3)


def test_feasible_once_feasible_forever():
    programme = TrackingQP(AXIS.A, AXIS.B, 20)
    generator = np.random.default_rng(4)
    refused = 0
    for _ in range(20):
        state = generator.uniform(-1.0, 1.0, 2) * [0.1, 0.035]
        for k in range(30):
            solution = programme.solve(state, LIMITS)
            if solution is None:
                assert k == 0
                refused += 1
                break
            state = solution.states[1]
    assert refused < 20
