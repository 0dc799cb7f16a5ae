from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from safe_inspect.dynamics.attitude.inertia import principal_axes
from safe_inspect.dynamics.quaternion import exp, rotate
from safe_inspect.errors import ConfigError
from safe_inspect.rendezvous.coordination.context import MissionContext
from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.target.boxes import (
    EnvisatTarget,
    _inertia_of_boxes,
    aligned_boxes,
    mesh_of_boxes,
)
from safe_inspect.rendezvous.target.mesh import MeshTarget, _read_mesh
from safe_inspect.rendezvous.target.model import TriangleMesh
from safe_inspect.rendezvous.target.solid import MeshSolid
from safe_inspect.rendezvous.target.surface import MeshSurface
from safe_inspect.tasks.docking.shape import ENVISAT_BOXES, boxes_in_model


def test_envisat_has_the_published_principal_moments_and_tilt() -> None:
    target = EnvisatTarget(scale=1.0)()
    np.testing.assert_allclose(target.principal, [16979.7, 124801.2, 129180.3], atol=0.06)
    np.testing.assert_allclose(target.principal[:2] / target.principal[2], [0.1314, 0.9661], atol=5e-5)
    tilt = np.rad2deg(np.arccos(np.diag(target.R_MT)))
    np.testing.assert_allclose(tilt, [1.1, 4.4, 4.6], atol=0.05)
    assert target.swept_radius == pytest.approx(20.06, abs=0.01)
    assert EnvisatTarget()().swept_radius == pytest.approx(1.003, abs=1e-3)


def test_the_camera_looks_at_a_corner_near_the_mating_point_and_at_the_centre_from_afar() -> None:
    target = EnvisatTarget()()
    corner = target.R_MT @ target.landmark
    np.testing.assert_allclose(corner, [0.193, np.copysign(0.06875, corner[1]), 0.0525], atol=1e-9)
    q = exp(np.array([0.3, -1.0, 0.7]))
    centre, along = np.array([0.1, 0.2, 0.3]), rotate(q, target.mating_point)

    def aim(share: float) -> np.ndarray:
        chaser = SimpleNamespace(position=centre + share * along)
        estimate = SimpleNamespace(chaser=chaser, target=SimpleNamespace(position=centre, orientation=q))
        return MissionContext.aim(SimpleNamespace(estimate=estimate, target=target))

    np.testing.assert_allclose(aim(3.0), centre)
    np.testing.assert_allclose(aim(1.0), centre + rotate(q, target.landmark), atol=1e-12)
    np.testing.assert_allclose(aim(0.9), aim(1.0), atol=1e-12)
    np.testing.assert_allclose(aim(1.5), 0.5 * (aim(1.0) + centre), atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_principal_axes_diagonalise_the_inertia_in_a_right_handed_frame(seed: int) -> None:
    generator = np.random.default_rng(seed)
    turned, _ = np.linalg.qr(generator.normal(size=(3, 3)))
    moments = np.sort(generator.uniform(2.0, 3.9, 3))
    found, axes = principal_axes(turned @ np.diag(moments) @ turned.T)
    np.testing.assert_allclose(found, moments, rtol=1e-12)
    np.testing.assert_allclose(axes @ np.diag(found) @ axes.T, turned @ np.diag(moments) @ turned.T, atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert axes[0, 0] >= 0.0
    assert axes[1, 1] >= 0.0


@pytest.mark.parametrize(
    ("inertia", "words"),
    [
        (np.diag([1.0, 1.0, 3.0]), "no body has the principal moments"),
        (np.diag([-1.0, 1.0, 1.0]), "positive definite"),
        (np.eye(3) + np.eye(3, k=1), "symmetric"),
    ],
)
def test_an_impossible_inertia_is_refused(inertia: np.ndarray, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        principal_axes(inertia)


def test_faces_of_boxes_look_outwards_and_close_a_volume() -> None:
    boxes = boxes_in_model(ENVISAT_BOXES)
    mesh = mesh_of_boxes(boxes)
    corners = mesh.corners
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    volume = np.einsum("fi,fi->", corners.mean(axis=1), normal) / 6.0
    assert volume == pytest.approx(8.0 * boxes.half_size.prod(axis=1).sum())
    np.testing.assert_allclose(boxes.distance(mesh.vertices[:8]).max(), 0.0, atol=1e-12)


def test_inertia_of_boxes_agrees_with_the_meshes() -> None:
    boxes = aligned_boxes(np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]]), np.array([[1.0, 2.0, 0.5], [2.0, 0.3, 0.4]]))
    mesh = require("trimesh").Trimesh(*_arrays(boxes))
    volume = 8.0 * boxes.half_size.prod(axis=1).sum()
    np.testing.assert_allclose(_inertia_of_boxes(boxes), mesh.moment_inertia / volume, rtol=1e-9, atol=1e-9)


def _arrays(boxes):  # type: ignore[no-untyped-def]
    mesh = mesh_of_boxes(boxes)
    return mesh.vertices, mesh.faces


