"""The factor graph: exact data, its Jacobians, missing frames, and its bounded size."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.estimation.change import centre_innovation
from safe_inspect.rendezvous.estimation.factors import ImuBuffer, key, rotation_kinematic_factors
from safe_inspect.rendezvous.estimation.graph import ISAM2BackEnd, PoseGraph
from safe_inspect.rendezvous.estimation.states import CentrePrior, ChaserStart, GraphEstimate
from safe_inspect.rendezvous.inertial_unit import ImuNoise
from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.poses import MODEL, Edge, difference, inverse, perturbed, pose, skew
from safe_inspect.rendezvous.target.boxes import EnvisatTarget
from safe_inspect.testing.rendezvous import watched_poses
from safe_inspect.types import FloatArray

_TARGET = EnvisatTarget()()
_R_WB = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_START = ChaserStart(pose(_R_WB, np.array([0.0, -1.5, 0.0])), np.zeros(3))


def _empty(centre: CentrePrior, largest: int = 600) -> PoseGraph:
    """Return the graph of a chaser at rest whose poses to the model have independent errors."""
    return PoseGraph(ImuBuffer(ImuNoise(), 0.1), _START, centre, ISAM2BackEnd(largest=largest, memory=0.0))


def _graph(edges: list[Edge], frames: list[int], centre: CentrePrior, largest: int = 600) -> PoseGraph:
    """Return the graph of a chaser at rest, one frame a second."""
    graph = _empty(centre, largest)
    for before, frame in itertools.pairwise(frames):
        for _ in range(10 * (frame - before)):
            graph.imu.add(np.zeros(3), np.zeros(3), 0.1)
        graph.update(frame, [edge for edge in edges if edge.second == frame])
    return graph


def _noisy(poses: list[FloatArray], seed: int, skips: int = 1) -> list[Edge]:
    sigmas = np.repeat([np.deg2rad(0.4), 4e-3], 3)
    draws = Streams(seed, np.zeros(1, np.int64), np.zeros(1, np.int64))
    edges = []
    for j in range(1, len(poses)):
        for i in range(max(j - skips, 0), j):
            error = sigmas * draws.normal("edge", 6, 10 * j + j - i)[0]
            edges.append(Edge(i, j, perturbed(inverse(poses[i]) @ poses[j], error), np.diag(sigmas**2), 1.0))
    return edges


def edges_of(poses: list[FloatArray], *, model: bool) -> list[Edge]:
    """Return exact edges between consecutive poses and, if `model`, to the model."""
    covariance = 1e-6 * np.eye(6)
    edges = [Edge(k - 1, k, inverse(poses[k - 1]) @ poses[k], covariance, 1.0) for k in range(1, len(poses))]
    return edges + [Edge(MODEL, k, T_MB, covariance, 1.0, "model") for k, T_MB in enumerate(poses) if model]


@pytest.mark.parametrize("model", [False, True])
def test_exact_edges_give_exact_poses(model: bool) -> None:
    poses = watched_poses(_TARGET, 30)
    estimate = _graph(edges_of(poses, model=model), list(range(30)), CentrePrior(np.zeros(3), 0.3)).estimate()
    assert estimate.relative is not None
    error = difference(inverse(poses[0]) @ poses[-1], estimate.relative)
    assert np.rad2deg(np.linalg.norm(error[:3])) < 1e-4
    assert np.linalg.norm(error[3:]) < 1e-6
    np.testing.assert_allclose(estimate.centre, 0.0, atol=1e-6)
    np.testing.assert_allclose(estimate.chaser, _START.pose, atol=1e-6)
    np.testing.assert_allclose(estimate.centre_glued, [1.5, 0.0, 0.0], atol=1e-6)
    if model:
        assert estimate.model is not None
        np.testing.assert_allclose(estimate.model, inverse(poses[0]), atol=1e-6)


def test_a_thrusting_chaser_is_followed_exactly() -> None:
    """With a constant acceleration the positions are half its square of time; the edges see them."""
    acceleration, frames = np.array([2e-3, 1e-3, -1e-3]), 12
    still = watched_poses(_TARGET, frames)
    model = [T_MB @ inverse(_START.pose) for T_MB in still]  # T_MW of each frame
    truth = [pose(_R_WB, _START.pose[:3, 3] + 0.5 * k * k * acceleration) for k in range(frames)]
    poses = [T_MW @ T_WB for T_MW, T_WB in zip(model, truth, strict=True)]
    graph = _empty(CentrePrior(np.zeros(3), 0.3))
    for edge in edges_of(poses, model=False):
        for _ in range(10):
            graph.imu.add(_R_WB.T @ acceleration, np.zeros(3), 0.1)
        graph.update(edge.second, [edge])
    estimate = graph.estimate()
    np.testing.assert_allclose(estimate.chaser, truth[-1], atol=1e-6)
    np.testing.assert_allclose(estimate.velocity, (frames - 1) * acceleration, atol=1e-6)


@pytest.mark.parametrize("end", [10, 30], ids=["back", "stays"])
def test_a_jump_of_the_bias_is_found_from_the_frames(end: int) -> None:
    """The accelerometers' bias jumps between two frames, and is seen to after three; later it may jump back."""
    jump, poses, rng = np.array([0.02, -0.02, 0.02]), watched_poses(_TARGET, 25), np.random.default_rng(0)
    graphs = [_empty(CentrePrior(np.zeros(3), 0.01)) for _ in range(2)]
    for is_told, graph in enumerate(graphs):
        for edge in (edge for edge in edges_of(poses, model=True) if edge.first == MODEL and edge.second):
            for _ in range(10):
                graph.imu.add(jump * (5 <= edge.second - 1 < end) + 1e-4 * rng.standard_normal(3), np.zeros(3), 0.1)
            seen = replace(edge, covariance=25.0 * edge.covariance)
            graph.update(edge.second, [seen], jumped=bool(is_told) and edge.second in (8, end + 3))
    untold, told = (graph.estimate() for graph in graphs)
    assert np.linalg.norm(told.chaser[:3, 3] - _START.pose[:3, 3]) < 5e-3
    assert np.linalg.norm(told.velocity) < 3e-3
    np.testing.assert_allclose(told.bias[:3], jump * (end > 25), atol=3e-3)
    assert np.linalg.norm(untold.chaser[:3, 3] - _START.pose[:3, 3]) > 0.1


