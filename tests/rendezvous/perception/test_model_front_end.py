from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from safe_inspect.config.data import configs_root
from safe_inspect.errors import ConfigError
from safe_inspect.geometry.pointing import point_camera
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.depth_camera import DepthFrame, TimeOfFlightCamera
from safe_inspect.rendezvous.experiment import load_rendezvous
from safe_inspect.rendezvous.front_end import model
from safe_inspect.rendezvous.front_end.base import FrontEndContext, Registration, RelativeMotion
from safe_inspect.rendezvous.front_end.cleaning import Cleaning, Cloud
from safe_inspect.rendezvous.front_end.model_registration import (
    ModelRegistration,
    _of_exact_normals,
    _spread_rotations,
    acquire,
)
from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.plugins import BoxTarget, ModelFrontEnd
from safe_inspect.rendezvous.poses import MODEL, Edge, difference, inverse, perturbed, pose, rotation_exp
from safe_inspect.rendezvous.target.model import Target, TriangleMesh
from safe_inspect.rendezvous.target.solid import MeshSolid

from .conftest import CAMERA, T_BC, Shoot, spin

_PRIOR = np.diag(np.repeat([np.deg2rad(2.0), 0.02], 3) ** -2.0)


def _degrees(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.rad2deg(np.linalg.norm(difference(first, second)[:3])))


def _run(target: Target, streams: Streams, frames: list[DepthFrame], **options: float) -> list[list[Edge]]:
    run = ModelFrontEnd(**options)(FrontEndContext(CAMERA, T_BC, target, streams))
    return [run.step(frame, None, np.eye(3)) for frame in frames]


@pytest.mark.parametrize("number", range(4))
def test_registration_to_the_model_recovers_a_pose(target: Target, shoot: Shoot, number: int) -> None:
    truth = spin(4, period=11.0)[number]
    cloud = Cleaning(CAMERA)(shoot(truth, number, "clean"), T_BC)
    random = np.random.default_rng(number)
    start = perturbed(truth, np.concatenate([np.deg2rad(1.0) * random.normal(size=3), 0.01 * random.normal(size=3)]))
    found = ModelFrontEnd().registration(target, CAMERA, T_BC)(cloud, start, _PRIOR)
    assert _degrees(truth, found.pose) < 0.6
    assert found.inliers > 0.9
    error = difference(truth, found.pose)
    assert error @ np.linalg.solve(found.covariance(), error) / 6.0 < 6.0


def test_where_a_registration_ends_does_not_depend_on_its_start(target: Target, shoot: Shoot) -> None:
    """If it did, errors would pass from a prediction to the next frame, and the graph counts them as independent."""
    registration, cleaning = ModelFrontEnd().registration(target, CAMERA, T_BC), Cleaning(CAMERA, edge=np.inf)
    random, apart = np.random.default_rng(5), []
    for number, truth in enumerate(spin(20, period=7.0)):
        cloud = cleaning(shoot(truth, number), T_BC).thinned(1500)
        error = np.repeat([np.deg2rad(0.3), 3e-3], 3) * random.normal(size=6)
        ends = [registration(cloud, start).pose for start in (truth, perturbed(truth, error))]
        apart.append(difference(*ends))
    turns, shifts = (np.linalg.norm(np.array(apart)[:, part], axis=1) for part in (slice(3), slice(3, 6)))
    assert np.rad2deg(np.median(turns)) < 0.02
    assert np.median(shifts) < 4e-4


def test_a_search_finds_the_pose_without_a_prediction(target: Target, shoot: Shoot) -> None:
    registration, cleaning = ModelFrontEnd().registration(target, CAMERA, T_BC), Cleaning(CAMERA)
    for number, truth in enumerate(spin(1, first=(0.9, 0.2, 0.5))):
        found = acquire(registration, cleaning(shoot(truth, number), T_BC))
        assert min(_degrees(truth, one.pose) for one in found[:2]) < 3.0
        assert [one.score for one in found] == sorted(one.score for one in found)


