from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

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
    _mesh_of_boxes,
    aligned_boxes,
)
from safe_inspect.rendezvous.target.mesh import MeshTarget, _covering_boxes, _read_mesh
from safe_inspect.tasks.rendezvous.shape import ENVISAT_BOXES, boxes_in_model


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
    mesh = _mesh_of_boxes(boxes)
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
    mesh = _mesh_of_boxes(boxes)
    return mesh.vertices, mesh.faces


def test_a_mesh_file_becomes_a_target_covered_by_boxes(tmp_path: Path) -> None:
    trimesh = require("trimesh")
    trimesh.creation.annulus(r_min=0.3, r_max=0.5, height=0.2).export(tmp_path / "ring.stl")
    target = MeshTarget(path=str(tmp_path / "ring.stl"), scale=2.0)()
    assert 2 < len(target.boxes) <= 12
    sampled = trimesh.Trimesh(target.mesh.vertices, target.mesh.faces)
    surface, _ = trimesh.sample.sample_surface(sampled, 2000, seed=1)
    inside = trimesh.sample.volume_mesh(sampled, 500)
    assert target.boxes.distance(np.concatenate([surface, inside])).max() < 1e-9
    volume = 8.0 * target.boxes.half_size.prod(axis=1).sum()
    assert volume < 0.9 * np.prod(sampled.extents)


def test_boxes_hold_what_is_deep_inside_a_solid() -> None:
    trimesh = require("trimesh")
    solid = trimesh.creation.box((2.0, 2.0, 2.0))
    dent = _covering_boxes(solid, 8)
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (500, 3))
    assert dent.distance(points).max() < 1e-9


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
