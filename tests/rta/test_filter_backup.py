"""The filter that holds: what it certifies against dense samples, and that nothing is broken under adversaries."""

from __future__ import annotations

import numpy as np
import pytest
from admissible import admissible

from safe_inspect.dynamics.cwh import propagate, transition
from safe_inspect.rta.audit import Audit, fly_filtered
from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.constraints import NAMES, RelativeState
from safe_inspect.rta.constraints.rows import Margins
from safe_inspect.rta.constraints.speeds import CrossTrackSpeed
from safe_inspect.rta.continuous import ContinuousFilter

N, MASS, DT = 0.001027, 12.0, 10.0
PERIOD = 2.0 * np.pi / N
KINDS = 6


@pytest.fixture(scope="module")
def run():
    return BackupFilter()


def drawn(seed, rows, nearest=50.0, farthest=100.0, fastest=0.3):
    generator = np.random.default_rng(seed)
    directions = generator.normal(size=(2, rows, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return RelativeState(
        directions[0] * generator.uniform(nearest, farthest, (rows, 1)),
        directions[1] * generator.uniform(0.0, fastest, (rows, 1)),
        generator.uniform(0.0, 2.0 * np.pi, rows),
    )


def safe_starts(run, seed, rows, nearest=50.0, farthest=100.0, fastest=0.3):
    """Draw states in which every constraint is safe and from which there is a plan."""
    state = drawn(seed, 8 * rows, nearest, farthest, fastest)
    good = (run.phi(state) >= 0.0).all(axis=1) & run.recoverable(state)
    return state[np.flatnonzero(good)[:rows]]


def flown(state, control, time, mass=MASS):
    """Return the states after holding the control for a while."""
    p, v = state.position.copy(), state.velocity.copy()
    propagate(p, v, np.ascontiguousarray(control), *transition(N, mass, time), p, v)
    return RelativeState(p, v, state.sun_angle + N * time)


def adversaries(state, step, generator):
    kind = np.arange(len(state)) % KINDS
    r = np.linalg.norm(state.position, axis=1, keepdims=True)
    axis = np.stack((-np.cos(state.sun_angle), np.sin(state.sun_angle), np.zeros(len(state))), axis=1)
    to_axis = r * axis - state.position
    to_axis /= np.linalg.norm(to_axis, axis=1, keepdims=True)
    bang = np.sign(state.velocity) * (1.0 if step // 7 % 2 else -1.0)
    corners = generator.choice([-1.0, 1.0], state.position.shape)
    out = state.position / r
    choices = np.stack((-2.0 * out, 2.0 * to_axis, 2.0 * out, corners, bang, 0.0 * out))
    return choices[kind, np.arange(len(state))]


def least_phi_under_adversaries(run, state, steps, dense, seed=0):
    """Return the least phi of every constraint at steps, and on a grid of 1 s in every `dense`-th hold."""
    generator = np.random.default_rng(seed)
    least = run.phi(state).min(axis=0)
    infeasible = 0
    for step in range(steps):
        result = run(state, adversaries(state, step, generator))
        infeasible += result.infeasible.sum()
        if step % dense == 0:
            for second in range(1, 10):
                least = np.minimum(least, run.phi(flown(state, result.control, float(second))).min(axis=0))
        state = flown(state, result.control, DT)
        least = np.minimum(least, run.phi(state).min(axis=0))
    return least, infeasible


def test_nothing_is_broken_under_adversaries(run):
    least, infeasible = least_phi_under_adversaries(run, safe_starts(run, 1, 48), 60, 1)
    assert infeasible == 0
    assert least.min() > 0.0, dict(zip(run.names, least, strict=True))
    assert least[NAMES.index("rel_vel")] < 1e-3  # the adversaries do reach the limits


@pytest.mark.long
def test_nothing_is_broken_in_a_million_steps(run):
    least, infeasible = least_phi_under_adversaries(run, safe_starts(run, 2, 1024), 1000, 20)
    assert infeasible == 0
    assert least.min() > 0.0, dict(zip(run.names, least, strict=True))
    tight = least < [3.0, 1e-3, 1e-3, 0.1, 0.1, 1e-3, 1e-3, 1e-3]
    assert tight.all(), dict(zip(run.names, least, strict=True))


def test_a_plan_is_safe_for_an_orbit(run):
    """The induction's base: fly the plan's hold, then coast; sampled every second of the hold and every 10 s after."""
    state = safe_starts(run, 3, 300, nearest=11.0, farthest=400.0, fastest=0.6)
    found, thrust = run.plans(state)
    assert found.all()
    assert np.abs(thrust).max() <= 1.0
    for second in range(1, 11):
        assert (run.phi(flown(state, thrust, float(second))) >= 0.0).all()
    state = flown(state, thrust, DT)
    assert np.abs(state.velocity[:, 1] + 2.0 * N * state.position[:, 0]).max() < 1e-12
    rest = np.zeros((len(state), 3))
    for time in np.arange(0.0, PERIOD, 10.0):
        assert (run.phi(flown(state, rest, time)) >= 0.0).all(), time
    last = flown(state, rest, PERIOD)
    np.testing.assert_allclose(last.position, state.position, atol=1e-7)
    assert run.recoverable(last).all()


def test_a_state_stays_recoverable_while_it_flies_its_plans(run):
    state = safe_starts(run, 4, 200, nearest=11.0, farthest=300.0)
    for _ in range(30):
        found, thrust = run.plans(state)
        assert found.all()
        state = flown(state, thrust, DT)


def test_weak_thrusters_have_plans_of_several_holds():
    weak = {"m": 60.0, "u_max": 0.6}
    one, several = BackupFilter(weak, several_holds=False), BackupFilter(weak)
    state = drawn(5, 600)
    state = state[np.flatnonzero((several.phi(state) >= 0.0).all(axis=1))]
    assert one.recoverable(state).mean() < 0.55
    assert several.recoverable(state).mean() > 0.94
    lost, alone = (BackupFilter(several_holds=flag).recoverable(state) for flag in (True, False))
    np.testing.assert_array_equal(lost, alone)  # the shipped task's are strong enough
    # from states that only these plans hold, nothing is lost or broken, and each plan is found again
    state = state[np.flatnonzero(several.recoverable(state) & ~one.recoverable(state))[:60]]
    found = Audit()
    fly_filtered(several, state, 80, np.random.default_rng(0), found)
    assert found.starts == 60
    assert (found.infeasible, found.violations) == (0, 0)
    assert found.interventions > 500
    for _ in range(15):  # what is flown alone leads to a plan of one hold
        state = flown(state, several.plans(state, 0.5)[1], DT, 60.0)
        assert several.plans(state, 0.5)[0].all()
    assert one.plans(state, 0.5)[0].all()


def test_with_half_of_the_margins_a_closed_motion_is_stayed_on():
    """Another plan would have no margin left for the next step; the first of the family is at hand here, and is not."""
    position, speed = np.array([[0.0, 100.0, 0.0]]), 100.0 * N
    for _ in range(20):  # the cross-track speed that the first plan asks for, but for 0.4 um/s
        velocity = np.array([[50.0 * N, 0.0, speed]])
        after = flown(RelativeState(position, velocity, np.zeros(1)), np.zeros((1, 3)), DT)
        speed = N * np.linalg.norm(after.position) / np.cos(N * DT) + 4e-7
    limit = CrossTrackSpeed(vel_limit=float(speed + 7e-6))  # between half and the whole of the margin
    weak = BackupFilter({"u_max": 1e-6}, [limit], "backup")
    state = RelativeState(position, np.array([[50.0 * N, 0.0, speed]]), np.zeros(1))
    assert not weak.recoverable(state).any()
    found = weak(state, np.full((1, 3), -1e-6))
    assert found.backup.all()
    assert np.abs(found.control).max() < 1e-12


def closed_motions(seed, rows):
    generator = np.random.default_rng(seed)
    position = generator.normal(size=(rows, 3)) * generator.uniform(10.0, 300.0, (rows, 1))
    velocity = generator.normal(size=(rows, 3)) * N * np.linalg.norm(position, axis=1, keepdims=True) * 0.7
    velocity[:, 1] = -2.0 * N * position[:, 0]
    return RelativeState(position, velocity, generator.uniform(0.0, 2.0 * np.pi, rows))


def test_closed_motions_are_certified_as_dense_samples_say(run):
    """Certified: no sample is unsafe. Refused: a sample is unsafe but for the margins of 1 mm and 0.01 mm/s."""
    from safe_inspect.rta.backup.closed_motion import NODE_STACK, closed_motion
    from safe_inspect.rta.backup.sequences import SAFE

    state = closed_motions(5, 600)
    least = np.full((len(state), len(run.names)), np.inf)
    for time in np.linspace(0.0, PERIOD, 2001):
        least = np.minimum(least, run.phi(flown(state, np.zeros((len(state), 3)), time)))
    work, weak = np.empty(NODE_STACK), np.zeros(2, np.int64)
    safe = np.array(
        [
            closed_motion(
                run._model, (*state.position[i], *state.velocity[i]),
                (np.cos(state.sun_angle[i]), np.sin(state.sun_angle[i])), Margins(1e-3, 1e-5, 1e-3), work, weak,
            ) == SAFE
            for i in range(len(state))
        ]
    )  # fmt: skip
    assert 30 < safe.sum() < 570
    assert (least[safe] >= 0.0).all()
    # phi of the sun is an angle: 1 mm is less than 1e-4 rad beyond 10 m; samples 3 s apart miss the least by little
    roomy = (least > [0.05, 1e-3, 5e-3, 0.05, 0.05, 1e-3, 1e-3, 1e-3]).all(axis=1)
    assert safe[roomy].all()


def test_holds_are_certified_as_dense_samples_say(run):
    from safe_inspect.rta.backup.holds import hold
    from safe_inspect.rta.backup.sequences import SAFE

    generator = np.random.default_rng(6)
    directions = generator.normal(size=(2, 3000, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    state = RelativeState(
        directions[0] * generator.choice([11.0, 14.0, 25.0, 60.0, 797.0], (3000, 1)),
        directions[1] * generator.uniform(0.0, 0.3, (3000, 1)), generator.uniform(0.0, 2.0 * np.pi, 3000),
    )  # fmt: skip
    control = generator.uniform(-0.3, 0.3, (3000, 3))
    least = np.full((3000, len(run.names)), np.inf)
    for time in np.linspace(0.0, DT, 81):
        least = np.minimum(least, run.phi(flown(state, control, time)))
    cells, where = np.empty((64, 4), np.int64), np.empty(2, np.int64)
    safe = np.array(
        [
            hold(
                run._model, (*state.position[i], *state.velocity[i]),
                (np.cos(state.sun_angle[i]), np.sin(state.sun_angle[i])), control[i],
                Margins(1e-3, 1e-5, 1e-3), cells, where,
            ) == SAFE
            for i in range(3000)
        ]
    )  # fmt: skip
    assert 300 < safe.sum() < 2700
    assert (least[safe] >= 0.0).all()
    roomy = (least > [0.05, 5e-3, 5e-3, 0.05, 0.1, 5e-3, 5e-3, 5e-3]).all(axis=1)
    assert roomy.sum() > 300
    assert safe[roomy].all()


def test_a_safe_control_is_flown_unchanged(run):
    state = safe_starts(run, 7, 200)
    desired = np.random.default_rng(7).uniform(-0.05, 0.05, (200, 3))
    result = run(state, desired)
    safe = admissible(run, state, desired)
    assert safe.mean() > 0.5
    np.testing.assert_array_equal(result.control[safe], desired[safe])
    assert not result.intervening[safe].any()
    assert (result.active[safe] == 0).all()
    assert (result.active[~safe] != 0).all()
    np.testing.assert_array_equal(result.phi, run.phi(state))


def test_every_answer_is_admissible_and_few_are_far_from_the_best(run):
    """Among two thousand controls about each answer, few are admissible and nearer to the desired one by 0.01 N."""
    state = safe_starts(run, 8, 60)
    generator = np.random.default_rng(8)
    desired = generator.uniform(-1.0, 1.0, (60, 3))
    result = run(state, desired)
    assert admissible(run, state, result.control).all()
    assert result.intervening.mean() > 0.9
    away = np.linalg.norm(result.control - desired, axis=1)
    beaten = np.zeros(60, bool)
    for trial in range(2000):
        size = 0.3 if trial % 2 else 0.03
        other = np.clip(result.control + generator.normal(size=(60, 3)) * size, -1.0, 1.0)
        nearer = np.flatnonzero(np.linalg.norm(other - desired, axis=1) < away - 0.01)
        beaten[nearer] |= admissible(run, state[nearer], other[nearer])
    assert beaten.mean() < 0.1


def test_thrusts_in_adversarial_flight_are_near_the_nearest_safe_ones(run):
    """A random search about each answer gains a hundredth of a newton or two on average."""
    state, generator = safe_starts(run, 14, 120), np.random.default_rng(14)
    for step in range(60):
        desired = np.clip(adversaries(state, step, generator), -1.0, 1.0)
        result = run(state, desired)
        before, state = state, flown(state, result.control, DT)
    changed = np.flatnonzero(result.intervening)
    state, desired, best = before[changed], desired[changed], result.control[changed]
    flown_away = np.linalg.norm(best - desired, axis=1)
    for trial in range(2000):
        away = np.linalg.norm(best - desired, axis=1)
        size = 10.0 ** generator.uniform(-3.0, -0.3, (len(best), 1))
        other = best + size * generator.normal(size=best.shape)
        if trial % 3 == 0:  # anywhere nearer
            other = desired + (away[:, None] * generator.random((len(best), 1))) * (other - best) / size / 2.0
        other = np.clip(other, -1.0, 1.0)
        nearer = np.flatnonzero(np.linalg.norm(other - desired, axis=1) < away - 1e-4)
        nearer = nearer[admissible(run, state[nearer], other[nearer])]
        best[nearer] = other[nearer]
    excess = flown_away - np.linalg.norm(best - desired, axis=1)
    assert len(excess) > 80
    assert excess.mean() < 0.03
    assert (excess > 0.1).mean() < 0.06


def test_an_intervention_can_fly_the_backup_plan(run):
    """What is accepted stays; after the plan's thrust the deputy may coast."""
    backup, state = BackupFilter(intervention="backup"), safe_starts(run, 15, 60)
    desired = np.random.default_rng(15).uniform(-1.0, 1.0, (60, 3))
    result = backup(state, desired)
    refused = result.backup
    np.testing.assert_array_equal(~refused, admissible(run, state, desired))
    assert 30 < refused.sum() < 60
    np.testing.assert_array_equal(result.control[~refused], desired[~refused])
    state = flown(state, result.control, DT)[np.flatnonzero(refused)]
    rest = np.zeros((len(state), 3))
    for _ in range(60):  # on a closed motion
        result = backup(state, rest)
        assert not result.intervening.any()
        state = flown(state, result.control, DT)


def test_a_deputy_that_coasts_spends_less_with_the_backup_plan(run):
    spent = []
    for one in (run, BackupFilter(intervention="backup")):
        state, total = safe_starts(run, 16, 40), 0.0
        for _ in range(400):
            result = one(state, np.zeros((40, 3)))
            assert not result.infeasible.any()
            total += np.abs(result.control).sum() * DT / MASS / 40.0
            state = flown(state, result.control, DT)
        spent.append(total)
    assert 0.0 < spent[1] < 0.6 * spent[0]


def test_the_refusing_constraints_are_named(run):
    state = RelativeState(np.array([[0.0, 60.0, 0.0]]), np.array([[0.0, 0.0, 0.0]]), np.array([-0.5 * np.pi]))
    outcome = run(state, np.array([[0.0, 1.0, 0.0]]))
    assert outcome.intervening.all()
    assert outcome.active_names(0) == ("rel_vel",)
    assert run(state, np.zeros((1, 3))).active_names(0) == ()


def test_a_row_does_not_depend_on_its_batch(run):
    state = safe_starts(run, 9, 30)
    desired = adversaries(state, 0, np.random.default_rng(9))
    whole = run(state, desired)
    for i in range(30):
        alone = run(state[i : i + 1], desired[i : i + 1])
        np.testing.assert_array_equal(alone.control[0], whole.control[i])
        assert alone.active[0] == whole.active[i]


def outside():
    """Return states that break the range, the sun cone, the largest range, and the speed limits."""
    position = [[8.0, 3.0, 0.0], [40.0, 0.0, 5.0], [820.0, 0.0, 0.0], [60.0, 10.0, 0.0], [6.0, 0.0, 0.0]]
    velocity = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.9, 1.2, -0.3], [-0.05, 0.0, 0.0]]
    # the cone opens towards (-cos theta, sin theta): along +x at theta = pi
    return RelativeState(np.array(position), np.array(velocity), np.array([2.0, np.pi, 0.0, 1.0, 2.0]))


def test_from_outside_the_safe_set_it_returns(run):
    state = outside()
    assert (run.phi(state) < 0.0).any(axis=1).all()
    assert not run.recoverable(state).any()
    first = run(state, np.zeros((len(state), 3)))
    assert first.infeasible.all()
    assert (first.active != 0).all()
    back = np.zeros(len(state), bool)
    for _ in range(160):
        result = run(state, np.zeros((len(state), 3)))
        assert np.abs(result.control).max() <= 1.0
        assert not (back & result.infeasible).any(), "a state that has a plan keeps one"
        back |= ~result.infeasible
        state = flown(state, result.control, DT)
        assert (run.phi(state)[back] >= 0.0).all()
    assert back.all()


def test_the_way_back_from_safe_states_without_a_plan_breaks_nothing(run):
    generator = np.random.default_rng(13)
    directions = generator.normal(size=(2, 20_000, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    state = RelativeState(
        directions[0] * generator.uniform(50.0, 100.0, (20_000, 1)),
        directions[1] * generator.uniform(0.0, 0.3, (20_000, 1)), generator.uniform(0.0, 2.0 * np.pi, 20_000),
    )  # fmt: skip
    # h >= 0 too, as the shipped start states are drawn
    held = np.ones(len(state), bool)
    for constraint in run.constraints.values():
        evaluation = constraint.evaluate(state)
        held &= (evaluation.phi >= 0.0) & (evaluation.h >= 0.0)
    lost = np.flatnonzero(held & ~run.recoverable(state))
    assert 0 < len(lost) < 0.02 * held.sum()
    state = state[lost]
    for step in range(60):
        result = run(state, generator.choice([-1.0, 1.0], state.position.shape))
        assert step > 0 or result.infeasible.sum() > 10
        state = flown(state, result.control, DT)
        assert (run.phi(state) >= 0.0).all()
    assert not result.infeasible.any()


def test_a_part_of_the_constraints():
    run = BackupFilter(names=["y_vel", "r_max", "PSM"])
    assert run.names == ("y_vel", "r_max", "PSM")
    least, infeasible = least_phi_under_adversaries(run, safe_starts(run, 10, 24, fastest=0.8), 60, 5)
    assert infeasible == 0
    assert least.min() > 0.0


def test_a_longer_horizon_and_step():
    parameters = {"psm_horizon": PERIOD, "step_size": 20.0, "collision_radius": 15.0}
    run = BackupFilter(parameters)
    state = safe_starts(run, 11, 24)
    generator = np.random.default_rng(11)
    for step in range(30):
        result = run(state, adversaries(state, step, generator))
        assert not result.infeasible.any()
        state = flown(state, result.control, 20.0)
        assert (run.phi(state) >= 0.0).all()


def test_bad_input_is_named(run):
    state = safe_starts(run, 12, 4)
    desired = np.zeros((4, 3))
    desired[2, 0] = np.inf
    with pytest.raises(ValueError, match="desired control of row 2 is not finite"):
        run(state, desired)
    velocity = state.velocity.copy()
    velocity[1] = np.nan
    with pytest.raises(ValueError, match="state of row 1 is not finite"):
        run(RelativeState(state.position, velocity, state.sun_angle), np.zeros((4, 3)))
    with pytest.raises(ValueError, match="too long a part of the orbit"):
        BackupFilter({"step_size": 600.0})


def test_without_constraints_there_is_no_safety_quantity():
    for one in (BackupFilter(names=[]), ContinuousFilter(names=[])):
        assert one.phi(safe_starts(BackupFilter(), 4, 20)).shape == (20, 0)
