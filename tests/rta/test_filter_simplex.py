"""The switching filter: it holds, its ellipse is safe, and the delta-v limit latches the backup at the step itself."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.dynamics.cwh import propagate, transition
from safe_inspect.rta.constraints import RelativeState
from safe_inspect.rta.filters.backup.safety_filter import BackupFilter
from safe_inspect.rta.filters.simplex import SimplexFilter, SimplexMemory

N, MASS, DT = 0.001027, 12.0, 10.0


@pytest.fixture(scope="module")
def safe():
    return BackupFilter()


def starts(safe, seed, rows):
    generator = np.random.default_rng(seed)
    directions = generator.normal(size=(2, 8 * rows, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    state = RelativeState(
        directions[0] * generator.uniform(40.0, 120.0, (8 * rows, 1)),
        directions[1] * generator.uniform(0.0, 0.2, (8 * rows, 1)), generator.uniform(0.0, 2.0 * np.pi, 8 * rows),
    )  # fmt: skip
    good = (safe.phi(state) >= 0.0).all(axis=1) & safe.recoverable(state)
    return state[np.flatnonzero(good)[:rows]]


def flown(state, control):
    p, v = state.position.copy(), state.velocity.copy()
    propagate(p, v, np.ascontiguousarray(control), *transition(N, MASS, DT), p, v)
    return RelativeState(p, v, state.sun_angle + N * DT)


def test_its_ellipse_is_safe_forever(safe):
    simplex = SimplexFilter()
    position, velocity = simplex.ellipse(starts(safe, 1, 500))
    # where the deputy should be is on a closed natural motion without drift
    np.testing.assert_allclose(velocity[:, 1], -2.0 * N * position[:, 0], atol=1e-12)
    np.testing.assert_allclose(velocity[:, 0], 0.5 * N * position[:, 1], atol=1e-12)
    target = RelativeState(position, velocity, starts(safe, 1, 500).sun_angle)
    assert (safe.phi(target) >= 0.0).all()
    assert safe.admissible(target, np.zeros((500, 3))).all()


def test_the_regulator_reaches_the_ellipse(safe):
    simplex = SimplexFilter()
    state, memory = starts(safe, 2, 60), SimplexMemory.zeros(60)
    for _ in range(1200):
        result, memory = simplex(state, np.ones((60, 3)), memory)  # refused at every step: the backup flies
        assert result.backup.all()
        assert not result.infeasible.any()
        state = flown(state, result.control)
        assert (safe.phi(state) >= 0.0).all()
    position, velocity = simplex.ellipse(state)
    assert np.linalg.norm(state.position - position, axis=1).max() < 2.0
    assert np.linalg.norm(state.velocity - velocity, axis=1).max() < 0.01


def test_it_switches_only_where_the_desired_control_is_refused(safe):
    simplex = SimplexFilter()
    state = starts(safe, 3, 100)
    desired = np.random.default_rng(3).uniform(-0.3, 0.3, (100, 3))
    result, memory = simplex(state, desired, SimplexMemory.zeros(100))
    passed = safe.admissible(state, desired)
    assert 0.05 < passed.mean() < 0.95
    np.testing.assert_array_equal(result.backup, ~passed)
    np.testing.assert_array_equal(result.control[passed], desired[passed])
    assert (result.active[~passed] != 0).all()
    np.testing.assert_allclose(memory.delta_v, np.abs(result.control).sum(axis=1) * DT / MASS)


def test_it_holds_under_random_thrust(safe):
    simplex = SimplexFilter()
    state, memory = starts(safe, 4, 40), SimplexMemory.zeros(40)
    generator = np.random.default_rng(4)
    for _ in range(100):
        result, memory = simplex(state, generator.uniform(-1.0, 1.0, (40, 3)), memory)
        state = flown(state, result.control)
        assert (safe.phi(state) >= 0.0).all()
        assert not result.infeasible.any()


@pytest.mark.parametrize("size", [0.012, 1.0])
def test_an_episode_keeps_the_delta_v_limit_and_coasts_when_it_is_used_up(safe, size):
    """What is flown counts, not what is desired; the plan of each state is paid for before a control is flown."""
    limit = 0.4
    simplex = SimplexFilter(delta_v_limit=limit)
    state, memory = starts(safe, 5, 40), SimplexMemory.zeros(40)
    affordable = np.abs(safe.plans(state)[1]).sum(axis=1) * DT / MASS < limit
    assert affordable.sum() > 20
    state, memory = state[np.flatnonzero(affordable)], SimplexMemory.zeros(int(affordable.sum()))
    generator = np.random.default_rng(5)
    spent = np.zeros(len(state))
    for step in range(400):
        before = memory
        desired = size * generator.choice([-1.0, 1.0], state.position.shape)
        result, memory = simplex(state, desired, memory)
        assert not result.infeasible.any()
        assert result.backup[memory.latched].all()
        coasting = before.latched & (step > 0)
        flew = np.abs(result.control).sum(axis=1) * DT / MASS
        assert (flew[coasting] < 1e-9).all()
        spent += flew
        state = flown(state, result.control)
        assert (safe.phi(state) >= 0.0).all()
    np.testing.assert_allclose(memory.delta_v, spent)
    assert memory.latched.mean() > (0.9 if size < 0.1 else 0.2)
    assert spent.max() <= limit + 1e-6
    assert spent[memory.latched].mean() > 0.2 * limit


def test_a_row_does_not_depend_on_its_batch_and_the_memory_is_not_changed(safe):
    simplex = SimplexFilter(delta_v_limit=1.0)
    state = starts(safe, 6, 12)
    desired = np.random.default_rng(6).uniform(-1.0, 1.0, (12, 3))
    memory = SimplexMemory(np.linspace(0.0, 2.0, 12), np.arange(12) % 5 == 0)
    kept = memory.delta_v.copy()
    whole, _ = simplex(state, desired, memory)
    np.testing.assert_array_equal(memory.delta_v, kept)
    for i in range(12):
        part = SimplexMemory(memory.delta_v[i : i + 1], memory.latched[i : i + 1])
        alone, _ = simplex(state[i : i + 1], desired[i : i + 1], part)
        np.testing.assert_array_equal(alone.control[0], whole.control[i])


def test_bad_input_is_named(safe):
    state = starts(safe, 7, 3)
    with pytest.raises(ValueError, match="row 1 is not finite"):
        SimplexFilter()(state, np.array([[0.0] * 3, [np.nan] * 3, [0.0] * 3]), SimplexMemory.zeros(3))
