"""The map of an unknown target: its surface, the space it may occupy, the operator's mark, and a whole mission."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from safe_inspect.cli.main import main
from safe_inspect.dynamics.quaternion import conjugate, exp, from_matrix, multiply, rotate, to_matrix
from safe_inspect.errors import ConfigError
from safe_inspect.geometry.pointing import R_BC
from safe_inspect.missions.mission import Mission
from safe_inspect.missions.scenario import check_scenario, mission_streams
from safe_inspect.missions.sensor_log_writer import WatchedFrame, watch
from safe_inspect.missions.truth import estimator_context, pose_in_model
from safe_inspect.rendezvous.estimate import BodyState, EstimateErrors, JointErrors, StateEstimate
from safe_inspect.rendezvous.estimation.characteriser import PolhodeCharacteriser
from safe_inspect.rendezvous.estimation.mapping import MappingEstimator, _Found, _Mapped, _with_offset
from safe_inspect.rendezvous.estimation.pipeline import EstimationPipeline, _is_consistent
from safe_inspect.rendezvous.estimation.states import History, TargetEstimate
from safe_inspect.rendezvous.estimation.station import Station
from safe_inspect.rendezvous.estimation.surface_map import SurfaceMap
from safe_inspect.rendezvous.experiment import RendezvousConfig, load_rendezvous
from safe_inspect.rendezvous.front_end import model as front_end_module
from safe_inspect.rendezvous.front_end.base import FrontEndContext
from safe_inspect.rendezvous.front_end.cleaning import Cleaning
from safe_inspect.rendezvous.front_end.model import ModelFrontEnd
from safe_inspect.rendezvous.poses import (
    MODEL,
    Edge,
    difference,
    inverse,
    move,
    perturbed,
    pose,
    rotation_exp,
    rotation_log,
)
from safe_inspect.rendezvous.target.model import Target, TriangleMesh
from safe_inspect.rendezvous.target.solid import PointSolid

_FILE = "configs/tumbling-rendezvous/experiment-unknown.yml"
_RADIUS = 0.28


def _config(*overrides: str) -> RendezvousConfig:
    return load_rendezvous(_FILE, overrides).config


@pytest.fixture(scope="module")
def watched() -> list[WatchedFrame]:
    """Frames of 80 s from a fixed point, in which the default target turns by 400 degrees."""
    return list(watch(_config("mission.fly_around=0 s"), 0, 80.0))


def _mapped(frames: Sequence[WatchedFrame]) -> tuple[SurfaceMap, dict[int, np.ndarray]]:
    """Return a map of frames with their true poses, so that its frame is M."""
    config = _config()
    mount = pose(R_BC, np.array(config.chaser.camera_position))
    found = SurfaceMap(config.sensors.camera.geometry, mount, (3e-3, 1.5e-3))
    return found, {found.add(one.frame): one.T_MB for one in frames}


def _target() -> Target:
    target: Target = _config().target()
    return target


def test_the_vertices_of_a_map_are_on_the_surface(watched: list[WatchedFrame]) -> None:
    found, poses = _mapped(watched)
    mesh, solid = found.mesh(poses), _target().solid
    distance = solid.distance(mesh.vertices)
    assert len(mesh.vertices) > 3000
    assert np.abs(np.median(distance)) < 0.002
    assert np.quantile(np.abs(distance), 0.95) < 0.01
    corners = mesh.corners
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outside = corners.mean(axis=1) + 0.02 * normals / np.linalg.norm(normals, axis=1, keepdims=True)
    assert (solid.distance(outside) > 0.005).mean() > 0.95  # the triangles look outwards


def test_clearances_of_a_map_are_those_of_the_target_or_lower(watched: list[WatchedFrame]) -> None:
    """Points around the target from which the chaser's sphere does not touch it."""
    found, poses = _mapped(watched)
    mesh, true = found.mesh(poses), _target().solid
    solid = found.solid(poses, mesh, np.eye(4), np.zeros(3))
    directions = np.random.default_rng(4).normal(size=(400, 3))
    points = directions / np.linalg.norm(directions, axis=1, keepdims=True) * np.linspace(0.35, 1.3, 400)[:, None]
    points = points[true.distance(points) > _RADIUS]
    excess = solid.distance(points) - true.distance(points)
    assert len(points) > 150
    assert np.quantile(excess, 0.98) < 0.01
    assert excess.max() < 0.03
    assert np.median(excess) > -0.03


