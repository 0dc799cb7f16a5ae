"""The team's filter flies the safe thrusts nearest to the desired ones: against a search with the exact test alone."""

from __future__ import annotations

import numpy as np
import pytest
from admissible import admissible
from team_safety import draw_teams

from safe_inspect.dynamics.cwh import propagate, transition
from safe_inspect.rta.team.safety_filter import TeamFilter, TeamState


def flown(run, state, control, time=10.0):
    """Return the states after holding the thrusts for a while."""
    p, v = state.position.reshape(-1, 3).copy(), state.velocity.reshape(-1, 3).copy()
    matrices = transition(float(run.alone.parameters.n), float(run.alone.parameters.m), time)
    propagate(p, v, control.reshape(-1, 3).copy(), *matrices, p, v)
    shape = state.position.shape
    return TeamState(p.reshape(shape), v.reshape(shape), state.sun_angle + run.alone.parameters.n * time)


def apart(one, other):
    return np.sqrt(np.square(one - other).sum(axis=(-1, -2)))


def nearest_found(run, state, desired, start, rounds=30, tries=16):
    """Return the nearest thrusts that steps of random directions lead to, from admissible ones; the exact test decides.

    Steps grow where one gains and shrink where none does.
    """
    generator, limit = np.random.default_rng(0), float(run.alone.parameters.u_max)
    best, step = start.copy(), np.full(len(start), 0.3 * limit)
    each = TeamState(*(np.repeat(part, tries, axis=0) for part in (state.position, state.velocity, state.sun_angle)))
    for _ in range(rounds):
        gap = (desired - best)[:, None]
        away = generator.normal(size=(len(best), tries, *best.shape[1:]))
        away[:, :1] = gap
        away *= np.where((away * gap).sum(axis=(-1, -2), keepdims=True) < 0.0, -1.0, 1.0)
        away /= np.sqrt(np.square(away).sum(axis=(-1, -2), keepdims=True)) + 1e-12
        length = np.minimum(step, apart(desired, best))
        trial = np.clip(best[:, None] + length[:, None, None, None] * away, -limit, limit)
        safe = admissible(run, each, trial.reshape(-1, *best.shape[1:])).reshape(len(best), tries)
        left = np.where(safe, apart(trial, desired[:, None]), np.inf)
        choice, gained = left.argmin(axis=1), left.min(axis=1) < apart(best, desired) - 1e-6
        best[gained] = trial[gained, choice[gained]]
        step = np.where(gained, 1.2 * step, 0.5 * step)
    return best


@pytest.mark.parametrize("deputies", [1, 2])
def test_what_is_flown_is_the_nearest_but_for_few(deputies):
    """Random thrusts of any size, most of which the constraints refuse at some moment of the hold."""
    run, rows = TeamFilter(), 120
    state, plan = draw_teams(run, rows, deputies, seed=5), None
    generator, short = np.random.default_rng(1), []
    for _ in range(3):
        desired = np.clip(generator.normal(size=state.position.shape), -1.0, 1.0)
        result = run(state, desired, plan)
        found = nearest_found(run, state, desired, result.control)
        assert admissible(run, state, result.control).all()
        short.append(apart(result.control, desired) - apart(found, desired))
        state, plan = flown(run, state, result.control), result.plan
    short = np.concatenate(short)
    assert (short < 0.01).mean() > 0.95  # [N]
    assert short.mean() < 0.01


@pytest.mark.parametrize("deputies", [1, 2])
def test_where_a_deputy_would_have_no_plan_alone_the_backup_is_not_all_that_is_found(deputies):
    """Weak thrusters: the hold of the desired thrusts is safe, but then a deputy has no plan, whatever others do."""
    run = TeamFilter({"m": 30.0, "u_max": 0.6})
    state = draw_teams(run, 6000, deputies, seed=5)
    desired = np.clip(0.42 * np.random.default_rng(2).normal(size=state.position.shape), -0.6, 0.6)
    chosen = np.ones(len(state), bool)
    for second in range(1, 11):
        for phi in run.phi(flown(run, state, desired, float(second))).values():
            chosen &= phi > 0.02
    after = flown(run, state, desired)
    chosen &= ~np.all([run.alone.recoverable(after.alone(i)) for i in range(deputies)], axis=0)
    state, desired = state[chosen], desired[chosen]
    assert len(state) >= 12
    result = run(state, desired)
    assert not result.infeasible.any()
    nearest = ~result.backup
    assert nearest.mean() > 0.15
    found = nearest_found(run, state[nearest], desired[nearest], result.control[nearest])
    short = apart(result.control, desired)[nearest] - apart(found, desired[nearest])
    assert np.median(short) < 0.2
    _, backup, _ = run.plans(state[nearest])
    assert (apart(result.control[nearest], desired[nearest]) < apart(backup, desired[nearest])).all()