def test_a_chaser_without_inertial_samples_is_followed_by_the_frames() -> None:
    """It is pushed while the unit is silent; what the unit says after it is believed again."""
    acceleration, poses = np.array([0.01, 0.0, -0.01]), watched_poses(_TARGET, 24)
    graph = _empty(CentrePrior(np.zeros(3), 0.01))
    moved, velocity = np.zeros(3), np.zeros(3)
    for k in range(1, 24):
        silent = 8 <= k < 16
        for _ in range(10):
            push = acceleration * silent
            moved, velocity = moved + 0.1 * velocity + 5e-3 * push, velocity + 0.1 * push
            if silent:
                graph.imu.coast(0.1, np.zeros(6))
            else:
                graph.imu.add(np.zeros(3), np.zeros(3), 0.1)
        T_MB = poses[k] @ inverse(_START.pose) @ pose(_R_WB, _START.pose[:3, 3] + moved)  # noqa: N806
        graph.update(k, [Edge(MODEL, k, T_MB, 1e-6 * np.eye(6), 1.0, "model")])
        if k in (12, 23):
            estimate = graph.estimate()
            np.testing.assert_allclose(estimate.chaser[:3, 3], _START.pose[:3, 3] + moved, atol=0.01)
            np.testing.assert_allclose(estimate.velocity, velocity, atol=0.01 if silent else 2e-3)


def test_a_chaser_without_inertial_samples_flies_as_commanded() -> None:
    """Pushed and turned about the same axis, it is where the closed form says, without a single frame."""
    gtsam = pytest.importorskip("gtsam")
    imu, rate, push, turn = ImuBuffer(ImuNoise(), 0.1), 0.2, 0.03, -0.01
    imu.restart(gtsam.imuBias.ConstantBias(np.array([0.0, 0.0, 1e-3]), np.zeros(3)))
    imu.add(np.array([0.0, 0.0, 1e-3]), np.array([0.0, 0.0, rate]), 0.1)
    for _ in range(20):
        imu.coast(0.1, np.array([0.0, 0.0, push, 0.0, 0.0, turn]))
    found, velocity = imu.predict(gtsam.Pose3(), np.zeros(3), imu._bias)
    assert velocity[2] == pytest.approx(push * 2.0, abs=1e-12)
    assert found.translation()[2] == pytest.approx(0.5 * push * 4.0, abs=1e-12)
    angle = np.linalg.norm(gtsam.Rot3.Logmap(found.rotation()))
    assert angle == pytest.approx(rate * 2.1 + 0.5 * turn * 4.0, abs=1e-12)
    assert imu.last_rate[2] == pytest.approx(rate + turn * 2.0, abs=1e-12)


