"""A target from the user's mesh file."""

from __future__ import annotations

import os
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import Field

from safe_inspect.dynamics.attitude.inertia import principal_axes
from safe_inspect.errors import ConfigError
from safe_inspect.geometry.oriented_boxes import OrientedBoxes
from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.target.boxes import aligned_boxes
from safe_inspect.rendezvous.target.model import InertiaMatrix, Point, Target, TargetModel, TriangleMesh
from safe_inspect.types import AnyArray, FloatArray

#: Field type for the name of a file that a plugin reads; `experiment.load_rendezvous` makes such names absolute.
DataFile = Annotated[str, Field(min_length=1, json_schema_extra={"file": True})]
#: Smallest half size of a covering box [m], for flat parts of a mesh.
_LEAST_HALF_SIZE = 1e-4
#: Positions of the cuts of a cell to try, as fractions of its length.
_CUTS = (0.2, 0.35, 0.5, 0.65, 0.8)


def _read_mesh(path: str | os.PathLike[str], scale: float = 1.0) -> Any:
    """Read a mesh file with trimesh and scale it.

    Raises:
        ConfigError: The file cannot be read, or its surface is not closed.
    """
    name = os.fspath(path)
    trimesh = require("trimesh")
    try:
        mesh = trimesh.load(name, force="mesh")
    except Exception as error:  # The errors of trimesh depend on the format.
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise ConfigError(f"{name}: the mesh cannot be read ({reason}); give an STL, PLY or OBJ file") from None
    if not mesh.is_volume:
        raise ConfigError(
            f"{name}: the mesh is not a closed surface with outward faces (watertight: {mesh.is_watertight}, "
            f"consistent winding: {mesh.is_winding_consistent}); close its holes and make all faces point outwards"
        )
    mesh.apply_scale(scale)
    return mesh


class MeshTarget(TargetModel):
    """A target from a closed mesh file (STL, PLY or OBJ), covered by boxes.

    Attributes:
        path: The file; a relative name is looked up next to the configuration file that contains it.
        scale: Factor from the lengths in the file to metres.
        inertia: Inertia about the mesh's origin [kg m^2], which is then the centre of mass; null for uniform density.
        mating_point: Position that the chaser's centre must reach, in the principal axes [m].
        boxes: Largest number of boxes that cover the mesh.
    """

    path: DataFile
    scale: float = Field(default=1.0, gt=0.0)
    inertia: InertiaMatrix | None = None
    mating_point: Point = (0.0, 0.0, 0.5)
    boxes: int = Field(default=12, ge=1)

    def __call__(self) -> Target:
        """Return the target, moved so that its centre of mass is the origin.

        Raises:
            ConfigError: The mesh is not closed, or its inertia is not that of a rigid body.
        """
        mesh = _read_mesh(self.path, self.scale)
        if self.inertia is None:
            mesh.apply_translation(-mesh.center_mass)
            inertia = np.asarray(mesh.moment_inertia, dtype=np.float64)
            inertia = 0.5 * (inertia + inertia.T)
        else:
            inertia = np.array(self.inertia)
        try:
            principal_axes(inertia)
        except ValueError as error:
            raise ConfigError(f"{self.path}: {error}") from None
        surface = TriangleMesh(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64))
        return Target(_covering_boxes(mesh, self.boxes), surface, inertia, np.array(self.mating_point))


def _covering_boxes(mesh: Any, count: int) -> OrientedBoxes:
    """Return at most `count` axis-aligned boxes that cover a closed mesh and its interior.

    Starting from the bounding box, cells are cut one after the other, each time at the plane that reduces the total
    volume most. On each side of a cell, the part of the solid in the cell either ends at the mesh's surface, and the
    bounds of the cell's triangles contain it, or it fills the whole side. In the second case the centre of the side is
    inside the solid.
    """
    whole = _Cell((np.asarray(mesh.vertices), np.asarray(mesh.faces)), np.asarray(mesh.bounds, np.float64))
    cells = [whole]
    while len(cells) < count:
        cuts = [(gain, index, halves) for index, cell in enumerate(cells) for gain, halves in [_best_cut(mesh, cell)]]
        gain, index, halves = max(cuts, key=lambda cut: cut[0])
        if gain <= 0.01 * whole.volume:
            break
        cells[index : index + 1] = halves
    bounds = np.array([cell.bounds for cell in cells])
    half = np.maximum(0.5 * (bounds[:, 1] - bounds[:, 0]), _LEAST_HALF_SIZE)
    return aligned_boxes(bounds.mean(axis=1), half)


class _Cell(NamedTuple):
    """A box (low and high corner [m], shape (2, 3)) and the triangles in it (vertices and faces)."""

    surface: tuple[FloatArray, AnyArray]
    bounds: FloatArray

    @property
    def volume(self) -> float:
        return float(np.maximum(self.bounds[1] - self.bounds[0], 2.0 * _LEAST_HALF_SIZE).prod())


def _best_cut(mesh: Any, cell: _Cell) -> tuple[float, list[_Cell]]:
    """Return the volume that the best cut of a cell saves [m^3] and the two halves."""
    low, high = cell.bounds
    best: tuple[float, list[_Cell]] = (0.0, [cell])
    for axis in range(3):
        for share in _CUTS:
            plane = low[axis] + share * (high[axis] - low[axis])
            halves = [_half(mesh, cell, axis, plane, side) for side in (0, 1)]
            found = [half for half in halves if half is not None]
            gain = cell.volume - sum(half.volume for half in found)
            if len(found) == 2 and gain > best[0]:
                best = (gain, found)
    return best


def _half(mesh: Any, cell: _Cell, axis: int, plane: float, side: int) -> _Cell | None:
    """Return the part of a cell below (side 0) or above (side 1) a plane, with a tight box; None without triangles."""
    normal, origin, bounds = np.zeros(3), np.zeros(3), cell.bounds.copy()
    normal[axis], origin[axis], bounds[1 - side, axis] = 2.0 * side - 1.0, plane, plane
    vertices, faces, _ = require("trimesh").intersections.slice_faces_plane(*cell.surface, normal, origin)
    if len(faces) == 0:
        return None
    surface = vertices[faces].reshape(-1, 3)
    middles = np.repeat(bounds.mean(axis=0)[None], 6, axis=0)
    for index in range(6):
        middles[index, index // 2] = bounds[index % 2, index // 2]
    inside = mesh.contains(middles).reshape(3, 2).T
    tight = np.array([surface.min(axis=0), surface.max(axis=0)])
    return _Cell((vertices, faces), np.where(inside, bounds, tight))