def _exact_distances(mesh: Any, points: np.ndarray) -> np.ndarray:
    """Return the distances to the triangles of a mesh, by brute force over each triangle's plane, sides and corners."""
    least = np.full(len(points), np.inf)
    for corners in mesh.triangles:
        sides = np.roll(corners, -1, axis=0) - corners
        normal = np.cross(sides[0], sides[1])
        normal /= np.linalg.norm(normal)
        offset = points[:, None] - corners
        within = (np.einsum("nei,ei->ne", offset, np.cross(sides, normal)) <= 0.0).all(axis=1)
        share = np.clip(np.einsum("nei,ei->ne", offset, sides) / np.square(sides).sum(axis=1), 0.0, 1.0)
        to_sides = np.linalg.norm(offset - share[..., None] * sides, axis=2).min(axis=1)
        least = np.minimum(least, np.where(within, np.abs(offset[:, 0] @ normal), to_sides))
    return least


def _meshes(path: Path) -> dict[str, Any]:
    trimesh = require("trimesh")
    ring = trimesh.creation.annulus(r_min=0.3, r_max=0.5, height=0.2)
    plate = trimesh.creation.box((0.8, 0.02, 0.3)).apply_translation((0.7, 0.0, 0.0))
    rock = trimesh.creation.icosphere(subdivisions=1, radius=0.5)
    rock.vertices *= 1.0 + 0.3 * np.random.default_rng(0).uniform(size=(len(rock.vertices), 1))
    found = {"ring": ring, "two": trimesh.util.concatenate([ring, plate]), "rock": rock}
    for name, mesh in found.items():
        mesh.export(path / f"{name}.stl")
    return found


def test_the_distance_to_a_mesh_is_a_close_lower_bound(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    for name, mesh in _meshes(tmp_path).items():
        solid = MeshSolid(list(mesh.split()))
        points = random.uniform(-1.0, 1.0, (3000, 3)) * 1.5
        exact, inside = _exact_distances(mesh, points), mesh.contains(points)
        if name == "two":
            inside = np.any([body.contains(points) for body in mesh.split()], axis=0)
        found, away = solid.distance(points), ~inside & (exact > 0.1)
        assert (found[~inside] <= exact[~inside] + 1e-12).all(), name
        assert (exact[away] - found[away] < 3e-3).all(), name
        assert (found[inside] < 0.0).all(), name
        # Planning scales the problem: the scaled solid must be the same one.
        scaled = solid.in_units_of(2.0)
        np.testing.assert_allclose(2.0 * scaled.distance(points / 2.0), found, atol=1e-9)
        np.testing.assert_allclose(2.0 * scaled.vertices, solid.vertices)


def test_the_gradient_of_the_distance_to_a_mesh_leads_away_from_it(tmp_path: Path) -> None:
    solid = MeshSolid(list(_meshes(tmp_path)["two"].split()))
    points = np.random.default_rng(2).uniform(-1.0, 1.0, (500, 3)) * 1.5
    distance, gradient = solid.distances(points)
    assert distance.shape == (500, 2)
    assert gradient.shape == (500, 2, 3)
    far = distance > 0.2
    moved = np.stack([solid.distances(points + 1e-3 * gradient[:, part])[0][:, part] for part in range(2)], axis=1)
    np.testing.assert_allclose((moved - distance)[far], 1e-3, rtol=0.02)


def test_a_mesh_file_becomes_a_target(tmp_path: Path) -> None:
    ring = _meshes(tmp_path)["ring"]
    target = MeshTarget(path=str(tmp_path / "ring.stl"), scale=2.0)()
    assert target.swept_radius == pytest.approx(2.0 * np.linalg.norm(ring.vertices, axis=1).max())
    assert target.shape is target.mesh
    assert target.solid.distance(np.array([[0.0, 0.0, 0.0]]))[0] == pytest.approx(
        0.6, abs=5e-3
    )  # the hole, of 32 sides
    assert target.solid.distance(np.array([[0.8, 0.0, 0.0]]))[0] < 0.0


def test_triangles_form_patches_up_to_sharp_edges(tmp_path: Path) -> None:
    trimesh = require("trimesh")
    cylinder = trimesh.creation.cylinder(radius=0.3, height=1.0, sections=24)
    for mesh, count, sharp in (
        (trimesh.creation.box(), 6, 12),
        (cylinder, 3, 48),
        (trimesh.creation.icosphere(subdivisions=2), 1, 0),
    ):
        surface = MeshSurface(TriangleMesh(np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int64)))
        assert len(set(surface.patches.tolist())) == count
        assert len(surface.sharp_edges) == sharp