def _true_motion(frames: Sequence[WatchedFrame]) -> TargetEstimate:
    """Return the true motion, for frames whose G is M."""
    first, principal = frames[0].target, _target().principal
    return TargetEstimate(
        time=0.0,
        orientation=first.orientation,
        angular_velocity=first.angular_velocity,
        ratios=principal[:2] / principal[2],
        q_GT=from_matrix(_target().R_MT),
        covariance=np.eye(8),
        axes_sigma=0.0,
        observable=True,
        aligned=True,
        misfit=1.0,
        recent_misfit=1.0,
        singular=(0.1, 0.1),
    )


def test_frames_whose_poses_err_slowly_are_aligned_by_what_they_show(watched: list[WatchedFrame]) -> None:
    found, true = _mapped(watched)
    found._points[40] = None  # a frame without points moves with those before and after it
    times = np.array([one.frame.time for one in watched])
    waves = np.sin(times[:, None] / np.array([23.0, 31.0, 41.0]) + np.array([0.0, 1.0, 2.0]))
    motion = _true_motion(watched)
    R_GW = to_matrix(multiply(motion.q_GT, conjugate(motion.predict(times)[0])))  # noqa: N806
    shifts = 0.05 * np.einsum("kij,kj->ki", R_GW, waves)
    turns = np.deg2rad(2.0) * np.einsum("kij,kj->ki", R_GW, np.roll(waves, 1, axis=1))
    erring = {number: pose(rotation_exp(turns[number]), shifts[number]) @ one for number, one in true.items()}
    aligned = found.aligned(erring, np.zeros(3), dict(enumerate(R_GW)))
    left = [aligned[number] @ inverse(one) for number, one in true.items()]
    shift, turn = np.array([one[:3, 3] for one in left]), np.array([rotation_log(one[:3, :3]) for one in left])
    shift -= shift.mean(axis=0)  # frames coincide wherever the origin is, and however the axes are turned
    turn -= turn.mean(axis=0)
    turns -= turns.mean(axis=0)
    assert np.sqrt((shifts**2).sum(axis=1).mean()) > 0.05
    assert np.sqrt((shift**2).sum(axis=1).mean()) < 0.008
    assert np.linalg.norm(shift, axis=1).max() < 0.015
    assert np.sqrt((turns**2).sum(axis=1).mean()) > np.deg2rad(2.0)
    assert np.sqrt((turn**2).sum(axis=1).mean()) < np.deg2rad(0.8)
    assert np.linalg.norm(turn[40] - turn[39:42].mean(axis=0)) < np.deg2rad(0.3)


def test_what_no_frame_has_seen_is_occupied(watched: list[WatchedFrame]) -> None:
    """From frames of one side the other side is not known to be free; from frames of all sides it is."""
    seen_once, poses_once = _mapped(watched[:3])
    found, poses = _mapped(watched)
    camera = poses_once[0][:3, 3]
    behind = -0.45 * camera / np.linalg.norm(camera)
    everywhere = found.solid(poses, found.mesh(poses), np.eye(4), np.zeros(3))
    one_side = seen_once.solid(poses_once, found.mesh(poses), np.eye(4), np.zeros(3))
    assert _target().solid.distance(behind[None])[0] > 0.1
    assert everywhere.distance(behind[None])[0] > 0.05
    assert one_side.distance(behind[None])[0] < 0.0


def test_distances_to_points_and_their_gradients() -> None:
    solid = PointSolid(((np.zeros((1, 3)), 0.1), (np.array([[1.0, 0.0, 0.0]]), 0.0)))
    points = np.array([[0.0, 0.5, 0.0], [1.0, 0.0, 0.2]])
    distances, gradients = solid.distances(points)
    np.testing.assert_allclose(distances, [[0.4, np.sqrt(1.25)], [np.sqrt(1.04) - 0.1, 0.2]])
    np.testing.assert_allclose(gradients[0, 0], [0.0, 1.0, 0.0])
    np.testing.assert_allclose(solid.distance(points), [0.4, 0.2])
    np.testing.assert_allclose(solid.in_units_of(2.0).distance(0.5 * points), [0.2, 0.1])
    assert np.linalg.norm(solid.vertices, axis=1).max() == pytest.approx(1.0)