@pytest.mark.parametrize(
    "place",
    [
        (0.501, -2.04, 1.263, 1.046, -0.04, -1.075),
        (0.554, -0.666, 2.817, 1.367, -0.152, -0.599),
        (-0.576, -1.913, -0.987, 0.755, -0.01, -1.296),
    ],
)
def test_a_search_finds_a_shape_of_which_a_part_is_out_of_the_image(
    target: Target, shoot: Shoot, place: tuple[float, ...]
) -> None:
    """The centroid of the frame is not that of the shape, and the right attitude alone ends 10 to 13 cm off."""
    registration, cleaning = ModelFrontEnd().registration(target, CAMERA, T_BC), Cleaning(CAMERA, edge=np.inf)
    truth = pose(rotation_exp(np.array(place[:3])), np.array(place[3:]))
    error = difference(truth, acquire(registration, cleaning(shoot(truth), T_BC).thinned(1500))[0].pose)
    assert np.rad2deg(np.linalg.norm(error[:3])) < 1.0
    assert np.linalg.norm(error[3:]) < 0.02


def test_a_shape_that_would_hide_what_is_seen_does_not_fit(target: Target, shoot: Shoot) -> None:
    """From above the bus, Envisat and its half turn differ in a plate alone, which the camera would not see through."""
    registration, half = (
        ModelFrontEnd().registration(target, CAMERA, T_BC),
        pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3)),
    )
    for number, position in enumerate(np.array([[-0.4, -0.4, 1.4], [0.1, -0.9, 1.2], [0.2, -1.2, 0.9]])):
        truth = pose(point_camera(np.eye(3), position, np.zeros(3)) @ T_BC[:3, :3].T, position)
        cloud = Cleaning(CAMERA, edge=np.inf)(shoot(truth, number), T_BC)
        right, wrong = (registration(cloud, one @ truth, iterations=25, widening=2.5) for one in (np.eye(4), half))
        assert right.score < 7e-3
        assert wrong.score > right.score + 7e-4


@pytest.mark.parametrize("place", [(1.37, -0.08, 0.05), (1.37, 0.0, 0.1)])
def test_a_plate_that_is_too_flat_to_be_measured_hides_what_is_behind_it(
    target: Target, shoot: Shoot, place: tuple[float, ...]
) -> None:
    """Along Envisat's solar array: a part of the array returns no ranges, and hides half of the bus."""
    position = np.array(place)
    truth = pose(point_camera(np.eye(3), position, np.zeros(3)), position) @ inverse(T_BC)
    cloud = Cleaning(CAMERA, edge=np.inf)(shoot(truth), T_BC).thinned(1500)
    found = ModelFrontEnd().registration(target, CAMERA, T_BC)(cloud, truth, iterations=25, widening=2.5)
    assert _degrees(truth, found.pose) < 0.6
    assert found.score < 3e-3


def test_spread_rotations_leave_no_gap() -> None:
    grid, random = _spread_rotations(600), np.random.default_rng(0)
    for _ in range(30):
        one = rotation_exp(random.uniform(-np.pi, np.pi) * np.eye(3)[random.integers(3)])
        cosine = 0.5 * (np.einsum("nij,ij->n", grid, one).max() - 1.0)
        assert np.rad2deg(np.arccos(cosine)) < 25.0


def test_the_front_end_gives_poses_that_do_not_drift(target: Target, streams: Streams, shoot: Shoot) -> None:
    truth = spin(25, first=(1.3, 0.0, 0.2))  # half a turn of the shape looks alike at first
    edges = _run(target, streams, [shoot(one, k, time=float(k)) for k, one in enumerate(truth)])
    assert edges[0] == []
    model = [edge for step in edges for edge in step if edge.first == MODEL]
    assert len(model) > 15
    errors = [_degrees(truth[edge.second], edge.pose) for edge in model]
    assert np.median(errors) < 0.6
    assert np.median(errors[-10:]) < 0.8
    nees = [
        (e := difference(truth[edge.second], edge.pose)) @ np.linalg.solve(edge.covariance, e) / 6.0 for edge in model
    ]
    assert 0.2 < np.mean(nees) < 4.0
    # Before, frames are related to the first one, and in the frame of the decision both edges stand.
    early = [edge for step in edges for edge in step if edge.first != MODEL]
    assert {edge.first for edge in early} == {0}
    assert model[0].second == early[-1].second
    assert np.median([_degrees(inverse(truth[0]) @ truth[edge.second], edge.pose) for edge in early]) < 1.5


