"""Weighted inspection: weights, scores, success that asks for a safe coast, and a price of fuel that follows scores."""

from __future__ import annotations

import math

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.dones import DoneStatus
from safe_inspect.dynamics.coasting import grid, least_coasting_range
from safe_inspect.dynamics.cwh import transition
from safe_inspect.environments import BatchedEnvironment, TeamEnvironment, load_spec
from safe_inspect.simulators.view import View
from safe_inspect.tasks.inspection.points_view import PointsView

TASK = "safe_inspect/WeightedTranslationalInspection-v0"
TEAM = "safe_inspect/MultiagentWeightedTranslationalInspection-v0"
N = 0.001027
COAST = 1  # index of the level 0 N


def environment(num_envs: int, seed: int = 1) -> BatchedEnvironment:
    env = BatchedEnvironment(load_spec(TASK), num_envs, seed=seed)
    env.reset()
    return env


def test_a_view_distinguishes_the_own_count_from_that_of_others():
    env = TeamEnvironment(load_spec(TEAM), 2, seed=3)
    env.reset()
    state, world = env.state.points["chief"], env.simulation.world
    state.own_count[:] = [[1, 2, 3], [4, 5, 6]]
    first = 0
    for group in env.groups:
        own = np.arange(first, first + group.size) + 1
        points = PointsView(View(env.state, world, group), world.points["chief"])
        np.testing.assert_array_equal(points.count_of(), [*own, *own + 3])
        np.testing.assert_array_equal(points.count_of("blue1"), np.repeat([2, 5], group.size))
        first += group.size


def coast(env: BatchedEnvironment):
    return env.step(np.full((env.num_envs, 1, 3), float(COAST)))


def test_points_towards_the_priority_vector_weigh_most():
    env = environment(50)
    state = env.state
    weights, priority = state.points["chief"].weights, state.priority_vector
    normals = env.simulation.world.points["chief"].points / 10.0
    np.testing.assert_allclose(np.linalg.norm(priority, axis=1), 1.0, rtol=1e-12)
    angle = np.arccos(np.clip(-priority @ normals.T, -1.0, 1.0)) / math.pi
    np.testing.assert_allclose(weights, angle / angle.sum(axis=1, keepdims=True), rtol=1e-12)
    assert (np.argmax(weights, axis=1) == np.argmax(priority @ normals.T, axis=1)).all()
    assert len(np.unique(priority[:, 0])) == 50  # one for each episode
    elevation = np.arcsin(priority[:, 2])
    assert np.abs(elevation).max() <= 1.57