def test_a_chaser_that_drifts_is_found_to_drift_and_one_that_is_pushed_moves_at_once() -> None:
    start = BodyState(np.array([0.0, -1.5, 0.0]), np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3))
    station = Station(start, 1.0)
    station.correct(start.position, 1.0)
    station.advance(np.array([0.1, 0.0, 0.0]), 0.2)
    np.testing.assert_allclose(station.position, [0.002, -1.5, 0.0])
    np.testing.assert_allclose(station.velocity, [0.02, 0.0, 0.0])
    drift, pushed = np.array([0.0, 0.0, 0.002]), np.array([0.02, 0.0, 0.0])
    for second in range(1500):
        for _ in range(5):
            station.advance(np.zeros(3), 0.2)
        station.correct(start.position + (second + 1) * (drift + pushed), 1.0)
    np.testing.assert_allclose(station.velocity, drift + pushed, atol=2e-4)
    # The reference is the mean of the first 100 s, in which the drift is not known yet.
    np.testing.assert_allclose(station.position, start.position + 1500 * (drift + pushed), atol=0.1)


def test_a_part_that_hides_the_target_at_first_neither_hides_its_distance_nor_draws_the_chaser_near() -> None:
    start = BodyState(np.array([0.0, -1.5, 0.0]), np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3))
    station = Station(start, 1.4)
    assert station.centre is None
    hiding = np.array([0.0, -0.8, 0.0])
    station.correct(hiding, 1.0)
    np.testing.assert_allclose(station.centre, [0.0, -0.1, 0.0], atol=1e-12)
    for _ in range(150):
        station.correct(start.position, 1.0)
    assert station.centre is not None
    assert np.linalg.norm(station.centre) < 0.05
    assert np.linalg.norm(station.position - start.position) < 0.05  # was 0.4 m with the first frame as the reference


def test_an_operator_marks_the_mating_point_where_a_frame_shows_it() -> None:
    config = _config()
    mission = Mission(config, 0)
    target, marks, shown = _target(), [], []
    for readings, chaser, body in mission.steps():
        if readings.time > 60.0:
            break
        if readings.frame is None:
            assert readings.mark is None
            continue
        T_MB = pose_in_model(target, chaser, body)  # noqa: N806
        point = target.R_MT @ target.mating_point
        shown.append(readings.mark is not None)
        if readings.mark is not None:
            marks.append(T_MB[:3, :3] @ readings.mark + T_MB[:3, 3] - point)
    assert 0.1 < np.mean(shown) < 0.8
    assert 0.003 < np.std(marks) < 0.008


def test_nothing_of_the_target_is_known_but_a_ball_that_contains_it() -> None:
    true, known = _target(), MappingEstimator(radius=1.05).known(_target())
    assert known.swept_radius == pytest.approx(1.05)
    assert not np.allclose(known.principal / known.principal[2], true.principal / true.principal[2], rtol=0.1)
    assert np.linalg.norm(known.mating_point) < 0.01
    far = true.solid.vertices
    assert (known.solid.distance(far) <= 0.05).all()


@pytest.mark.slow
def test_a_mission_to_an_unknown_target_arrives_at_the_marked_point(tmp_path: Path) -> None:
    folder = tmp_path / "mission"
    assert main(["rendezvous", _FILE, "--output", str(folder)]) == 0
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    with np.load(folder / "log.npz") as log:
        arrays = {name: log[name] for name in ("t", "x")}
    assert summary["success"], summary
    assert summary["least_clearance"] > 0.05
    assert summary["nees"] is None  # the axes of the map are not those of the true inertia
    assert summary["largest_gauge"] is None
    # It flies around the target while it maps: half of the circle in 150 s.
    around = arrays["x"][arrays["t"] <= 150.0, :3]
    assert np.abs(np.linalg.norm(around, axis=1) - 1.55).max() < 0.4
    np.testing.assert_allclose(around[-1], [0.0, 1.55, 0.0], atol=0.35)


@pytest.mark.parametrize(("axes", "misfit", "is_found"), [(9.5, 1.0, True), (7.0, 1.0, False), (9.5, 3.1, False)])
def test_a_map_needs_the_attitude_of_the_surface_and_not_of_the_axes(
    axes: float, misfit: float, is_found: bool
) -> None:
    covariance = np.zeros((8, 8))
    covariance[0, 0] = np.deg2rad(9.0) ** 2
    motion = SimpleNamespace(misfit=misfit, covariance=covariance, axes_sigma=np.deg2rad(axes))
    graph = SimpleNamespace(centre_glued=np.zeros(3), model=None)
    pipeline: Any = SimpleNamespace(target=motion, graph=graph, motion_poses=lambda _: {})
    assert (_Found.of(pipeline) is not None) == is_found