@pytest.mark.slow
def test_the_same_frames_give_the_same_bytes(target: Target, streams: Streams, shoot: Shoot) -> None:
    frames = [shoot(one, k, time=float(k)) for k, one in enumerate(spin(3))]
    first, second = (_run(target, streams, frames) for _ in range(2))
    assert [[edge.pose.tobytes() for edge in step] for step in first] == [
        [edge.pose.tobytes() for edge in step] for step in second
    ]


@pytest.mark.slow
def test_it_recovers_when_the_target_was_out_of_view(target: Target, streams: Streams, shoot: Shoot) -> None:
    truth = spin(12)
    frames = [shoot(one, k, time=float(k)) for k, one in enumerate(truth)]
    empty = np.zeros_like(frames[0].depth)
    frames[4:8] = [DepthFrame(float(k), empty, np.zeros((0, 3)), empty > 0.0, ("out_of_view",)) for k in range(4, 8)]
    edges = _run(target, streams, frames)
    assert all(step == [] for step in edges[4:8])
    assert all(edges[10:])
    last = edges[-1][-1]
    expected = truth[last.second] if last.first == MODEL else inverse(truth[last.first]) @ truth[last.second]
    assert _degrees(expected, last.pose) < 2.0


def test_poses_that_become_the_same_are_followed_as_one(
    target: Target, streams: Streams, shoot: Shoot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They fit every later frame equally well, so that no view would decide between them."""
    truth = spin(2)

    def found(registration: ModelRegistration, cloud: Cloud, **_: int) -> list[Registration]:
        right = registration(cloud, truth[0])
        return [right, replace(right, pose=perturbed(right.pose, np.array([0.2, 0.0, 0.0, 0.0, 0.0, 0.0])))]

    monkeypatch.setattr(model, "acquire", found)
    first, second = _run(target, streams, [shoot(one, k, time=float(k)) for k, one in enumerate(truth)])
    assert first == []
    since, known = second
    assert (since.first, since.second, known.first) == (0, 1, MODEL)
    assert _degrees(truth[1], known.pose) < 1.0


@pytest.mark.parametrize("rate", [3.0, 10.0])
def test_a_motion_that_is_not_known_yet_is_followed(
    target: Target, streams: Streams, shoot: Shoot, monkeypatch: pytest.MonkeyPatch, rate: float
) -> None:
    """At 10 deg/s the chaser moves 0.26 m about the target between two frames."""
    truth = spin(2, rate=rate)
    monkeypatch.setattr(model, "acquire", lambda registration, cloud, **_: [registration(cloud, truth[0])])
    _, (edge,) = _run(target, streams, [shoot(one, k, time=float(k)) for k, one in enumerate(truth)])
    assert edge.first == MODEL
    assert _degrees(truth[1], edge.pose) < 1.0


def test_a_frame_that_the_right_pose_does_not_match_decides_nothing(
    target: Target, streams: Streams, shoot: Shoot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The score of a registration that ended elsewhere says nothing about the pose that it started from."""
    truth, half = spin(3), pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    registered = ModelRegistration.__call__

    def fails_once(one: ModelRegistration, cloud: Cloud, start: np.ndarray, *rest: np.ndarray, **options: Any) -> Any:
        found = registered(one, cloud, start, *rest, **options)
        return replace(found, score=0.02) if _degrees(truth[1], found.pose) < 2.0 else found

    def search(registration: ModelRegistration, cloud: Cloud, **_: int) -> list[Registration]:
        right = registration(cloud, truth[0])
        return [right, replace(right, pose=half @ right.pose)]

    monkeypatch.setattr(model, "acquire", search)
    monkeypatch.setattr(ModelRegistration, "__call__", fails_once)
    edges = _run(target, streams, [shoot(one, k, time=float(k)) for k, one in enumerate(truth)])
    assert [edge.first for edge in edges[1]] == [0]  # not decided
    assert all(_degrees(truth[2], edge.pose) < 2.0 for edge in edges[2] if edge.first == MODEL)


def test_frames_that_fit_worse_than_before_decide_nothing(
    target: Target, streams: Streams, shoot: Shoot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a plate seen from its edge most pixels are flying ones, and it is chance which pose they match."""
    truth, half, unclear = spin(10, rate=2.0), pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3)), range(2, 8)
    registered = ModelRegistration.__call__

    def searched(registration: ModelRegistration, cloud: Cloud, **_: int) -> list[Registration]:
        right = registration(cloud, truth[0])
        return [replace(right, score=0.003), replace(right, pose=half @ right.pose, score=0.003)]

    def edge_on(one: ModelRegistration, cloud: Cloud, start: np.ndarray, *rest: np.ndarray, **options: Any) -> Any:
        found = registered(one, cloud, start, *rest, **options)
        is_right = found.pose[:3, 3] @ truth[0][:3, 3] > 0.0
        if any(_degrees(truth[k], found.pose) < 1.0 or _degrees(half @ truth[k], found.pose) < 1.0 for k in unclear):
            return replace(found, score=0.012 if is_right else 0.009)
        return replace(found, score=0.003 if is_right else 0.006)

    monkeypatch.setattr(model, "acquire", searched)
    monkeypatch.setattr(ModelRegistration, "__call__", edge_on)
    edges = _run(target, streams, [shoot(one, k, time=float(k)) for k, one in enumerate(truth)])
    found = [edge for step in edges for edge in step if edge.first == MODEL]
    assert all(_degrees(truth[edge.second], edge.pose) < 2.0 for edge in found)
    assert [edge.first for edge in edges[7]] == [0]  # not decided by then


def test_no_view_decides_alone(target: Target, streams: Streams, shoot: Shoot, monkeypatch: pytest.MonkeyPatch) -> None:
    truth = spin(1)

    def searched(registration: ModelRegistration, cloud: Cloud, **_: int) -> list[Registration]:
        right = registration(cloud, truth[0])
        turned = replace(right, pose=pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3)) @ right.pose)
        return [replace(turned, score=0.002), replace(right, score=0.0055)]

    monkeypatch.setattr(model, "acquire", searched)
    assert _run(target, streams, [shoot(one, k, time=float(k)) for k, one in enumerate(truth)]) == [[]]


def test_all_poses_of_a_cube_are_followed_until_they_differ(streams: Streams) -> None:
    cube = {"boxes": [{"centre": ["0 m"] * 3, "half_size": ["0.2 m"] * 3}], "mating_point": ["0 m", "0 m", "0.6 m"]}
    target = BoxTarget.model_validate(cube)()
    renderer = TimeOfFlightCamera(profile="clean")(target)
    front_end = ModelFrontEnd()(FrontEndContext(CAMERA, T_BC, target, streams))
    truth = spin(3)
    edges = []
    for number, one in enumerate(truth):
        eye = one @ T_BC
        frame = renderer.render(eye[:3, :3], eye[:3, 3], streams, number, float(number))
        edges.append(front_end.step(frame, None, np.eye(3)))
    # The attitude relative to the cube stays unknown, and the motion since the first frame does not.
    assert edges[0] == []
    for number in (1, 2):
        (edge,) = edges[number]
        assert (edge.first, edge.second) == (0, number)
        assert _degrees(inverse(truth[0]) @ truth[number], edge.pose) < 1.0


def test_it_needs_a_known_shape(streams: Streams) -> None:
    with pytest.raises(ConfigError, match="GicpSubmapFrontEnd"):
        ModelFrontEnd()(FrontEndContext(CAMERA, T_BC, None, streams))


def test_constant_motion_is_predicted_exactly() -> None:
    truth = spin(5, period=0.7)
    turn = rotation_exp(np.array([0.02, -0.01, 0.03]))  # the chaser turns between frames
    seen = [one @ pose(np.linalg.matrix_power(turn, k), np.zeros(3)) for k, one in enumerate(truth)]
    motion = RelativeMotion(0.0, seen[0])
    for k in range(1, 5):
        motion.turned(turn)
        if k > 2:
            np.testing.assert_allclose(motion.predict(0.7 * k), seen[k], atol=1e-9)
        motion.observe(0.7 * k, seen[k])


def test_close_to_the_target_the_shape_does_not_slide(target: Target, shoot: Shoot) -> None:
    # Parts nearer than the camera measures, and the image's border, must not pull: a plane in front has no silhouette.
    cleaning, registration = Cleaning(CAMERA, edge=np.inf), ModelFrontEnd().registration(target, CAMERA, T_BC)
    mating_point = target.R_MT @ target.mating_point
    camera, offset = np.eye(3), np.zeros(6)
    for number, share in enumerate(np.linspace(1.8, 1.0, 6)):
        position = share * mating_point + np.array([0.0, 0.12 * (share - 1.0), 0.0])
        camera = point_camera(camera, position, np.zeros(3))
        truth = pose(camera @ T_BC[:3, :3].T, position)
        start = perturbed(truth, offset)  # the error of the last frame stays in the prediction
        found = registration(cleaning(shoot(truth, number), T_BC), start, _PRIOR)
        offset = difference(truth, found.pose)
        assert np.linalg.norm(offset[3:]) < 0.015
        assert np.rad2deg(np.linalg.norm(offset[:3])) < 1.0
        assert offset @ np.linalg.solve(found.covariance(), offset) / 6.0 < 8.0


def test_the_errors_of_attitude_hold_at_the_mating_point(target: Target, shoot: Shoot) -> None:
    """What the model leaves out turns a small patch more than the whole target."""
    cleaning, registration = Cleaning(CAMERA, edge=np.inf), ModelFrontEnd().registration(target, CAMERA, T_BC)
    random, nees = np.random.default_rng(2), []
    mating_point, corner = target.R_MT @ target.mating_point, target.R_MT @ target.landmark
    for number in range(12):
        position = mating_point + 0.01 * random.normal(size=3)
        camera = point_camera(rotation_exp(0.3 * random.normal(size=3)), position, corner)
        truth = pose(camera @ T_BC[:3, :3].T, position)
        found = registration(cleaning(shoot(truth, number), T_BC), truth, _PRIOR)
        turn = difference(truth, found.pose)[:3]
        nees.append(turn @ np.linalg.solve(found.covariance()[:3, :3], turn) / 3.0)
    assert 0.1 < np.mean(nees) < 2.0


def test_parts_that_seem_apart_are_used_together(target: Target, shoot: Shoot) -> None:
    """From beyond the array's tip its edge and the bus behind it are seen, and nothing between them."""
    position = np.array([1.36, -0.21, -0.08])
    truth = pose(point_camera(np.eye(3), position, np.zeros(3)) @ T_BC[:3, :3].T, position)
    truth[:3, 3] -= truth[:3, :3] @ T_BC[:3, 3]  # it is the camera that is there
    frame = shoot(truth)
    cloud = Cleaning(CAMERA, edge=np.inf)(frame, T_BC)
    assert len(cloud) > 0.95 * frame.valid.sum()
    found = ModelFrontEnd().registration(target, CAMERA, T_BC)(cloud, truth, _PRIOR)
    assert np.linalg.norm(difference(truth, found.pose)[3:]) < 0.01
    assert found.score < 0.01


def test_a_face_that_fills_the_image_leaves_the_shape_free_along_it(target: Target, shoot: Shoot) -> None:
    """A strip of the bus is seen, its ends out of the image: what is expected holds, and the errors say so."""
    cleaning, registration = Cleaning(CAMERA, edge=np.inf), ModelFrontEnd().registration(target, CAMERA, T_BC)
    tight = np.diag(np.repeat([np.deg2rad(0.5), 0.005], 3) ** -2.0)
    random = np.random.default_rng(1)
    ahead, right = np.array([-0.5, 0.0, -np.sqrt(0.75)]), np.array([0.0, 1.0, 0.0])
    camera = np.stack((right, np.cross(ahead, right), ahead), axis=1)
    for number, along in enumerate((0.15, 0.17, 0.19)):
        rotation = camera @ T_BC[:3, :3].T
        truth = pose(rotation, np.array([along, 0.0, 0.35]) - rotation @ T_BC[:3, 3])
        start = perturbed(truth, random.normal(size=6) * np.repeat([np.deg2rad(0.2), 3e-3], 3))
        found = registration(cleaning(shoot(truth, number), T_BC), start, tight)
        offset, covariance = difference(truth, found.pose), found.covariance()
        assert np.linalg.norm(offset[3:]) < 0.012
        assert offset @ np.linalg.solve(covariance, offset) / 6.0 < 4.0
        x = rotation.T @ np.array([1.0, 0.0, 0.0])  # the strip leads along x of M
        assert np.sqrt(x @ covariance[3:, 3:] @ x) > 0.01


def _rough_ball(random: np.random.Generator) -> Target:
    ball = require("trimesh").creation.icosphere(subdivisions=4, radius=0.5)
    vertices = np.asarray(ball.vertices) * (1.0 + 0.004 * random.normal(size=(len(ball.vertices), 1)))
    mesh = TriangleMesh(vertices, np.asarray(ball.faces, np.int64))
    return Target(MeshSolid([ball]), mesh, np.eye(3), np.array([0.0, 0.0, 0.6]))


def test_the_roughness_of_a_map_does_not_show_how_a_ball_is_turned(streams: Streams) -> None:
    """Its bumps seem to show it, and draw the pose to wherever the noise of a frame fits them."""
    random = np.random.default_rng(4)
    target, prior = _rough_ball(random), np.diag(np.repeat([np.deg2rad(0.5), 0.005], 3) ** -2.0)
    truth = spin(1)[0]
    camera = truth @ T_BC
    renderer = TimeOfFlightCamera(profile="nominal")(_rough_ball(random))
    frame = renderer.render(camera[:3, :3], camera[:3, 3], streams, 0, 0.0)
    cloud = Cleaning(CAMERA, edge=np.inf)(frame, T_BC).thinned(1500)
    turns = []
    for roughness in (0.0, 0.1):
        found = ModelFrontEnd().registration(target, CAMERA, T_BC, roughness)(cloud, truth, prior)
        turns.append(_degrees(truth, found.pose))
        # The centre, as it is seen in B, is shown all the same.
        moved = -(inverse(found.pose) - inverse(truth))[:3, 3]
        assert np.linalg.norm(moved) < 0.01
    assert turns[0] > 0.5
    assert turns[1] < 0.1


def test_frames_are_registered_to_a_map_as_to_a_rough_surface_that_may_lack_parts(
    target: Target, streams: Streams, shoot: Shoot
) -> None:
    """Half of what the frame shows is not on it."""
    truth = spin(1)[0]
    shown = target.shape.corners[..., 0].mean(axis=1)
    kept = target.shape.corners[shown < np.quantile(shown, 0.4)]
    part = replace(target, model=TriangleMesh(kept.reshape(-1, 3), np.arange(3 * len(kept)).reshape(-1, 3)))
    known, run = (ModelFrontEnd()(FrontEndContext(CAMERA, T_BC, part, streams, poses)) for poses in ({}, {0: truth}))
    assert known._registration._roughness == 0.0 < run._registration._roughness
    edges = [edge for number in range(2) for edge in run.step(shoot(truth, number), truth, np.eye(3))]
    assert len(edges) == 2
    assert all(edge.inliers < 0.5 and _degrees(truth, edge.pose) < 2.0 for edge in edges)


def test_normals_that_err_show_less_than_they_seem_to() -> None:
    random = np.random.default_rng(5)
    normals = random.normal(size=(4000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points, seen = 0.5 * normals, normals + 0.05 * random.normal(size=normals.shape)
    rows = np.concatenate([np.cross(points, seen), seen], axis=1)
    hessian, gradient = rows.T @ rows, rows.T @ random.normal(size=4000)
    information, pull = _of_exact_normals(hessian, gradient, points, 0.05)
    assert np.linalg.eigvalsh(information[:3, :3]).max() < 0.1 * np.linalg.eigvalsh(hessian[:3, :3]).min()
    np.testing.assert_allclose(information[3:, 3:], hessian[3:, 3:], rtol=0.01, atol=0.01 * hessian[3, 3])
    assert np.linalg.norm(pull[:3]) < 0.1 * np.linalg.norm(gradient[:3])
    np.testing.assert_allclose(pull[3:], gradient[3:], rtol=0.05, atol=0.01 * np.linalg.norm(gradient[3:]))


def test_the_seam_of_two_bodies_is_no_edge(streams: Streams) -> None:
    """Points behind the seam lie next to the edge of a body that overlaps theirs, and would pull along it."""
    experiment, file = (configs_root() / "tumbling-rendezvous" / name for name in _CUBE)
    cube = load_rendezvous(experiment, [f"target=!include {file}"]).config.target()
    registration, cleaning = ModelFrontEnd().registration(cube, CAMERA, T_BC), Cleaning(CAMERA, edge=np.inf)
    renderer, offset = TimeOfFlightCamera()(cube), np.zeros(6)
    expected = np.diag(np.repeat([np.deg2rad(0.5), 0.005], 3) ** -2.0)
    first, last = np.array([[2.435, -1.24, 0.139, -0.622, 0.245, -0.096], [2.714, -0.681, -0.156, -0.6, -0.044, 0.114]])
    for number, share in enumerate(np.linspace(0.0, 1.0, 12)):
        place = (1.0 - share) * first + share * last
        truth = pose(rotation_exp(place[:3]), place[3:])
        eye = truth @ T_BC
        cloud = cleaning(renderer.render(eye[:3, :3], eye[:3, 3], streams, number, 0.0), T_BC).thinned(1500)
        found = registration(cloud, perturbed(truth, offset), expected)  # the error of the last frame stays
        offset = difference(truth, found.pose)
        assert np.linalg.norm(offset[3:]) < 0.03
        assert offset @ np.linalg.solve(found.covariance(), offset) / 6.0 < 8.0
    assert np.linalg.norm(offset[3:]) < 0.012


def test_points_next_to_nothing_or_to_something_farther_are_at_a_boundary() -> None:
    """Columns from the left: a face at 1 m, one at 1.05 m, a crease of 1 cm, nothing, and at last the border."""
    depth = np.zeros((CAMERA.height, CAMERA.width))
    depth[:, :60], depth[:, 60:120], depth[:, 120:180] = 1.0, 1.05, 1.06
    frame = DepthFrame(0.0, depth, np.zeros((0, 3)), depth > 0.0, ())
    cloud = Cleaning(CAMERA, edge=np.inf)(frame, T_BC)
    columns = np.nonzero(frame.valid)[1]
    assert len(cloud) == len(columns)
    np.testing.assert_array_equal(cloud.at_boundary, np.isin(columns, (58, 59, 178, 179)))
    thin = cloud.thinned(400)
    assert len(thin.at_boundary) == len(thin) == 400


_CUBE = ("experiment.yml", "targets/cube_with_nook.yml")
_TARGETS = sorted((configs_root() / "tumbling-rendezvous" / "targets").glob("*.yml"))


@pytest.mark.parametrize("file", _TARGETS, ids=[file.stem for file in _TARGETS])
def test_frames_of_any_mesh_are_registered_to_it(file: Path, streams: Streams) -> None:
    experiment = configs_root() / "tumbling-rendezvous" / "experiment.yml"
    target = load_rendezvous(experiment, [f"target=!include {file}"]).config.target()
    assert target.solid.distance((target.R_MT @ target.mating_point)[None])[0] > 0.25 + 0.08
    registration, cleaning = ModelFrontEnd().registration(target, CAMERA, T_BC), Cleaning(CAMERA, edge=np.inf)
    renderer, random = TimeOfFlightCamera()(target), np.random.default_rng(5)
    turns, shifts, nees = [], [], []
    for number, turn in enumerate(Rotation.random(8, random_state=3).as_rotvec()):
        truth = inverse(pose(rotation_exp(turn), np.zeros(3))) @ spin(1, first=(0.0, 0.0, 0.0))[0]
        eye = truth @ T_BC
        cloud = cleaning(renderer.render(eye[:3, :3], eye[:3, 3], streams, number, 0.0), T_BC)
        start = perturbed(truth, random.normal(size=6) * np.repeat([np.deg2rad(1.0), 0.01], 3))
        found = registration(cloud, start, _PRIOR)
        error = difference(truth, found.pose)
        turns.append(np.rad2deg(np.linalg.norm(error[:3])))
        shifts.append(np.linalg.norm(error[3:]))
        nees.append(error @ np.linalg.solve(found.covariance(), error) / 6.0)
    assert np.median(turns) < 0.8
    assert max(turns) < 3.0
    assert np.median(shifts) < 0.012
    assert np.median(nees) < 2.5
