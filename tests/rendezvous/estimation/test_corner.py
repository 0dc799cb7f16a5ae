"""Where the camera looks near the mating point of a mapped target."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from safe_inspect.dynamics.quaternion import exp, to_matrix
from safe_inspect.rendezvous.estimation.corner import nearest_corner
from safe_inspect.rendezvous.target.model import Target, TriangleMesh
from safe_inspect.rendezvous.target.solid import PointSolid

trimesh = pytest.importorskip("trimesh")


def _fine(mesh: Any) -> TriangleMesh:
    """Return a mesh whose sides are as short as those of a map."""
    vertices, faces = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, 0.02)
    return TriangleMesh(np.asarray(vertices), np.asarray(faces))


@pytest.fixture(scope="module")
def box() -> TriangleMesh:
    """A box of 0.5 by 0.4 by 0.3 m."""
    return _fine(trimesh.creation.box((0.5, 0.4, 0.3)))


@pytest.mark.parametrize(
    ("point", "corner"),
    [((0.1, 0.05, -0.5), (0.25, 0.2, -0.15)), ((-0.6, -0.05, 0.02), (-0.25, -0.2, 0.15))],
)
def test_above_a_face_the_nearest_of_its_corners_is_found(
    box: TriangleMesh, point: tuple[float, ...], corner: tuple[float, ...]
) -> None:
    found = nearest_corner(box, np.array(point))
    assert found is not None
    assert np.linalg.norm(found - corner) < 0.075  # all three faces are within 6 cm


def test_corners_that_face_away_or_are_far_are_left_out(box: TriangleMesh) -> None:
    assert nearest_corner(box, np.array([0.33, 0.28, -0.23])) is not None
    assert nearest_corner(box, np.array([0.17, 0.12, -0.07])) is None  # from inside
    assert nearest_corner(box, np.array([0.0, 0.0, -0.25])) is None  # 0.1 m from the face, 0.34 m from its corners


def test_a_ball_and_a_cylinder_have_no_corners() -> None:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.4)
    assert (
        nearest_corner(TriangleMesh(np.asarray(ball.vertices), np.asarray(ball.faces)), np.array([0, 0, 0.8])) is None
    )
    cylinder = _fine(trimesh.creation.cylinder(radius=0.3, height=0.6, sections=64))
    assert nearest_corner(cylinder, np.array([0.0, 0.1, 0.7])) is None


def test_the_camera_looks_at_the_corner_of_a_map_and_else_at_the_nearest_vertex(box: TriangleMesh) -> None:
    axes = to_matrix(exp(np.array([0.2, -0.4, 0.3])))
    inertia, mating_point = axes @ np.diag([1.0, 2.0, 2.5]) @ axes.T, np.array([0.0, 0.0, 0.6])
    solid, corner = PointSolid(((box.vertices, 0.0),)), np.array([0.25, 0.2, 0.15])
    mapped = Target(solid, box, inertia, mating_point, corner=corner)
    np.testing.assert_allclose(mapped.R_MT @ mapped.landmark, corner, atol=1e-12)
    np.testing.assert_allclose(mapped.in_units_of(2.0).landmark, 0.5 * mapped.landmark)
    nearest = Target(solid, box, np.diag([1.0, 2.0, 2.5]), mating_point).landmark
    assert np.linalg.norm(nearest - mating_point) == pytest.approx(0.45, abs=0.01)
