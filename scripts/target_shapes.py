"""Write the shapes of the targets in configs/tumbling-rendezvous/targets: python scripts/target_shapes.py."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from trimesh.creation import box, cone, cylinder, icosphere

FOLDER = Path(__file__).parents[1] / "configs" / "tumbling-rendezvous" / "targets"


def _at(mesh: trimesh.Trimesh, position: tuple[float, ...], turn: float = 0.0, axis: int = 0) -> trimesh.Trimesh:
    """Return a mesh after a turn [degrees] about an axis, and a shift [m]."""
    place = trimesh.transformations.rotation_matrix(np.deg2rad(turn), np.eye(3)[axis])
    place[:3, 3] = position
    return mesh.apply_transform(place)


def satellite() -> list[trimesh.Trimesh]:
    """Return a bus with one tilted panel on a boom, and a small dish."""
    return [
        box((0.5, 0.4, 0.3)),
        _at(box((0.16, 0.03, 0.03)), (0.33, 0.0, 0.0)),
        _at(box((0.5, 0.36, 0.02)), (0.66, 0.0, 0.0), 25.0),
        _at(cone(0.1, 0.08, sections=16), (-0.1, 0.1, 0.14)),
    ]


def cylinder_with_panels() -> list[trimesh.Trimesh]:
    """Return a cylinder with two panels of different tilts and an antenna."""
    return [
        cylinder(0.22, 0.6, sections=24),
        _at(box((0.55, 0.02, 0.24)), (0.5, 0.0, 0.05), 20.0),
        _at(box((0.4, 0.02, 0.24)), (-0.42, 0.0, 0.05), -35.0),
        _at(cylinder(0.015, 0.25, sections=8), (0.1, 0.08, 0.42)),
    ]


def upper_stage() -> list[trimesh.Trimesh]:
    """Return a stage with a nozzle, a cable duct and a box of avionics."""
    return [
        cylinder(0.22, 0.8, sections=24),
        _at(cone(0.17, 0.3, sections=24), (0.0, 0.0, -0.6)),
        _at(box((0.06, 0.08, 0.7)), (0.23, 0.0, 0.0)),
        _at(box((0.14, 0.1, 0.16)), (-0.1, 0.22, 0.2)),
    ]


def cube_with_nook() -> list[trimesh.Trimesh]:
    """Return a cube of 0.5 m of which a corner is missing."""
    return [
        _at(box((0.5, 0.5, 0.3)), (0.0, 0.0, -0.1)),
        _at(box((0.49, 0.25, 0.22)), (0.0, -0.12, 0.14)),
        _at(box((0.2, 0.26, 0.21)), (-0.14, 0.11, 0.13)),
    ]


def rock() -> list[trimesh.Trimesh]:
    """Return a rock: a sphere that smooth random waves deform."""
    shape, random = icosphere(subdivisions=2, radius=1.0), np.random.default_rng(4)
    waves = random.normal(size=(8, 3)) * 1.6
    phases = random.uniform(0.0, 2.0 * np.pi, 8)
    height = 1.0 + 0.09 * np.cos(shape.vertices @ waves.T + phases).sum(axis=1)
    shape.vertices *= height[:, None] * np.array([0.45, 0.33, 0.26])
    return [shape]


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for make in (satellite, cylinder_with_panels, upper_stage, cube_with_nook, rock):
        whole = trimesh.util.concatenate(make())
        whole.export(FOLDER / f"{make.__name__}.stl", file_type="stl")
        print(make.__name__, len(whole.faces), "triangles", whole.is_volume)