def test_a_ball_that_reaches_the_start_is_warned_of() -> None:
    assert not check_scenario(load_rendezvous(_FILE))
    (problem,) = check_scenario(load_rendezvous(_FILE, ["estimator.config.radius=1.4 m"]))
    assert problem.path == "estimator.config.radius"
    assert "start farther away" in problem.hint


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("mission.fly_around=48 s", "the chaser flies around at 0.203 m/s; the tracking speed is 0.2 m/s"),
        (
            "chaser.limits.keep_in=[1.5 m, 3 m, 0.8 m]",
            "a circle of 1.55 m around the target leaves the keep-in box of 1.5 m",
        ),
    ],
)
def test_a_circle_that_cannot_be_flown_is_refused(override: str, message: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(f"mission.fly_around: {message}")):
        check_scenario(load_rendezvous(_FILE, [override]))
    assert not check_scenario(load_rendezvous(_FILE, [override, "mission.fly_around=0 s"]))


def test_a_start_near_the_ball_is_warned_of() -> None:
    assert not check_scenario(load_rendezvous(_FILE, ["chaser.position=[0 m, -1.54 m, 0 m]"]))
    (problem,) = check_scenario(load_rendezvous(_FILE, ["chaser.position=[0 m, -1.52 m, 0 m]"]))
    assert problem.path == "estimator.config.radius"


def test_noise_above_what_the_front_end_assumes_is_warned_of() -> None:
    file, noise = "configs/tumbling-rendezvous/experiment.yml", "sensors.camera.profile=harsh"
    (problem,) = check_scenario(load_rendezvous(file, [noise]))
    assert problem.path == "sensors.camera.profile"
    front_end = "estimator.config.front_end.config"
    assert not check_scenario(
        load_rendezvous(file, [noise, f"{front_end}.range_sigma=5 mm", f"{front_end}.range_growth=3 mm"])
    )


def test_frames_of_a_noisy_camera_are_registered_if_its_noise_is_known() -> None:
    config = _config("sensors.camera.profile=harsh", "chaser.position=[0 m, -1.9 m, 0 m]")
    mount = pose(R_BC, np.array(config.chaser.camera_position))
    frames = list(watch(config, 0, 3.0))
    context = FrontEndContext(config.sensors.camera.geometry, mount, config.target(), None)
    counts = []
    for front_end in (ModelFrontEnd(), ModelFrontEnd(range_sigma=0.005, range_growth=0.003)):
        run = front_end(context)
        counts.append(sum(bool(run.step(one.frame, None, np.eye(3))) for one in frames))
    assert counts[1] == len(frames) - 1  # the first frame alone is ambiguous
    assert counts[0] < counts[1]


def test_errors_of_a_maps_origin_are_those_of_a_frame_and_the_centre_of_mass_is_offset() -> None:
    random = np.random.default_rng(0)
    turn, of_target = rotation_exp(random.normal(size=3)), exp(random.normal(size=3))
    mass = np.diag([4.0, 9.0, 1.0]) * 1e-4
    joint = np.eye(14)
    joint[8:11, 8:11] = mass
    origin, at, offset = np.array([0.1, -0.2, 0.05]), np.array([1.2, 0.3, -0.4]), np.array([0.01, 0.0, -0.02])
    sigmas = np.array([1e-3, 1e-3, 1e-3, 2e-3, 3e-3, 4e-3])
    seen = Edge(MODEL, 3, pose(rotation_exp(random.normal(size=3)), at), np.diag(sigmas**2), 1.0, "model")
    found = _with_offset(JointErrors(0.1, 0.1, joint=joint), seen, origin, turn, of_target, offset)
    # The origin as the chaser sees it, for poses that differ by the errors of the frame.
    drawn = sigmas * random.normal(size=(4000, 6))
    places = np.array([move(inverse(perturbed(seen.pose, error)), origin[None])[0] for error in drawn])
    np.testing.assert_allclose(found.joint[8:11, 8:11], turn @ np.cov(places.T) @ turn.T, atol=1e-6)
    assert found.centre == pytest.approx(np.sqrt(np.linalg.eigvalsh(found.joint[8:11, 8:11])[-1]))
    axes = to_matrix(of_target)
    np.testing.assert_allclose(axes @ found.offset @ axes.T, mass + np.outer(axes @ offset, axes @ offset), atol=1e-12)
    np.testing.assert_array_equal(found.joint[:8, :8], np.eye(8))