def test_only_triangles_with_samples_are_the_nearest() -> None:
    surface = MeshSurface(mesh_of_boxes(aligned_boxes(np.zeros((1, 3)), np.array([[0.5, 0.5, 0.01]]))))
    x, y = np.random.default_rng(0).uniform(-0.45, 0.45, (2, 500))
    z = np.linspace(-0.2, 0.2, 500)
    for side in (1.0, -1.0):
        seen = surface.sample(0.02).facing(np.array([0.0, 0.0, 5.0 * side]))
        found = surface.nearest(seen, np.stack([x, y, z]))
        # Beyond the plate, its other face would be nearer, but only this one was seen.
        np.testing.assert_allclose(surface.normals[found.triangles], np.tile([0.0, 0.0, side], (500, 1)))
        np.testing.assert_allclose(found.height, side * z - 0.01, atol=1e-12)


def test_the_nearest_triangle_of_a_box_gives_the_distance_to_the_box() -> None:
    boxes = aligned_boxes(np.zeros((1, 3)), np.array([[0.5, 0.3, 0.1]]))
    surface = MeshSurface(mesh_of_boxes(boxes))
    samples = surface.sample(0.02)
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (2000, 3))
    surface.nearest(samples.facing(np.array([0.0, 0.0, 5.0])), points.T)  # other samples before
    triangles, height, beyond = surface.nearest(samples, points.T)
    found = np.sqrt(height**2 + (beyond**2).sum(axis=0))
    exact = boxes.distance(points)
    outside = exact > 0.02
    # Along a sharp edge the nearest point may be that of the other face.
    np.testing.assert_allclose(found[outside], exact[outside], atol=2e-3)
    assert np.median(np.abs(found - exact)[outside]) < 1e-12
    foot = points - height[:, None] * surface.normals[triangles] - beyond.T
    np.testing.assert_allclose(boxes.distance(foot[outside]), 0.0, atol=1e-9)


def test_samples_are_as_dense_as_asked_and_lie_on_the_surface() -> None:
    boxes = EnvisatTarget()().solid
    surface = MeshSurface(mesh_of_boxes(boxes))
    samples = surface.sample(0.05)
    # Where boxes overlap, a point of one is inside another.
    assert boxes.distance(samples.points).max() < 1e-9
    assert boxes.distance(samples.points + 1e-3 * samples.normals).max() == pytest.approx(1e-3, rel=1e-6)
    weights = np.random.default_rng(3).dirichlet(np.ones(3), 400)
    for index, corners in enumerate(surface.corners):
        own = samples.points[samples.triangles == index]
        gaps = np.linalg.norm((weights @ corners)[:, None] - own, axis=2).min(axis=1)
        assert gaps.max() <= 0.05
    thin = samples.thinned(0.1)
    assert 10 < len(thin.points) < 0.5 * len(samples.points)
    camera = np.array([10.0, 0.0, 0.0])
    facing = samples.facing(camera)
    assert 0 < len(facing.points) < 0.6 * len(samples.points)
    assert (np.einsum("ni,ni->n", facing.normals, camera - facing.points) > 0.0).all()


def test_a_body_with_inward_faces_is_refused_unless_it_is_a_cavity(tmp_path: Path) -> None:
    trimesh = require("trimesh")
    body, hole = trimesh.creation.box((1.0, 1.0, 1.0)), trimesh.creation.box((0.5, 0.5, 0.5))
    hole.invert()
    for name, offset in (("cavity", 0.0), ("overlapping", 0.5), ("apart", 2.0)):
        trimesh.util.concatenate([body, hole.copy().apply_translation((offset, 0.0, 0.0))]).export(
            tmp_path / f"{name}.stl"
        )
    assert _read_mesh(tmp_path / "cavity.stl").volume == pytest.approx(1.0 - 0.125)
    for name in ("overlapping", "apart"):
        with pytest.raises(ConfigError, match="make all faces point outwards"):
            _read_mesh(tmp_path / f"{name}.stl")


def test_bodies_that_overlap_have_the_inertia_of_all_of_them(tmp_path: Path) -> None:
    trimesh = require("trimesh")
    cubes = [trimesh.creation.box((1.0, 1.0, 1.0)).apply_translation((x, 0.0, 0.0)) for x in (-0.25, 0.25)]
    trimesh.util.concatenate(cubes).export(tmp_path / "cubes.stl")
    target = MeshTarget(path=str(tmp_path / "cubes.stl"))()
    sixth, shift = 1.0 / 6.0, 0.25**2  # of a cube about its centre, and by the parallel axes
    wanted = 2.0 * np.array([sixth, sixth + shift, sixth + shift])
    np.testing.assert_allclose(target.inertia, np.diag(wanted), atol=1e-9)


def test_an_open_mesh_and_a_missing_file_are_refused(tmp_path: Path) -> None:
    mesh = require("trimesh").creation.box()
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    mesh.export(tmp_path / "open.stl")
    with pytest.raises(ConfigError, match=r"open.stl: the mesh is not a closed surface"):
        _read_mesh(tmp_path / "open.stl")
    with pytest.raises(ConfigError, match="cannot be read"):
        _read_mesh(tmp_path / "none.stl")
    with pytest.raises(ValidationError, match="no body has the principal moments"):
        MeshTarget(path="box.stl", inertia=np.diag([1.0, 1.0, 3.0]).tolist())
