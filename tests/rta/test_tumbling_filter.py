"""The filter of docking with a tumbling target: no contact whatever is commanded, and what it refuses."""

from __future__ import annotations

import os

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.dynamics.quaternion import rotate, rotate_back
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.environments import BatchedEnvironment, load_spec
from safe_inspect.errors import ConfigError, UnsafeInitialStateWarning
from safe_inspect.evaluation.safety_report import safety_report
from safe_inspect.geometry.oriented_boxes import OrientedBoxes
from safe_inspect.rta import RTAGlueTumblingTarget
from safe_inspect.rta.tumbling_rows import _is_clear, _turn

EXPERIMENT = configs_root() / "tumbling-rendezvous-learning" / "experiment.yml"
OFF = "RTAGlueTumblingTarget.config.enabled=False"
FAST = "target_tumble.config.rate={type: UniformParameter, config: {units: deg/s, low: 5, high: 20}}"
#: Number of random targets; `TUMBLING_TARGETS=60 pytest tests/rta/test_tumbling_filter.py` flies more.
TARGETS = int(os.environ.get("TUMBLING_TARGETS", "3"))


def random_target(number: int) -> tuple[str, ...]:
    """Return overrides with one to five random boxes, a random inertia, and rates between 0 and 25 deg/s."""
    rng = np.random.default_rng(number)
    boxes = [
        f"{{centre: {rng.uniform(-12.0, 12.0, 3).tolist()}, half_size: {(10.0 ** rng.uniform(-1.0, 0.9, 3)).tolist()}, "
        f"roll: {rng.uniform(-90.0, 90.0)} deg}}"
        for _ in range(rng.integers(1, 6))
    ]
    axes, moments = np.linalg.qr(rng.normal(size=(3, 3)))[0], np.sort(rng.uniform(0.1, 1.0, 3))
    moments[2] = min(moments[2], 0.999 * (moments[0] + moments[1]))
    inertia = axes * moments @ axes.T
    least = rng.uniform(0.0, 10.0)
    overrides = (
        f"TumblingTarget.config.boxes=[{', '.join(boxes)}]",
        f"TumblingTarget.config.inertia={(0.5 * (inertia + inertia.T)).tolist()}",
        "target_tumble.config.rate={type: UniformParameter, config: "
        f"{{units: deg/s, low: {least}, high: {least + rng.uniform(1.0, 15.0)}}}}}",
    )
    unscaled = load_spec(EXPERIMENT, ["TumblingTarget.config.scale=0.01", *overrides]).agents[0].safety_filter
    scale = 0.01 * rng.uniform(0.5, 1.1) / unscaled.swept_radius
    return f"TumblingTarget.config.scale={scale}", *overrides


def environment(num_envs: int, *overrides: str, seed: int = 1) -> BatchedEnvironment:
    env = BatchedEnvironment(load_spec(EXPERIMENT, overrides), num_envs, seed=seed)
    env.reset()
    return env


def levels(direction):
    """Return the indices of the levels nearest to full thrust along a direction, shape (N, 1, 3)."""
    size = np.abs(direction).max(axis=1, keepdims=True)
    return np.rint(3.0 + 3.0 * direction / np.maximum(size, 1e-12))[:, None]


class Truth:
    """The target between the steps, by the closed form of its motion."""

    def __init__(self, env: BatchedEnvironment) -> None:
        body = env.simulation.world.target_body
        self.inertia, self.boxes = body.inertia, OrientedBoxes(*body.boxes)

    def least_clearance(self, before, control, step, parts=25):
        """Return the smallest clearance of a hold, shape (N,), from the state and the thrust at its start."""
        position, q, w = before
        times = np.linspace(0.0, step, parts)
        turning = tumble(np.tile(self.inertia, (len(q), 1)), q, w, times)[0]
        start, velocity = position
        t = times[None, :, None]
        path = start[:, None] + t * (velocity[:, None] + 0.5 * t * control[:, None] / 9.583788668)
        inside = rotate_back(turning.reshape(-1, 4), path.reshape(-1, 3))
        return self.boxes.distance(inside).reshape(path.shape[:2]).min(axis=1)

    def towards(self, env: BatchedEnvironment):
        """Return the directions in W to the nearest points of the target, shape (N, 3)."""
        state = env.state
        distance, gradient = self.boxes.distances(rotate_back(state.target_orientation, state.position[:, 0]))
        return -rotate(state.target_orientation, gradient[np.arange(len(distance)), distance.argmin(axis=1)])


