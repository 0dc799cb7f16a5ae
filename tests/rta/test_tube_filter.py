"""The filter that holds under a bounded disturbance: its tube holds every deviation, and no constraint is broken."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.dynamics.cwh import transition
from safe_inspect.environments import TeamEnvironment
from safe_inspect.errors import ConfigError
from safe_inspect.rta.audit import audit, grazing_states
from safe_inspect.rta.backup.deviations import PlanTracker, leaves_nothing
from safe_inspect.rta.backup.model import CLOSED, HOLD, NO_TUBE, PLAN
from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.constraints import NAMES, RelativeState, constraint_set
from safe_inspect.rta.constraints.parameters import ConstraintParameters

BOUNDS = DisturbanceBounds(
    velocity=1e-4, position_error=0.01, velocity_error=1e-4, thrust_gain=0.01, thrust_direction=0.01
)
GLUE = "agent_config.blue0_ctrl.config.config.glues.0.config"
SIMULATOR = "config.config.env_config.simulator.config.disturbance"
FIELDS = BOUNDS.model_dump()


@pytest.fixture(scope="module")
def run():
    return BackupFilter(None, NAMES, disturbance=BOUNDS)


def sphere(generator, shape, size):
    v = generator.normal(size=(*shape, 3))
    return size * v / np.linalg.norm(v, axis=-1, keepdims=True)


def test_deviations_stay_within_the_tube_and_come_near_its_width():
    """The worst of many disturbances, among them those that all push one way, against the bounds of every hold."""
    p, generator, holds, rows = ConstraintParameters(), np.random.default_rng(0), 12, 20_000
    tracker = PlanTracker(p, BOUNDS)
    phi, gamma = transition(p.n, p.m, p.step_size)
    u, v = 1.7, 0.6
    bounds = [(d.length @ [1, u, v], d.speed @ [1, u, v], d.thrust @ [1, u, v]) for d in tracker.follow((1, 2))[:holds]]
    one_way = sphere(generator, (rows,), 1.0)
    flip = (
        np.where(generator.random((rows, holds)) < 0.3, -1.0, 1.0) * np.where(np.arange(rows) % 2, 1.0, -1.0)[:, None]
    )
    deviation, error, worst = np.zeros((rows, 6)), None, np.zeros((holds, 3))
    share = BOUNDS.thrust_error
    for hold in range(holds):
        push = one_way * flip[:, hold : hold + 1]
        error = np.concatenate((BOUNDS.position_error * push, BOUNDS.velocity_error * push), axis=1)
        if hold == 0:
            deviation, tracking = -error, np.zeros((rows, 3))
        else:
            tracking = (deviation + error) @ tracker.gain.T
        worst[hold] = (
            *np.abs([np.linalg.norm(deviation[:, k : k + 3], axis=1).max() for k in (0, 3)]),
            abs(tracking).max(),
        )
        planned = sphere(generator, (rows,), (u, v)[hold] if hold < 2 else 0.0)
        thrust_error = share * np.linalg.norm(planned + tracking, axis=1, keepdims=True) * push
        deviation = deviation @ phi.T + (tracking + thrust_error) @ gamma.T
        deviation[:, 3:] += BOUNDS.velocity * push
        worst[hold, :2] = np.maximum(
            worst[hold, :2], [np.linalg.norm(deviation[:, k : k + 3], axis=1).max() for k in (0, 3)]
        )
    assert (worst <= np.array(bounds)).all()
    assert (worst[:, :2] > 0.4 * np.array(bounds)[:, :2]).all()


def test_margins_grow_with_thrust_and_with_each_bound(run):
    tube = run.tube
    assert (tube >= 0.0).all()
    assert tube[HOLD, 1, 1] > 0.01 * 10.0 / 12.0  # of 1 N for 10 s on 12 kg, one per cent, and the direction
    assert (tube[CLOSED] >= tube[PLAN] - 1e-15).all()
    for name in FIELDS:
        less = BackupFilter(None, NAMES, disturbance=BOUNDS.model_copy(update={name: 0.0}))
        assert less.tube.sum() < tube.sum()


def test_bounds_that_leave_no_set_are_refused():
    with pytest.raises(ValueError, match=r"`disturbance` leave nothing of the speed"):
        BackupFilter(None, ("rel_vel", "z_vel"), disturbance=DisturbanceBounds(velocity_error=2.0))
    with pytest.raises(ValueError, match=r"leave nothing of the 790 m between"):
        BackupFilter(None, NAMES, disturbance=DisturbanceBounds(position_error=400.0))
    with pytest.raises(ValueError, match="leave nothing to enforce: a plan cannot be tracked"):
        BackupFilter(None, NAMES, disturbance=DisturbanceBounds(thrust_gain=0.9, thrust_direction=1.5))


def test_without_a_disturbance_it_accepts_what_the_backup_filter_accepts(draw):
    state = draw(3, 400, nearest=12.0, farthest=200.0, fastest=0.4)
    still, exact = BackupFilter(None, NAMES, disturbance=DisturbanceBounds()), BackupFilter()
    np.testing.assert_array_equal(still.recoverable(state), exact.recoverable(state))
    desired = np.random.default_rng(1).uniform(-1.0, 1.0, (400, 3))
    kept = exact.recoverable(state)
    np.testing.assert_array_equal(still(state, desired).control[kept], exact(state, desired).control[kept])


def test_it_accepts_nearly_all_starts(run, draw):
    state = draw(4, 1000, nearest=50.0, farthest=100.0, fastest=0.3)
    exact, tube = BackupFilter().recoverable(state), run.recoverable(state)
    assert not (tube & ~exact).any()
    assert tube.sum() > 0.9 * exact.sum()


def test_every_estimate_of_an_accepted_start_has_a_plan(run):
    """Also of those on the edge of what is accepted."""
    generator = np.random.default_rng(5)
    state = grazing_states(run, generator, 24)
    for _ in range(10):
        e, f = (sphere(generator, (len(state),), size) for size in (BOUNDS.position_error, BOUNDS.velocity_error))
        seen = RelativeState(state.position + e, state.velocity + f, state.sun_angle)
        assert not run(seen, np.zeros((len(state), 3))).infeasible.any()


def test_nothing_is_broken_under_disturbances_that_push_to_the_limits(run):
    found = audit(2, rows=12, steps=30, first=run)
    assert found.settings == 3
    assert found.starts > 40
    assert (found.infeasible, found.violations) == (0, 0)
    assert found.interventions < 0.8 * found.steps


def test_the_undisturbed_filter_breaks_under_the_same_disturbances(run, monkeypatch):
    """The checker and its disturbances see what is broken."""

    exact, track = BackupFilter(), BackupFilter.track

    def forgetful(self, state, desired, memory):
        return track(exact, state, desired)[0], memory

    monkeypatch.setattr(BackupFilter, "track", forgetful)
    found = audit(0, rows=16, steps=40, first=run)
    assert found.violations > 0
    assert found.infeasible > 0


def test_the_memory_is_that_of_the_rows_alone_and_is_not_written(run):
    generator = np.random.default_rng(7)
    state = grazing_states(run, generator, 8)
    desired = generator.uniform(-1.0, 1.0, (len(state), 3))
    whole, memory = run.track(state, desired, run.memory(len(state)))
    kept = memory.copy()
    again, after = run.track(state, -desired, memory)
    np.testing.assert_array_equal(memory, kept)
    for i in range(0, len(state), 5):
        alone, own = run.track(state[[i]], -desired[[i]], kept[[i]])
        np.testing.assert_array_equal(alone.control[0], again.control[i])
        np.testing.assert_array_equal(own[0], after[i])
    assert not whole.infeasible.any()


def spec(*overrides, simulator=FIELDS, bounds=FIELDS):
    given = [f"{GLUE}.enabled=True", *overrides]
    if bounds is not None:
        given.append(f"{GLUE}.disturbance={bounds}")
    if simulator is not None:
        whole = {"functor": "BoundedDisturbance", "config": {**simulator, "distribution": "extreme"}}
        given.append(f"{SIMULATOR}={whole}")
    return load_experiment(configs_root() / "translational-inspection" / "experiment-seed.yml", given).spec


def test_in_the_environment_every_constraint_holds_through_resets():
    env = TeamEnvironment(spec("horizon=12"), 64, seed=3)
    env.reset()
    glue, generator = env.groups[0].safety_filter, np.random.default_rng(0)
    plans = 0
    for _ in itertools.repeat(None, 30):
        found = env.step([generator.choice([-1.0, 1.0], (64, 1, 3))])
        transition = found.groups[0]
        assert not transition.step.filtered.infeasible.any()
        plan = env.state.memory["blue0_ctrl", "safety filter", "plan"]
        plans += int((plan[:, 9] == 1.0).sum())
        state = {name: env.state[name][:, 0] for name in ("position", "velocity")} | {"sun_angle": env.state.sun_angle}
        assert all((phi >= 0.0).all() for phi in glue.safety(state).values())
        done = np.flatnonzero(transition.done[:, 0])
        env.reset(done)
        assert not env.state.memory["blue0_ctrl", "safety filter", "plan"][done].any()
    assert plans == 30 * 64


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            {"bounds": None},
            "disturbed by BoundedDisturbance, and this filter gives no guarantee then; give the filter `disturbance: {",
        ),
        (
            {"bounds": {**FIELDS, "velocity": 5e-5}},
            "`velocity` is 0.0001, from BoundedDisturbance, which exceeds this bound",
        ),
        ({"overrides": [f"{GLUE}.method=continuous"]}, "the method 'continuous' does not support `disturbance`"),
        ({"bounds": {**FIELDS, "velocity_error": 3.0}}, "leave nothing of the 790 m"),
    ],
)
def test_bounds_that_do_not_fit_are_refused_with_one_message(arguments, words):
    arguments = dict(arguments)
    with pytest.raises(ConfigError) as caught:
        spec(*arguments.pop("overrides", ()), **arguments)
    assert words in str(caught.value)
    assert len(caught.value.problems) == 1


@pytest.mark.parametrize(
    ("names", "part", "row", "value", "said"),
    [
        # 790 m between the collision radius and r_max; the width counts on both sides, or that of coasting on one
        (("r_max", "chief_collision"), CLOSED, 0, 394.0, None),
        (("r_max", "chief_collision"), CLOSED, 0, 396.0, "of the 790 m between"),
        (("r_max", "chief_collision"), CLOSED, 2, 789.0, None),
        (("r_max", "chief_collision"), CLOSED, 2, 791.0, "of the 790 m between"),
        (("r_max",), CLOSED, 0, 396.0, None),
        # 0.2 m/s and 2 n for each metre from 10 m to 800 m
        (("rel_vel",), CLOSED, 1, 1.82, None),
        (("rel_vel",), CLOSED, 1, 1.83, "of the speed of 1.82 m/s"),
        (("z_vel",), CLOSED, 1, 0.99, None),
        (("z_vel",), CLOSED, 1, 1.0, "of the `vel_limit` 1 m/s of z_vel"),
        (("z_vel",), PLAN, 1, 2.0, None),
        ((), PLAN, 3, 0.99, None),
        ((), PLAN, 3, 1.001, "of the thrust `u_max` 1 N"),
        ((), CLOSED, 3, 1.001, "of the thrust `u_max` 1 N"),
    ],
)
@pytest.mark.parametrize("share", [0.0, 0.4])
def test_a_tube_that_takes_all_of_a_limit_is_refused(names, part, row, value, said, share):
    """The effort of tracking grows with the largest thrust along the diagonal, and counts with its share of it."""
    tube = np.zeros_like(NO_TUBE)
    tube[part, row, 0] = value
    if row == 3:
        largest = math.sqrt(3.0)
        tube[part, row] = value * np.array([1.0 - share, 0.5 * share / largest, 0.5 * share / largest])
    parameters = ConstraintParameters.of({})
    found = leaves_nothing(tube, parameters, constraint_set(parameters, names))
    assert found is None if said is None else found is not None and found.startswith(said)