@pytest.mark.parametrize("reached", [True, False])
def test_a_frame_after_a_refused_one_has_an_innovation(reached: bool) -> None:
    """A pose relative to the model determines the centre in B, whether the previous frame has an edge or not."""
    edge = edges_of(watched_poses(_TARGET, 1), model=True)[0]
    tight = 1e-4 * np.eye(3)
    graph = GraphEstimate(
        3, _START.pose, np.zeros(3), np.zeros(6), np.eye(4) if reached else None, np.zeros(3), np.zeros(3), np.eye(4),
        np.eye(6), tight, tight,
    )  # fmt: skip
    assert centre_innovation(graph, _START.pose, edge) < 1e-6
    away = pose(_R_WB, _START.pose[:3, 3] + np.array([0.1, 0.0, 0.0]))
    assert centre_innovation(graph, away, edge) > 3.0


def test_the_rotation_kinematic_factor_has_the_analytic_jacobians() -> None:
    """Eliminating the auxiliary point gives that of e = X^-1 p - G^-1 o, with its stated deviation."""
    gtsam, sigma = require("gtsam"), 5e-3
    x, g = perturbed(np.eye(4), np.array([0.3, -0.2, 0.5, 0.1, -1.2, 0.4])), perturbed(np.eye(4), np.full(6, 0.4))
    p = np.array([0.2, 0.1, -0.3])
    seen = inverse(x)[:3, :3] @ p + inverse(x)[:3, 3]
    o = g[:3, :3] @ seen + g[:3, 3]
    values, graph = gtsam.Values(), gtsam.NonlinearFactorGraph()
    for name, value in (("X", gtsam.Pose3(x)), ("G", gtsam.Pose3(g)), ("Y", seen), ("P", p), ("O", o)):
        values.insert(key(name), value)
    for factor in rotation_kinematic_factors(0, sigma):
        graph.add(factor)
    assert graph.error(values) < 1e-20
    ordering = gtsam.Ordering()
    sizes = {"X": 6, "G": 6, "O": 3, "P": 3, "Y": 3}
    for name in sizes:
        ordering.push_back(key(name))
    hessian = graph.linearize(values).hessian(ordering)[0]
    kept, y = slice(0, 18), slice(18, 21)
    reduced = hessian[kept, kept] - hessian[kept, y] @ np.linalg.solve(hessian[y, y], hessian[y, kept])
    analytic = np.hstack([skew(seen), -np.eye(3), -skew(seen), np.eye(3), -g[:3, :3].T, x[:3, :3].T])
    np.testing.assert_allclose(reduced, analytic.T @ analytic / sigma**2, rtol=1e-7, atol=1e-3)
    numeric = np.empty((3, 12))
    for i in range(12):
        steps = np.zeros((2, 12))
        steps[:, i] = 1e-6, -1e-6
        both = [
            (lambda a, b: a[:3, :3].T @ (p - a[:3, 3]) - b[:3, :3].T @ (o - b[:3, 3]))(
                perturbed(x, step[:6]), perturbed(g, step[6:])
            )
            for step in steps
        ]
        numeric[:, i] = (both[0] - both[1]) / 2e-6
    np.testing.assert_allclose(analytic[:, :12], numeric, atol=1e-8)


def test_the_incremental_solution_is_that_of_a_batch() -> None:
    poses = watched_poses(_TARGET, 40)
    graph = _graph(_noisy(poses, 1, skips=3), list(range(40)), CentrePrior(np.array([0.2, -0.1, 0.1]), 0.3))
    solver = graph._solver
    optimiser = require("gtsam").LevenbergMarquardtOptimizer(solver.getFactorsUnsafe(), solver.calculateEstimate())
    relative, batch = graph.relative_poses(), optimiser.optimize()
    angles = [np.linalg.norm(difference(relative[k], batch.atPose3(key("G", k)).matrix())[:3]) for k in relative]
    assert np.rad2deg(max(angles)) < 0.6


def test_frames_without_edges_are_bridged() -> None:
    poses = watched_poses(_TARGET, 30)
    frames = [k for k in range(30) if not 10 <= k < 16]
    edges = [Edge(i, j, inverse(poses[i]) @ poses[j], np.eye(6) * 1e-6, 1.0) for i, j in itertools.pairwise(frames)]
    estimate = _graph(edges, frames, CentrePrior(np.zeros(3), 0.3)).estimate()
    assert estimate.relative is not None
    np.testing.assert_allclose(estimate.relative, inverse(poses[0]) @ poses[-1], atol=1e-6)


