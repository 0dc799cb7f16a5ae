"""Tubes: their certificates, and errors that never leave them whatever the disturbance."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.rendezvous.control.axis import Axis
from safe_inspect.rendezvous.control.gains import best_tube, candidate_gains, clearance_margin, lqr_gain, natural_gain
from safe_inspect.rendezvous.control.tube import (
    AxisBound,
    certificate,
    invariant_set,
    invariant_tube,
    jump_certificate,
    jump_sets,
    jump_tube,
    truth_disturbance,
    truth_set,
    truth_tube,
)
from safe_inspect.rendezvous.control.zonotope import Zonotope

AXIS = Axis(9.583788668)
STEPS = 301
PROCESS = np.array([5e-6, 5e-5])


def falling(first: float, last: float) -> np.ndarray:
    return np.linspace(first, last, STEPS)


@pytest.fixture
def bound() -> AxisBound:
    """The bounds of an approach with errors of 0.7 degrees and 0.07 degrees per second."""
    return AxisBound(
        falling(0.072, 0.025), falling(7.2e-3, 2e-3), falling(4.8e-3, 1.4e-3), PROCESS, np.array([0.012, 0.0015]), 5
    )


def worst_gauge(sets, closed_loop, disturbances, jumps, steps: int, rows: int = 500) -> float:
    """Return the largest gauge of errors under random, vertex and greedy disturbances.

    Args:
        sets: Z_0 .. Z_{p-1}.
        closed_loop: A_K.
        disturbances: W, at each step.
        jumps: W_u, added each p-th step; None for none.
        steps: Steps of each row.
        rows: Rows of each of the three kinds.
    """
    generator = np.random.default_rng(5)
    error, worst = np.zeros((3 * rows, 2)), 0.0
    vertex, greedy = slice(rows, 2 * rows), slice(2 * rows, None)  # the first rows: random

    def draw(w: Zonotope, images: np.ndarray, target: Zonotope) -> np.ndarray:
        coefficients = generator.uniform(-1.0, 1.0, (3 * rows, len(w.generators)))
        coefficients[vertex] = np.sign(coefficients[vertex])
        # greedy: outward along the facet that the image is nearest to; some rows along a fixed facet
        ratios = images[greedy] @ target.normals.T / target.offsets
        facet = np.abs(ratios).argmax(axis=1)
        fixed = np.arange(rows) % 2 == 0
        facet[fixed] = np.arange(rows)[fixed] % len(target.normals)
        signs = np.where(ratios[np.arange(rows), facet] >= 0.0, 1.0, -1.0)
        coefficients[greedy] = signs[:, None] * np.sign(target.normals[facet] @ w.generators.T)
        return coefficients @ w.generators

    for k in range(1, steps + 1):
        target = sets[k % len(sets)]
        error = error @ closed_loop.T
        error = error + draw(disturbances, error, target)
        if jumps is not None and k % len(sets) == 0:
            error = error + draw(jumps, error, target)
        worst = max(worst, float(target.gauge(error).max()))
    return worst


@pytest.mark.parametrize("frequency", [0.15, 0.22, 0.5, 1.0])
def test_both_tubes_are_certified(bound, frequency):
    gain = natural_gain(AXIS, frequency, 0.9)
    assert invariant_tube(AXIS, gain, bound).certificate <= 1.0 + 1e-9
    assert jump_tube(AXIS, gain, bound).certificate <= 1.0 + 1e-9


def test_the_invariant_set_is_nearly_the_least_one():
    """By the bound 1 / (1 - alpha): between the sum of many terms and that."""
    closed_loop, w = AXIS.closed_loop(natural_gain(AXIS, 0.3, 0.9)), Zonotope.box((1e-3, 1e-3))
    least = sum(w.mapped(np.linalg.matrix_power(closed_loop, k)).support(np.eye(2)) for k in range(2000))
    found = invariant_set(closed_loop, w, 0.02).support(np.eye(2))
    assert np.all(found >= least * (1.0 - 1e-12))
    assert np.all(found <= least / 0.98)


def test_a_set_that_is_too_small_is_not_certified(bound):
    gain = natural_gain(AXIS, 0.3, 0.9)
    tube, w = truth_set(AXIS, gain, bound), truth_disturbance(AXIS, gain, bound)
    least = invariant_set(AXIS.closed_loop(gain), w)
    assert certificate(AXIS.closed_loop(gain), least.scaled(0.9), w) > 1.0
    assert certificate(AXIS.closed_loop(gain), tube.scaled(2.0), w) < 1.0


def test_a_disturbance_without_interior_is_refused(bound):
    with pytest.raises(ValueError, match="give a process bound > 0"):
        invariant_set(AXIS.closed_loop(natural_gain(AXIS, 0.3, 0.9)), Zonotope(np.array([[0.0, 1e-3]])))


def test_the_truth_set_holds_the_box_of_errors(bound):
    gain = natural_gain(AXIS, 1.0, 0.8)
    errors = Zonotope.box((bound.position.max(), bound.velocity.max()))
    assert truth_set(AXIS, gain, bound).inclusion(errors) <= 1.0 + 1e-12


@pytest.mark.parametrize("steps", [70, pytest.param(400, marks=pytest.mark.slow)])
@pytest.mark.parametrize("frequency", [0.3, 0.7])
def test_no_disturbance_leaves_the_truth_set(bound, frequency, steps):
    gain = natural_gain(AXIS, frequency, 0.9)
    closed_loop, w = AXIS.closed_loop(gain), truth_disturbance(AXIS, gain, bound)
    worst = worst_gauge([truth_set(AXIS, gain, bound)], closed_loop, w, None, steps)
    assert worst <= 1.0
    assert worst >= (0.5 if steps < 100 else 0.7)


@pytest.mark.parametrize("steps", [70, pytest.param(400, marks=pytest.mark.slow)])
@pytest.mark.parametrize("frequency", [0.5, 0.9])
def test_no_disturbance_leaves_the_jump_sets(bound, frequency, steps):
    gain = natural_gain(AXIS, frequency, 0.9)
    sets = jump_sets(AXIS, gain, bound)
    w, jumps = Zonotope.box(PROCESS), Zonotope.box(bound.jump)
    worst = worst_gauge(sets, AXIS.closed_loop(gain), w, jumps, steps)
    assert jump_certificate(AXIS, gain, bound, sets) <= 1.0 + 1e-9
    assert 0.8 <= worst <= 1.0


@pytest.mark.parametrize("frequency", [0.25, np.linspace(0.25, 0.5, STEPS)])
def test_the_time_varying_tube_has_the_supports_of_its_sets(bound, frequency):
    tube = truth_tube(AXIS, natural_gain(AXIS, frequency, 0.9), bound)
    held = Zonotope.box((bound.position[0], bound.velocity[0]))
    for k in range(60):
        gain = tube.gain_at(k)
        closed_loop = AXIS.closed_loop(gain)
        directions = np.array([[1.0, 0.0], [0.0, 1.0], gain])
        position, velocity, force = held.support(directions)
        assert tube.clearance[k] == pytest.approx(position, rel=1e-9)
        assert tube.position[k] == pytest.approx(position + bound.position[k], rel=1e-9)
        assert tube.velocity[k] == pytest.approx(velocity + bound.velocity[k], rel=1e-9)
        assert tube.force[k] == pytest.approx(force + bound.feedback(gain)[k], rel=1e-9)
        held = (held.mapped(closed_loop) + truth_disturbance(AXIS, gain, bound, k)).merged()


@pytest.mark.parametrize("frequency", [0.22, np.linspace(0.22, 0.6, STEPS)])
def test_errors_stay_inside_the_time_varying_tube(bound, frequency):
    """Also long after its last step, with bounds as at the last."""
    tube = truth_tube(AXIS, natural_gain(AXIS, frequency, 0.9), bound)
    generator = np.random.default_rng(8)
    rows = 300
    error = generator.choice([-1.0, 1.0], (rows, 2)) * [bound.position[0], bound.velocity[0]]
    b_k = np.stack((bound.position, bound.velocity), axis=1)
    sign = generator.choice([-1.0, 1.0], (rows, 1))
    for step in range(2 * STEPS):
        k = min(step, STEPS - 1)
        assert np.abs(error[:, 0]).max() <= tube.clearance[k] * (1.0 + 1e-9)
        gain = tube.gain_at(step)
        closed_loop = AXIS.closed_loop(gain)
        flips = generator.uniform(size=(rows, 1)) < np.linspace(0.0, 0.3, rows)[:, None]
        sign = np.where(flips, -sign, sign)
        delta = -sign * np.sign(gain) * b_k[k]
        force = -delta @ gain + sign[:, 0] * bound.force[k]
        error = error @ closed_loop.T + force[:, None] * AXIS.B + sign * PROCESS


def test_the_time_varying_tube_lies_within_the_constant_one(bound):
    gain = natural_gain(AXIS, 0.22, 0.9)
    varying, constant = truth_tube(AXIS, gain, bound), invariant_tube(AXIS, gain, bound)
    assert varying.clearance.max() <= constant.clearance.max()
    assert varying.force.max() <= constant.force.max() + 1e-12


def test_more_error_makes_a_wider_tube(bound):
    gain = natural_gain(AXIS, 0.22, 0.9)
    more = AxisBound(2.0 * bound.position, bound.velocity, bound.force, bound.process, bound.jump)
    assert np.all(truth_tube(AXIS, gain, more).clearance >= truth_tube(AXIS, gain, bound).clearance)


def test_the_gain_search_keeps_a_reserve_and_says_when_there_is_none(bound):
    tube, reserve = best_tube(AXIS, bound, np.full(STEPS, 0.2))
    assert reserve.min() >= 0.0
    assert clearance_margin(tube).max() < 0.25
    np.testing.assert_allclose(reserve, 0.2 - tube.force, rtol=1e-12)
    _, more = best_tube(AXIS, bound, np.full(STEPS, 0.2), wanted=0.05)
    assert more.min() >= 0.05
    none, lacking = best_tube(AXIS, bound, np.full(STEPS, 0.02))
    assert lacking.min() < 0.0
    assert none.force.max() < tube.force.max()


def test_stiffening_gains_narrow_the_end_within_the_same_force(bound):
    constant, _ = best_tube(AXIS, bound, np.full(STEPS, 0.2), tuple(candidate_gains(AXIS)))
    stiffening, reserve = best_tube(AXIS, bound, np.full(STEPS, 0.2))
    assert stiffening.gain.shape == (STEPS, 2)
    assert reserve.min() >= 0.0
    assert stiffening.clearance[-1] < 0.9 * constant.clearance[-1]
    assert stiffening.clearance.max() < 1.05 * constant.clearance.max()


def test_the_regulator_is_stable_and_solves_the_riccati_equation():
    gain = lqr_gain(AXIS)
    closed_loop = AXIS.closed_loop(gain)
    assert np.abs(np.linalg.eigvals(closed_loop)).max() < 1.0
    q, r, b = np.diag((400.0, 1.0 / 0.03**2)), 100.0, AXIS.B[:, None]
    cost = np.zeros((2, 2))
    for _ in range(3000):
        step = np.linalg.solve(r + b.T @ cost @ b, b.T @ cost @ AXIS.A)
        cost = q + AXIS.A.T @ cost @ (AXIS.A - b @ step)
    np.testing.assert_allclose(gain, -step[0], rtol=1e-9)
