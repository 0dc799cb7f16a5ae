from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.depth_camera import DepthFrame
from safe_inspect.rendezvous.front_end.base import FrontEndContext, Registration
from safe_inspect.rendezvous.front_end.cleaning import Cleaning
from safe_inspect.rendezvous.front_end.gicp import prepared_cloud, register
from safe_inspect.rendezvous.plugins import GicpSubmapFrontEnd
from safe_inspect.rendezvous.poses import Edge, difference, inverse, move, pose, rotation_exp

from .conftest import CAMERA, T_BC, Shoot, spin


def _degrees(edge: Edge, truth: list) -> float:
    expected = inverse(truth[edge.first]) @ truth[edge.second]
    return float(np.rad2deg(np.linalg.norm(difference(expected, edge.pose)[:3])))


def test_the_same_cloud_turned_is_registered(shoot: Shoot) -> None:
    points = Cleaning(CAMERA)(shoot(spin(1)[0], 0, "clean"), T_BC).points
    centre = points.mean(axis=0)
    turn = rotation_exp(np.deg2rad(4.0) * np.array([0.6, 0.6, 0.5]))
    truth = pose(turn, centre - turn @ centre)
    found = register(prepared_cloud(move(truth, points)), prepared_cloud(points), np.eye(4))
    assert np.rad2deg(np.linalg.norm(difference(truth, found.pose)[:3])) < 0.1
    assert found.inliers > 0.95


def test_a_plane_does_not_show_how_it_turns_about_its_normal() -> None:
    """What the surface does not show is taken from the prediction, and its variance says so."""
    random = np.random.default_rng(0)
    plane = np.column_stack([np.full(1500, 1.5), random.uniform(-0.2, 0.2, (1500, 2))])
    noisy = [prepared_cloud(plane + random.normal(size=plane.shape) * [4e-3, 0.0, 0.0]) for _ in range(2)]
    turns = {axis: pose(rotation_exp(np.deg2rad(2.0) * np.eye(3)[axis]), np.zeros(3)) for axis in (0, 1)}
    middle = pose(np.eye(3), np.array([1.5, 0.0, 0.0]))
    about_middle = {axis: middle @ turn @ inverse(middle) for axis, turn in turns.items()}
    found = register(*noisy, about_middle[0], is_predicted=True)
    assert np.rad2deg(difference(np.eye(4), found.pose)[0]) == pytest.approx(2.0, abs=0.5)
    sigma = np.rad2deg(np.sqrt(np.diag(found.covariance(10.0))[:3]))
    assert sigma[0] > 1.5
    # It shows how it turns about an axis within it, whatever is predicted.
    found = register(*noisy, about_middle[1], is_predicted=True)
    assert np.linalg.norm(np.rad2deg(difference(np.eye(4), found.pose)[1:3])) < 0.4
    assert np.rad2deg(np.sqrt(np.diag(found.covariance(10.0))[1:3])).max() < 1.0


def test_it_keeps_its_place_where_only_a_small_face_is_seen(streams: Streams, shoot: Shoot) -> None:
    """Envisat shows its small face, which turns about its own normal."""
    level = pose(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([0.0, -1.5, 0.0]))
    start = rotation_exp(np.array([0.0, 0.0, np.deg2rad(-65.0)]))
    rate = np.deg2rad(5.0) * np.array([-0.6, 0.1, 0.8]) / np.linalg.norm([0.6, 0.1, 0.8])
    truth = [inverse(pose(start @ rotation_exp(rate * k), np.zeros(3))) @ level for k in range(30)]
    run = GicpSubmapFrontEnd()(FrontEndContext(CAMERA, T_BC, None, streams))
    edges = [run.step(shoot(one, k, time=float(k)), None, np.eye(3)) for k, one in enumerate(truth)]
    assert all(edges[1:])
    assert max(_degrees(edge, truth) for step in edges for edge in step) < 6.0  # 42 without the prediction