def hostile(env, truth, rng, step):
    """Return directions: to the nearest point, to the centre, to where the target moves, at random."""
    state = env.state
    centre = -state.position[:, 0]
    meeting = np.cross(rotate(state.target_orientation, state.target_angular_velocity), centre)
    ways = np.stack([truth.towards(env), centre, meeting + 0.3 * centre, rng.normal(size=centre.shape)])
    kinds = (np.arange(env.num_envs) + step // 40) % len(ways)
    return ways[kinds, np.arange(env.num_envs)]


def fly_hostile(env: BatchedEnvironment, steps: int) -> tuple[float, int]:
    """Return the smallest clearance of all moments, and the number of interventions, of hostile commands."""
    truth, rng, least, changed = Truth(env), np.random.default_rng(3), np.inf, 0
    for step in range(steps):
        state = env.state
        before = (
            (state.position[:, 0].copy(), state.velocity[:, 0].copy()),
            state.target_orientation.copy(), state.target_angular_velocity.copy(),
        )  # fmt: skip
        done = env.step(levels(hostile(env, truth, rng, step)))
        assert not done.step.filtered.infeasible.any()
        assert (done.status != 2).all()
        assert np.abs(done.step.control).max() <= 0.3 + 1e-12
        assert np.linalg.norm(env.state.position[:, 0], axis=1).max() <= 3.0
        least = min(least, truth.least_clearance(before, done.step.control, 1.0).min())
        changed += done.step.intervening.sum()
        env.reset(np.flatnonzero(done.done[:, 0]))
    return float(least), int(changed)


@pytest.mark.parametrize("overrides", [(), (FAST,)], ids=["1 to 5 deg/s", "5 to 20 deg/s"])
def test_no_contact_at_any_moment_whatever_is_commanded(overrides):
    least, changed = fly_hostile(environment(48, *overrides), 150)
    assert 0.28 <= least < 0.34  # they come near
    assert changed > 500


def test_no_contact_with_targets_of_other_shapes():
    least = [fly_hostile(environment(64, *random_target(number), seed=number), 150)[0] for number in range(TARGETS)]
    assert min(least) >= 0.28
    assert min(least) < 0.34


def test_without_the_filter_the_same_commands_end_in_contact():
    env = environment(48, OFF)
    truth, rng, lost = Truth(env), np.random.default_rng(3), 0
    for step in range(60):
        done = env.step(levels(hostile(env, truth, rng, step)))
        lost += (done.status == 2).sum()
        env.reset(np.flatnonzero(done.done[:, 0]))
    assert lost > 30


def test_clearances_are_bounded_between_the_moments_at_which_they_are_computed():
    env = environment(2000, FAST)
    truth, rng, accepted = Truth(env), np.random.default_rng(4), 0
    glue = load_spec(EXPERIMENT).agents[0].safety_filter
    model = glue._model(env.simulation.world)._replace(cells=1)  # one moment at each end of a hold of 1 s
    position = rng.uniform(-0.7, 0.7, (2000, 3))
    velocity, push = rng.normal(scale=0.3, size=(2000, 3)), rng.uniform(-0.03, 0.03, (2000, 3))
    q, w = env.state.target_orientation, env.state.target_angular_velocity
    least = truth.least_clearance(((position, velocity), q, w), 9.583788668 * push, 1.0)
    for n in range(2000):
        attitudes = np.empty((2, 7))
        attitudes[0] = *q[n], *w[n]
        _turn(model, attitudes, 0, 1)
        if _is_clear(model, attitudes, 0, np.concatenate((position[n], velocity[n])), push[n]):
            accepted += 1
            assert least[n] >= model.least
    assert 100 < accepted < 1000


def test_no_more_thrust_is_applied_than_the_filter_may_use():
    env = environment(64, "RTAGlueTumblingTarget.config.u_max=0.2")
    for _ in range(5):
        assert np.abs(env.step(np.full((64, 1, 3), 6.0)).step.control).max() == pytest.approx(0.2, rel=1e-12)


def test_what_is_safe_is_applied_unchanged():
    env = environment(32)
    for _ in range(20):
        done = env.step(np.full((32, 1, 3), 3.0))
        np.testing.assert_array_equal(done.step.control, 0.0)
        assert not done.step.intervening.any()
    assert not done.step.filtered.backup.any()


def test_a_row_of_a_batch_is_that_row_alone():
    whole, rng = environment(6), np.random.default_rng(5)
    alone = [BatchedEnvironment(load_spec(EXPERIMENT), 1, seed=1, first_slot=slot) for slot in range(6)]
    for env in alone:
        env.reset()
    for _ in range(60):
        actions = rng.integers(0, 7, (6, 1, 3)).astype(float)
        actions[:, 0] = np.where(rng.random((6, 1)) < 0.7, levels(-whole.state.position[:, 0])[:, 0], actions[:, 0])
        together = whole.step(actions)
        for slot, env in enumerate(alone):
            single = env.step(actions[slot : slot + 1])
            np.testing.assert_array_equal(single.step.control[0], together.step.control[slot])
            np.testing.assert_array_equal(env.state.position[0], whole.state.position[slot])


def test_a_start_between_the_arms_has_an_escape_or_is_reported():
    env = environment(300)
    rng = np.random.default_rng(2)
    direction = rng.normal(size=(300, 3))
    place = 0.75 * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    env.state.position[:, 0], env.state.velocity[:, 0] = place, 0.0
    distance = Truth(env).boxes.distance(rotate_back(env.state.target_orientation, place))
    clear = distance > 0.35
    lost = np.zeros(300, dtype=bool)
    for step in range(40):
        done = env.step(levels(-env.state.position[:, 0]))
        if step == 0:
            reported = done.step.filtered.infeasible
        lost |= done.status[:, 0] == 2
    assert 100 < clear.sum() < 300
    assert reported[distance < 0.28].all()
    assert not lost[clear & ~reported].any()
    assert (clear & ~reported).sum() > 0.9 * clear.sum()


def test_a_start_that_is_not_refused_has_an_escape():
    env, rng, rows = environment(5000, FAST), np.random.default_rng(1), 5000
    glue = load_spec(EXPERIMENT).agents[0].safety_filter
    outwards, aside = rng.normal(size=(2, rows, 3))
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    speed = 10.0 ** rng.uniform(-3.0, -0.7, (rows, 1))
    stop = speed * (0.5 * speed * 9.583788668 / 0.3 + 1.0)  # it stops next to the sphere that the target sweeps
    position = outwards * (1.2838 + stop * rng.uniform(0.9, 1.05, (rows, 1)))
    way = rng.choice([0.0, 0.3, 1.0], (rows, 1)) * aside - outwards
    velocity = speed * way / np.linalg.norm(way, axis=1, keepdims=True)
    refused = np.any([*glue.refusals({"position": position, "velocity": velocity}).values()], axis=0)
    env.state.position[:, 0], env.state.velocity[:, 0] = position, velocity
    infeasible = env.step(levels(-position)).step.filtered.infeasible
    assert 1000 < refused.sum() < 4000
    assert not infeasible[~refused].any()


STATES = {
    "far enough": ([1.4, 0, 0], [0, 0, 0], ()),
    "in the sphere": ([0, 1.2, 0], [0, 0, 0], ("clearance",)),
    "too fast to brake": ([1.6, 0, 0], [-0.2, 0, 0], ("clearance",)),
    "passing by": ([1.4, 0, 0], [0, 0.2, 0], ()),
    "leaving": ([2.8, 0, 0], [0.2, 0, 0], ("r_max",)),
}


@pytest.mark.parametrize(("position", "velocity", "expected"), STATES.values(), ids=STATES)
def test_initial_states_from_which_nothing_is_guaranteed_are_refused(position, velocity, expected):
    glue = load_spec(EXPERIMENT).agents[0].safety_filter
    assert isinstance(glue, RTAGlueTumblingTarget)
    assert glue.swept_radius == pytest.approx(1.0028, abs=1e-4)
    refused = glue.refusals({"position": np.array([position], float), "velocity": np.array([velocity], float)})
    assert tuple(name for name, rows in refused.items() if rows[0]) == expected


def test_a_start_in_the_swept_sphere_is_warned_of():
    with pytest.warns(UnsafeInitialStateWarning, match="rejected by clearance"):
        environment(2, "simulator_reset_parameters.config.y=-1.0")


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (("simulator.config.dynamics={functor: ClohessyWiltshire}",), "assumes DoubleIntegrator dynamics, but these"),
        (("ContactDoneFunction.config.radius=0.3",), "loses at a clearance of 0.3 m, but the filter only keeps 0.28 m"),
        (("max_distance=2 m",), "loses beyond 2 m, but the filter allows up to 3 m"),
        (("RTAGlueTumblingTarget.config.r_max=1.2",), "no room to escape"),
        (("RTAGlueTumblingTarget.config.swept_radius=0.5",), "`swept_radius` is 0.5 here"),
        (("RTAGlueTumblingTarget.config.u_max=0.5",), "assumes 0.5 N along each axis, which a controller cannot apply"),
        (("RTAGlueTumblingTarget.config.m=5",), "`m` is 5 here"),
    ],
)
def test_what_would_void_the_guarantee_is_refused(overrides, message):
    with pytest.raises(ConfigError, match=message):
        load_spec(EXPERIMENT, overrides)


def test_the_adversaries_of_the_report_break_nothing():
    report = safety_report(load_spec(EXPERIMENT), steps=20_000, num_envs=128, substeps=5)
    assert (report.violations, report.infeasible, report.starts_refused) == (0, 0, 0)
    assert report.names == ("clearance", "r_max")
    assert report.least_between[0] < 0.05
    assert safety_report(load_spec(EXPERIMENT, [OFF]), steps=5_000, num_envs=100, substeps=2).violations > 0
