"""The known properties of the target: shape, inertia and mating point."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np
from pydantic import AfterValidator

from safe_inspect.dynamics.attitude.inertia import principal_axes
from safe_inspect.geometry.oriented_boxes import OrientedBoxes
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


@dataclass(frozen=True, eq=False)
class Target:
    """The target, in its model frame M with the centre of mass at the origin.

    T is the frame of the principal axes, J1 <= J2 <= J3, with the same origin.

    Attributes:
        boxes: Boxes that cover the shape, in M; clearances are distances from them.
        mesh: The surface that sensors see, in M.
        inertia: Inertia about the centre of mass in M [kg m^2], shape (3, 3); it may be off by a common factor.
        mating_point: Position that the chaser's centre of mass must reach, in T [m], shape (3,).
    """

    boxes: OrientedBoxes
    mesh: TriangleMesh
    inertia: FloatArray
    mating_point: FloatArray

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

    @cached_property
    def swept_radius(self) -> float:
        """Radius of the sphere about the centre of mass that contains all boxes [m]."""
        return float(np.linalg.norm(self.boxes.corners, axis=2).max())

    @cached_property
    def landmark(self) -> FloatArray:
        """The corner of the boxes nearest to the mating point, in T [m], shape (3,)."""
        corners = self.boxes.corners.reshape(-1, 3) @ self.R_MT
        return np.asarray(corners[np.linalg.norm(corners - self.mating_point, axis=1).argmin()])


class TargetModel(Plugin):
    """Base class of target models."""

    kind: ClassVar[str] = "target_model"

    @abstractmethod
    def __call__(self) -> Target:
        """Return the target."""