def test_a_model_that_nothing_relates_to_older_frames_restarts() -> None:
    poses = watched_poses(_TARGET, 20)
    edges = [edge for edge in edges_of(poses, model=True) if (edge.second < 8) == (edge.first != MODEL)]
    graph = _graph(edges, list(range(20)), CentrePrior(np.array([0.2, 0.0, -0.1]), 0.3))
    estimate = graph.estimate()
    assert min(graph.relative_poses()) == 8
    assert estimate.relative is not None
    assert estimate.model is not None
    np.testing.assert_allclose(estimate.relative, inverse(poses[8]) @ poses[-1], atol=1e-5)
    np.testing.assert_allclose(inverse(estimate.model) @ estimate.relative, poses[-1], atol=1e-5)
    np.testing.assert_allclose(estimate.centre, 0.0, atol=2e-3)


def test_the_graph_stays_bounded() -> None:
    poses = watched_poses(_TARGET, 40)
    graph = _graph(edges_of(poses, model=True), list(range(40)), CentrePrior(np.array([0.1, 0.0, 0.1]), 0.3), 12)
    assert len(graph.frames) <= 12
    estimate = graph.estimate()
    assert estimate.relative is not None
    error = difference(inverse(poses[0]) @ poses[-1], estimate.relative)
    assert np.rad2deg(np.linalg.norm(error[:3])) < 0.01
    np.testing.assert_allclose(estimate.centre, 0.0, atol=5e-3)


def _measured(*, odometry: bool, model: bool) -> list[Edge]:
    """Return noisy edges of 60 frames; poses relative to the model begin at the seventh frame."""
    poses, rng = watched_poses(_TARGET, 60), np.random.default_rng(0)
    sigma = 4e-3
    of_model = [
        Edge(MODEL, k, perturbed(T_MB, sigma * rng.normal(size=6)), sigma**2 * np.eye(6), 1.0, "model")
        for k, T_MB in enumerate(poses)
        if k > 5
    ]
    return [*(_noisy(poses, 3, 2) if odometry else []), *(of_model if model else [])]


def _errors(covariance: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.diag(covariance)))


@pytest.mark.parametrize(("odometry", "model"), [(True, True), (True, False), (False, True)])
def test_the_elimination_of_older_frames_loses_nothing(odometry: bool, model: bool) -> None:
    """Nine times half of the frames are eliminated; estimate and covariances are those of the whole graph."""
    edges, centre = _measured(odometry=odometry, model=model), CentrePrior(np.zeros(3), 0.3)
    whole, part = (_graph(edges, list(range(60)), centre, largest).estimate() for largest in (600, 12))
    assert whole.relative is not None
    assert part.relative is not None
    # Factors are linearised once when they are eliminated, which matters for odometry alone.
    near = 2e-4 if model else 0.01
    np.testing.assert_allclose(part.chaser, whole.chaser, atol=near)
    np.testing.assert_allclose(part.relative, whole.relative, atol=near)
    np.testing.assert_allclose(part.centre, whole.centre, atol=near)
    for name in ("chaser_covariance", "velocity_covariance", "centre_covariance"):
        np.testing.assert_allclose(_errors(getattr(part, name)), _errors(getattr(whole, name)), rtol=0.01, err_msg=name)


def test_a_model_that_comes_after_an_elimination_keeps_the_motion_of_the_chaser() -> None:
    edges = [one for one in _measured(odometry=True, model=True) if (one.second < 30) == (one.first != MODEL)]
    edges = [one for one in edges if not 30 <= one.second < 33]
    whole, part = (
        _graph(edges, list(range(60)), CentrePrior(np.zeros(3), 0.3), largest).estimate() for largest in (600, 12)
    )
    np.testing.assert_allclose(part.chaser, whole.chaser, atol=0.05)
    # The eliminated odometry still shows where the centre of mass is in W.
    assert (_errors(part.chaser_covariance) <= 1.01 * _errors(whole.chaser_covariance)).all()
    np.testing.assert_allclose(_errors(part.centre_covariance), _errors(whole.centre_covariance), rtol=0.01)


def _nees(estimate: GraphEstimate) -> float:
    """Return the squared error of the centre in B over its covariance; nothing is aligned to the truth."""
    found = estimate.chaser[:3, :3].T @ (estimate.centre - estimate.chaser[:3, 3])
    error = found - np.array([1.5, 0.0, 0.0])
    return float(error @ np.linalg.solve(estimate.centre_covariance, error))


@pytest.mark.slow
def test_the_covariance_of_the_centre_is_consistent() -> None:
    poses = watched_poses(_TARGET, 40)
    guess = Streams(7, np.arange(16), np.zeros(16, np.int64)).normal("centre", 3) * 0.2
    found = [
        _nees(_graph(_noisy(poses, seed), list(range(40)), CentrePrior(guess[seed], 0.2)).estimate())
        for seed in range(16)
    ]
    # The mean of 16 squares with 3 degrees of freedom each: 99.8 % are between 1.3 and 5.5.
    assert 0.8 < np.mean(found) < 5.5