def test_the_score_is_the_weight_of_what_is_inspected():
    env = environment(40)
    before = np.zeros(40)
    for _ in range(60):
        found = coast(env)
        points = env.state.points["chief"]
        score = np.where(points.inspector >= 0, points.weights, 0.0).sum(axis=1)
        np.testing.assert_allclose(points.team_score, score, rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(points.own_score[:, 0], score, rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(found.terms["ObservedPointsReward"][:, 0], score - before, atol=1e-12)
        before = score
    assert before.max() > 0.3
    observed = found.observation[:, 0]
    names = env.observation_layout.names
    np.testing.assert_allclose(observed[:, names.index("Sensor_InspectedPointsScore.score")], score, rtol=1e-6)
    first = names.index("Sensor_PriorityVector.x_priority")
    np.testing.assert_allclose(observed[:, first : first + 3], env.state.priority_vector, rtol=1e-6)


@pytest.mark.parametrize(
    ("position", "velocity", "status", "reward"),
    [
        ((60.0, 0.0, 0.0), (0.0, -2 * N * 60.0, 0.0), DoneStatus.WIN, 3.0),  # a closed ellipse about the chief
        ((30.0, 0.0, 0.0), (-0.3, 0.0, 0.0), DoneStatus.LOSE, -1.0),  # towards the chief
    ],
)
def test_success_asks_for_a_safe_coast(position, velocity, status, reward):
    env = environment(1)
    env.state.position[0, 0], env.state.velocity[0, 0] = position, velocity
    env.state.points["chief"].inspector[0, :] = 0
    env.state.points["chief"].inspector[0, np.argmin(env.state.points["chief"].weights[0])] = -1
    env.state.points["chief"].team_score[0] = 0.999
    found = coast(env)
    phi = transition(N, 12.0, 1.0)[0]
    x = np.concatenate([env.state.position[0, 0], env.state.velocity[0, 0]])
    least = np.inf
    for _ in range(round(2 * math.pi / N)):
        least = min(least, float(np.linalg.norm(x[:3])))
        x = phi @ x
    assert (least >= 10.0) == (status == DoneStatus.WIN)
    assert found.status[0, 0] == status
    assert found.terms["SafeInspectionSuccessReward"][0, 0] == reward


def test_nothing_is_paid_before_the_threshold():
    env = environment(1)
    env.state.points["chief"].team_score[0] = 0.9499
    found = coast(env)
    if env.state.points["chief"].team_score[0] < 0.95:
        assert found.terms["SafeInspectionSuccessReward"][0, 0] == 0.0
        assert found.status[0, 0] == DoneStatus.RUNNING


def test_the_least_coasting_range_is_that_of_a_fine_grid():
    generator = np.random.default_rng(3)
    table, phi = grid(N, 2 * math.pi / N), transition(N, 12.0, 0.5)[0]
    for _ in range(20):
        p, v = generator.uniform(-80.0, 80.0, 3), generator.uniform(-0.2, 0.2, 3)
        x, least = np.concatenate([p, v]), np.inf
        for _ in range(int(2 * math.pi / N / 0.5) + 1):
            least = min(least, float(np.linalg.norm(x[:3])))
            x = phi @ x
        found = least_coasting_range(p, v, table, N)
        assert found <= least + 1e-9
        assert found == pytest.approx(least, abs=0.05)


def test_each_deputy_of_a_team_has_its_own_score():
    env = TeamEnvironment(load_spec(TEAM), 10, seed=2)
    env.reset()
    for _ in range(50):
        env.step([np.full((10, group.size, 3), float(COAST)) for group in env.acting])
    points = env.state.points["chief"]
    for deputy in range(3):
        own = np.where(points.inspector == deputy, points.weights, 0.0).sum(axis=1)
        np.testing.assert_allclose(points.own_score[:, deputy], own, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(points.own_score.sum(axis=1), points.team_score, rtol=1e-12)


def test_the_price_of_fuel_follows_the_score():
    overrides = ("steps_until_update=5", "inspected_points_update_bounds=[0.1, 0.4]", "horizon=5")
    path = configs_root() / "weighted-translational-inspection" / "experiment.yml"
    env = BatchedEnvironment(load_experiment(path, overrides).spec, 4, seed=1)
    env.reset()
    points = env.state.points["chief"]
    points.inspector[:], points.team_count[:] = 0, 100  # nothing is left to inspect: the scores stay
    points.team_score[:] = [0.5, 0.5, 0.2, 0.05]
    before = env.state.delta_v_scale.copy()
    for _ in range(5):
        found = coast(env)
    assert found.done.all()
    env.reset()
    for _ in range(5):
        coast(env)
    moved = env.state.delta_v_scale - before
    assert (moved[:2] < 0.0).all()
    assert (moved[2:] == 0.0).all()


def test_the_plugins_give_what_the_compiled_step_gives():
    spec = load_spec(TASK)
    fast, slow = TeamEnvironment(spec, 8, seed=5), TeamEnvironment(spec, 8, seed=5, _fused=False)
    assert np.array_equal(fast.reset()[0], slow.reset()[0])
    generator = np.random.default_rng(0)
    for _ in range(150):
        action = generator.integers(0, 3, (8, 1, 3)).astype(np.float64)
        one, other = fast.step((action,)), slow.step((action,))
        for name in ("observation", "reward", "status"):
            assert getattr(one.groups[0], name).tobytes() == getattr(other.groups[0], name).tobytes(), name
        if one.over.any():
            rows = np.flatnonzero(one.over)
            assert np.array_equal(fast.reset(rows)[0], slow.reset(rows)[0])