def test_frames_that_show_what_is_not_on_the_map_are_registered_near_the_expected_pose(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A face that makes a third of the points is not on the map."""
    config = _config()
    target = config.target()
    seen = list(watch(config, 0, 12.0))
    corners = target.shape.corners
    kept = corners[..., 2].mean(axis=1) < 0.05
    part = TriangleMesh(corners[kept].reshape(-1, 3), np.arange(3 * kept.sum()).reshape(-1, 3))
    known = dataclasses.replace(target, model=part)
    mount = pose(R_BC, np.array(config.chaser.camera_position))
    counts, searches = [], []
    for poses in ({}, {0: seen[0].T_MB}):
        run = ModelFrontEnd()(FrontEndContext(config.sensors.camera.geometry, mount, known, None, poses))
        found = [run.step(one.frame, one.T_MB, np.eye(3)) for one in seen]
        right = [
            bool(edges) and np.rad2deg(np.linalg.norm(difference(one.T_MB, edges[-1].pose)[:3])) < 5.0
            for one, edges in zip(seen, found, strict=True)
        ]
        counts.append(sum(right))
        monkeypatch.setattr(front_end_module, "acquire", lambda *_, **__: searches.append(0) or [])
    assert counts[0] < counts[1] == len(seen)
    assert not searches


def test_the_estimated_map_is_where_the_newest_frames_show_it() -> None:
    """The fit of the motion errs by 3 degrees and 2 cm; the target is free, so that the correction turns with it."""
    config = _config()
    target, mount = _target(), pose(R_BC, np.array(config.chaser.camera_position))
    context = estimator_context(config, config.estimator.known(target), mission_streams(config, 0))
    origin, shift = np.array([0.02, -0.03, 0.01]), np.array([0.1, 0.2, -0.1])
    mapped = _Mapped(target, origin)
    front_end = ModelFrontEnd()(FrontEndContext(context.camera, mount, target, None, {0: np.eye(4)}))
    T_WB = pose(rotation_exp(np.array([0.3, -0.2, 0.5])), np.array([0.5, -1.2, 0.3]))  # noqa: N806
    orientation, rate = exp(np.array([0.4, 1.1, -0.3])), np.deg2rad([2.0, -1.0, 3.0])
    body = BodyState(np.zeros(3), np.zeros(3), orientation, rate)
    chaser = BodyState(T_WB[:3, 3], np.zeros(3), from_matrix(T_WB[:3, :3]), np.zeros(3))
    # The frame was taken 0.2 s before the estimate.
    known = StateEstimate(7.2, 7.0, chaser, body, target.principal, EstimateErrors(0.1, 0.1), 0.9, mismatch=0.0)
    (at_frame,), _ = known.predict(np.array([7.0]))
    R_WM = to_matrix(at_frame) @ target.R_MT.T  # noqa: N806
    # Frames show the centre of mass, at the origin of G and in the map, where the fit does not have it.
    expected = inverse(pose(R_WM, np.zeros(3))) @ T_WB
    off = pose(rotation_exp(np.deg2rad([3.0, 0.0, 0.0])), np.array([0.0, 0.02, 0.0]))
    shown = pose(np.eye(3), origin) @ off @ expected
    edge = Edge(MODEL, 5, shown, 1e-6 * np.eye(6), 1.0, "model")
    graph = SimpleNamespace(chaser=T_WB, centre_glued=shift + origin, model=pose(np.eye(3), shift))
    run: Any = MappingEstimator()(context)
    run._run = SimpleNamespace(front_end=front_end, pipeline=SimpleNamespace(graph=graph, measured=[edge]))
    for time in range(3, 8):
        front_end.placing.update(float(time), expected, shown, edge.covariance)
    found = run._about_origin(known, mapped)
    turned = multiply(conjugate(orientation), found.target.orientation)
    R_WM = to_matrix(multiply(at_frame, turned)) @ target.R_MT.T  # noqa: N806
    position = rotate(at_frame, rotate(conjugate(orientation), found.target.position))
    np.testing.assert_allclose(inverse(pose(R_WM, position)) @ T_WB, off @ expected, atol=1e-12)
    assert found.mismatch == front_end.placing.mismatch < 0.01
    unseen = dataclasses.replace(known, mismatch=np.inf)  # one of the newest frames shows nothing
    assert run._about_origin(unseen, mapped).mismatch == np.inf
    # Later, without a new frame, it turns with the fitted motion.
    (q,), (w,) = known.predict(np.array([17.0]))
    later = dataclasses.replace(known, time=17.0, target=BodyState(np.zeros(3), np.zeros(3), q, w))
    moved = run._about_origin(later, mapped).target
    np.testing.assert_allclose(multiply(conjugate(q), moved.orientation), turned, atol=1e-12)
    np.testing.assert_allclose(
        rotate(conjugate(q), moved.position), rotate(conjugate(orientation), found.target.position)
    )


def test_the_motion_that_fits_attitudes_is_found_without_knowing_the_axes(
    watched: list[WatchedFrame],
) -> None:
    """Attitudes that err by 0.3 degrees, in 80 s."""
    random, frames = np.random.default_rng(5), range(len(watched))
    times = np.array([one.frame.time for one in watched])
    truth = _true_motion(watched)
    q_WT, rate = truth.predict(times)  # noqa: N806
    turns = [rotation_exp(np.deg2rad(0.3) * random.normal(size=3)) for _ in frames]
    poses = {k: pose(watched[k].T_MB[:3, :3] @ turns[k], np.zeros(3)) for k in frames}
    # T_MB = T_MT T_TW T_WB, from which the chaser's attitude follows.
    chaser = np.stack([to_matrix(q_WT[k]) @ to_matrix(truth.q_GT).T @ watched[k].T_MB[:3, :3] for k in frames])
    history = History.of(times, from_matrix(chaser), np.full((len(times), 4), np.nan), [], list(frames))
    pipeline: Any = SimpleNamespace(
        history=lambda: history,
        _back_end=SimpleNamespace(frames=dict.fromkeys(frames)),
        _characterise=PolhodeCharacteriser(),
    )
    found = EstimationPipeline.refitted(pipeline, poses)
    assert found is not None
    expected = to_matrix(multiply(truth.q_GT, conjugate(q_WT)))
    R_GW = to_matrix(multiply(found.q_GT, conjugate(found.predict(times)[0])))  # noqa: N806
    off = [np.linalg.norm(rotation_log(one.T @ other)) for one, other in zip(expected, R_GW, strict=True)]
    assert np.sqrt(np.mean(np.square(off))) < np.deg2rad(0.3)
    in_inertial = rotate(found.orientation, found.angular_velocity) - rotate(q_WT[-1], rate[-1])
    assert np.linalg.norm(in_inertial) < np.deg2rad(0.05)


@pytest.mark.parametrize(("tolerance", "is_consistent"), [(1.0, False), (4.0, True)])
def test_a_motion_agrees_with_frames_of_a_map_within_its_tolerance(tolerance: float, is_consistent: bool) -> None:
    found: Any = SimpleNamespace(misfit=2.5, recent_misfit=5.0)
    assert _is_consistent(found, tolerance) == is_consistent
    assert not _is_consistent(None, tolerance)


def test_poses_to_a_map_have_its_errors_and_more_from_afar(watched: list[WatchedFrame]) -> None:
    config, target = _config(), _target()
    mount = pose(R_BC, np.array(config.chaser.camera_position))
    cleaning = Cleaning(config.sensors.camera.geometry)
    near = cleaning(watched[0].frame, mount)
    far = dataclasses.replace(near, points=near.points + mount[:3, 2])  # 1 m along the optical axis
    known, mapped = (
        ModelFrontEnd().registration(target, config.sensors.camera.geometry, mount, roughness)
        for roughness in (0.0, 0.1)
    )
    assert known._detail_turn(near) == known._detail_turn(far) < np.deg2rad(0.2)
    assert np.deg2rad(0.4) < mapped._detail_turn(near) < mapped._detail_turn(far) - np.deg2rad(0.2)
    turn = mapped._detail_turn(near)
    found = mapped(near, watched[0].T_MB)
    rotation = found.covariance()[:3, :3]
    assert np.sqrt(np.linalg.eigvalsh(rotation)[0]) > 0.99 * turn
