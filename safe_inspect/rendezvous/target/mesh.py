"""A target from the user's mesh file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from safe_inspect.dynamics.attitude.inertia import principal_axes
from safe_inspect.errors import ConfigError
from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.target.model import InertiaMatrix, Point, Target, TargetModel, TriangleMesh
from safe_inspect.rendezvous.target.solid import MeshSolid

#: Field type for the name of a file that a plugin reads; `experiment.load_rendezvous` makes such names absolute.
DataFile = Annotated[str, Field(min_length=1, json_schema_extra={"file": True})]


def _read_mesh(path: str | os.PathLike[str], scale: float = 1.0) -> Any:
    """Read a mesh file with trimesh and scale it.

    Raises:
        ConfigError: The file cannot be read, or its surface is not closed or has inward faces.
    """
    name = os.fspath(path)
    trimesh = require("trimesh")
    try:
        mesh = trimesh.load(name, force="mesh")
    except Exception as error:  # The errors of trimesh depend on the format.
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise ConfigError(f"{name}: the mesh cannot be read ({reason}); give an STL, PLY or OBJ file") from None
    if not mesh.is_volume or _has_inverted_body(mesh.split()):
        raise ConfigError(
            f"{name}: the mesh is not a closed surface with outward faces (watertight: {mesh.is_watertight}, "
            f"consistent winding: {mesh.is_winding_consistent}); close its holes, "
            "make all faces point outwards, and let bodies overlap instead of sharing edges"
        )
    mesh.apply_scale(scale)
    return mesh


def _has_inverted_body(bodies: Sequence[Any]) -> bool:
    """Return whether the faces of a body point inwards, except for a cavity, which is inside another body."""
    inverted = [body for body in bodies if body.volume < 0.0]
    solid = [body for body in bodies if body.volume > 0.0] if inverted else []
    return any(not any(body.contains(hole.vertices).all() for body in solid) for hole in inverted)


class MeshTarget(TargetModel):
    """A target from a closed mesh file (STL, PLY or OBJ), which may consist of several bodies.

    Attributes:
        path: The file; a relative name is looked up next to the configuration file that contains it.
        scale: Factor from the lengths in the file to metres.
        inertia: Inertia about the mesh's origin [kg m^2], which is then the centre of mass; null for bodies of uniform
            density, of which parts that overlap count twice.
        mating_point: Position that the chaser's centre must reach, in the principal axes [m].
    """

    path: DataFile
    scale: float = Field(default=1.0, gt=0.0)
    inertia: InertiaMatrix | None = None
    mating_point: Point = (0.0, 0.0, 0.5)

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
        return Target(MeshSolid(list(mesh.split())), surface, inertia, np.array(self.mating_point))
