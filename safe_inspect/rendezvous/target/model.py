"""The known properties of the target: shape, inertia and mating point."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar, Protocol, Self

import numpy as np
from pydantic import AfterValidator

from safe_inspect.dynamics.attitude.inertia import principal_axes
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.types import FloatArray, IntArray
from safe_inspect.units import Length, quantity


def _checked_inertia(inertia: InertiaMatrix) -> InertiaMatrix:
    """Return an inertia after checking that it is that of a rigid body."""
    principal_axes(np.array(inertia))
    return inertia


_Moment = quantity("kg m^2")
_Row = tuple[_Moment, _Moment, _Moment]  # type: ignore[valid-type]
#: Field types of a point [m] and of an inertia [kg m^2] in a configuration.
Point = tuple[Length, Length, Length]  # type: ignore[valid-type]
InertiaMatrix = Annotated[tuple[_Row, _Row, _Row], AfterValidator(_checked_inertia)]


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A surface of triangles, counter-clockwise as seen from outside.

    Attributes:
        vertices: Vertices [m], shape (V, 3).
        faces: Indices of the corners of each triangle, shape (F, 3).
    """

    vertices: FloatArray
    faces: IntArray

    @property
    def corners(self) -> FloatArray:
        """The corners of each triangle [m], shape (F, 3, 3)."""
        return np.asarray(self.vertices[self.faces])

    def in_units_of(self, length: float) -> TriangleMesh:
        """Return the surface with all lengths divided by a length [m]."""
        return TriangleMesh(self.vertices / length, self.faces)


class Solid(Protocol):
    """What clearances are measured from: `OrientedBoxes`, or the bodies of a mesh."""

    @property
    def vertices(self) -> FloatArray:
        """Points whose hull contains the solid [m], shape (V, 3)."""

    def in_units_of(self, length: float) -> Self:
        """Return the solid with all lengths divided by a length [m]."""

    def distance(self, points: FloatArray) -> FloatArray:
        """Return signed distances of points [m], shape (N, 3), or lower bounds, negative inside, shape (N,)."""

    def distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the signed distances to each part [m], shape (N, B), and their unit gradients, shape (N, B, 3)."""


@dataclass(frozen=True, eq=False)
class Target:
    """The target, in its model frame M with the centre of mass at the origin.

    T is the frame of the principal axes, J1 <= J2 <= J3, with the same origin.

    Attributes:
        solid: What clearances are measured from, in M.
        mesh: The surface that sensors see, in M.
        inertia: Inertia about the centre of mass in M [kg m^2], shape (3, 3); it may be off by a common factor.
        mating_point: Position that the chaser's centre of mass must reach, in T [m], shape (3,).
        model: The surface that the chaser knows, in M; None for that of `mesh`.
        corner: Where the camera looks near the mating point, in M [m], shape (3,); None for the nearest vertex.
    """

    solid: Solid
    mesh: TriangleMesh
    inertia: FloatArray
    mating_point: FloatArray
    model: TriangleMesh | None = None
    corner: FloatArray | None = None

    def __post_init__(self) -> None:
        principal_axes(self.inertia)  # Raises an error if no rigid body has this inertia.

    @cached_property
    def principal(self) -> FloatArray:
        """Principal moments J1 <= J2 <= J3 [kg m^2], shape (3,)."""
        return principal_axes(self.inertia)[0]

    @cached_property
    def R_MT(self) -> FloatArray:  # noqa: N802
        """The rotation that takes coordinates in T to M, shape (3, 3)."""
        return principal_axes(self.inertia)[1]

    @property
    def shape(self) -> TriangleMesh:
        """The surface that the chaser knows, in M."""
        return self.mesh if self.model is None else self.model

    @cached_property
    def swept_radius(self) -> float:
        """Radius of the sphere about the centre of mass that contains the target [m]."""
        return float(np.linalg.norm(self.solid.vertices, axis=1).max())

    @cached_property
    def landmark(self) -> FloatArray:
        """Where the camera looks near the mating point, in T [m], shape (3,)."""
        if self.corner is not None:
            return np.asarray(self.corner @ self.R_MT)
        corners = self.solid.vertices @ self.R_MT
        return np.asarray(corners[np.linalg.norm(corners - self.mating_point, axis=1).argmin()])

    def in_units_of(self, length: float) -> Target:
        """Return the target with all lengths divided by a length [m]; its inertia changes by a common factor."""
        solid, mesh = self.solid.in_units_of(length), self.mesh.in_units_of(length)
        model = None if self.model is None else self.model.in_units_of(length)
        corner = None if self.corner is None else self.corner / length
        return Target(solid, mesh, self.inertia, self.mating_point / length, model, corner)


class TargetModel(Plugin):
    """Base class of target models."""

    kind: ClassVar[str] = "target_model"

    @abstractmethod
    def __call__(self) -> Target:
        """Return the target."""