def test_a_part_that_comes_into_view_does_not_stop_it(streams: Streams, shoot: Shoot) -> None:
    """The left part of the target alone is seen at first; then six tenths of a frame's points are known."""
    frames = []
    for k, one in enumerate(truth := spin(7, rate=1.0)):
        frame = shoot(one, k, time=float(k))
        columns = np.arange(frame.depth.shape[1]) < (105 if k < 5 else 224)
        depth = np.where(columns, frame.depth, 0.0)
        valid = frame.valid & columns
        frames.append(replace(frame, depth=depth, valid=valid))
    run = GicpSubmapFrontEnd()(FrontEndContext(CAMERA, T_BC, None, streams))
    edges = [run.step(frame, None, np.eye(3)) for frame in frames]
    assert all(edges[1:])
    assert edges[5][0].inliers < 0.7
    assert max(_degrees(edge, truth) for step in edges for edge in step) < 3.0


@pytest.mark.parametrize(
    ("inliers", "turn", "shift", "accepted"),
    [(0.65, 5.0, 0.05, True), (0.45, 5.0, 0.0, False), (0.45, 2.0, 0.02, True), (0.45, 2.0, 0.05, False),
     (0.25, 0.0, 0.0, False), (0.9, 12.0, 0.0, False)],
)  # fmt: skip
def test_few_common_points_suffice_where_the_prediction_is_confirmed(
    streams: Streams, shoot: Shoot, inliers: float, turn: float, shift: float, accepted: bool
) -> None:
    run = GicpSubmapFrontEnd()(FrontEndContext(CAMERA, T_BC, None, streams))
    run.step(shoot(spin(1)[0]), None, np.eye(3))
    middle = run.keyframes[0].cloud.points.mean(axis=0)
    rotation = rotation_exp(np.deg2rad([turn, 0.0, 0.0]))
    found = Registration(pose(rotation, middle - rotation @ middle + [0.0, shift, 0.0]), np.eye(6), 0.0, inliers, 1.0)
    assert run._accepts(np.eye(4), found) == accepted


def test_odometry_keyframes_and_skip_edges(streams: Streams, shoot: Shoot) -> None:
    truth = spin(14)
    run = GicpSubmapFrontEnd(loops=False)(FrontEndContext(CAMERA, T_BC, None, streams))
    edges = [run.step(shoot(one, k, time=float(k)), None, np.eye(3)) for k, one in enumerate(truth)]
    assert edges[0] == []
    assert all(edges[1:])
    kinds = {edge.kind for step in edges for edge in step}
    assert kinds == {"odometry", "skip"}
    assert np.median([_degrees(edge, truth) for step in edges for edge in step]) < 1.5
    numbers = [one.number for one in run.keyframes]
    assert numbers[0] == 0
    assert 3 <= len(numbers) <= 8


def test_a_revisited_view_gives_a_loop(streams: Streams, shoot: Shoot) -> None:
    there = spin(9, period=2.6)
    truth = [*there, *there[::-1]]
    run = GicpSubmapFrontEnd()(FrontEndContext(CAMERA, T_BC, None, streams))
    edges = [
        edge
        for k, one in enumerate(truth)
        for edge in run.step(shoot(one, k, "clean", 2.6 * k), None if k == 0 else inverse(truth[0]) @ one, np.eye(3))
    ]
    loops = [edge for edge in edges if edge.kind == "loop"]
    assert loops
    assert max(_degrees(edge, truth) for edge in loops) < 2.0


def test_it_finds_its_place_again_after_failures(streams: Streams, shoot: Shoot) -> None:
    truth = spin(8)
    frames = [shoot(one, k, "clean", float(k)) for k, one in enumerate(truth)]
    empty = np.zeros_like(frames[0].depth)
    lost = [DepthFrame(8.0 + k, empty, np.zeros((0, 3)), empty > 0.0, ("out_of_view",)) for k in range(4)]
    run = GicpSubmapFrontEnd()(FrontEndContext(CAMERA, T_BC, None, streams))
    for frame in [*frames, *lost]:
        run.step(frame, None, np.eye(3))
    # The target is back in an attitude of before, far from what its motion predicts.
    edges = run.step(shoot(truth[1], 99, "clean", 40.0), None, np.eye(3))
    if edges:
        assert edges[0].kind == "relocalised"
        truth.append(truth[1])
        again = Edge(edges[0].first, 8, edges[0].pose, edges[0].covariance, edges[0].inliers)
        assert _degrees(again, truth) < 3.0
    else:
        pytest.fail("not found again")
