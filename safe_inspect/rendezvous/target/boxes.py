"""Targets made of boxes: any boxes, and Envisat at any scale."""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from safe_inspect.dynamics.quaternion import exp, to_matrix
from safe_inspect.geometry.oriented_boxes import OrientedBoxes
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.target.model import InertiaMatrix, Point, Target, TargetModel, TriangleMesh
from safe_inspect.tasks.docking.shape import ENVISAT_BOXES, ENVISAT_INERTIA, boxes_in_model
from safe_inspect.types import FloatArray
from safe_inspect.units import Angle, PositiveLength

#: Signs of the corners of a box, and the twelve triangles of its faces, counter-clockwise as seen from outside.
_SIGNS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip
#: Number of small boxes on the bus that only sensors see, and their largest half size [m] at full scale.
_DETAILS, _DETAIL_SIZE = 16, 0.3


def aligned_boxes(centre: FloatArray, half_size: FloatArray) -> OrientedBoxes:
    """Return boxes aligned with the axes of the frame, from centres and half sizes [m], shape (B, 3)."""
    return OrientedBoxes(centre, half_size, np.broadcast_to(np.eye(3), (len(centre), 3, 3)))


def mesh_of_boxes(*parts: OrientedBoxes) -> TriangleMesh:
    """Return the faces of all boxes, twelve triangles for each."""
    offsets = [np.einsum("bij,kj,bj->bki", part.rotation, _SIGNS, part.half_size) for part in parts]
    corners = np.concatenate([part.centre[:, None, :] + offset for part, offset in zip(parts, offsets, strict=True)])
    faces = _FACES[None, :, :] + 8 * np.arange(len(corners))[:, None, None]
    return TriangleMesh(corners.reshape(-1, 3), faces.reshape(-1, 3).astype(np.int64))


def _inertia_of_boxes(boxes: OrientedBoxes) -> FloatArray:
    """Return the inertia of boxes of equal density that do not overlap, about their common centre of mass.

    It is the sum of ``m/3 R diag(|h|^2 - h^2) R^T + m (|c|^2 I - c c^T)`` over all boxes of mass m and half sizes h.

    Args:
        boxes: The boxes.

    Returns:
        Inertia in the boxes' frame for a total mass of 1 kg [kg m^2], shape (3, 3).
    """
    volume = boxes.half_size.prod(axis=1)
    share = volume / volume.sum()
    offset = boxes.centre - (share[:, None] * boxes.centre).sum(axis=0)
    square = boxes.half_size**2
    own = (square.sum(axis=1, keepdims=True) - square) / 3.0
    inertia = np.einsum("b,bij,bj,bkj->ik", share, boxes.rotation, own, boxes.rotation)
    distance = np.einsum("b,bi,bi->", share, offset, offset)
    return np.asarray(inertia + distance * np.eye(3) - np.einsum("b,bi,bj->ij", share, offset, offset))


class Box(BaseModel):
    """One box of a target.

    Attributes:
        centre: Centre of the box in the model's frame [m].
        half_size: Half of the box's lengths along its axes [m].
        rotation: Rotation vector from the box's axes to the model's axes [rad].
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    centre: Point = (0.0, 0.0, 0.0)
    half_size: tuple[PositiveLength, PositiveLength, PositiveLength] = (0.3, 0.2, 0.1)  # type: ignore[valid-type]
    rotation: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)  # type: ignore[valid-type]


class BoxTarget(TargetModel):
    """A target made of boxes, whose common centre of mass is the origin of the model's frame.

    Attributes:
        boxes: The boxes.
        inertia: Inertia about the centre of mass [kg m^2], which is then the origin; null for boxes of equal density.
        mating_point: Position that the chaser's centre must reach, in the principal axes [m].
    """

    boxes: tuple[Box, ...] = Field(default=(Box(),), min_length=1)
    inertia: InertiaMatrix | None = None
    mating_point: Point = (0.0, 0.0, 0.5)

    def __call__(self) -> Target:
        """Return the target."""
        rotation = to_matrix(exp(np.array([box.rotation for box in self.boxes])))
        centre = np.array([box.centre for box in self.boxes])
        half_size = np.array([box.half_size for box in self.boxes])
        inertia: FloatArray | None = None if self.inertia is None else np.array(self.inertia)
        if inertia is None:
            volume = half_size.prod(axis=1, keepdims=True)
            centre = centre - (volume * centre).sum(axis=0) / volume.sum()
            inertia = _inertia_of_boxes(OrientedBoxes(centre, half_size, rotation))
        boxes = OrientedBoxes(centre, half_size, rotation)
        return Target(boxes, mesh_of_boxes(boxes), inertia, np.array(self.mating_point))


class EnvisatTarget(TargetModel):
    """Envisat as boxes for bus, boom, radar antenna and solar array, with small boxes that only sensors see.

    The mass is proportional to the cube of the scale, and the inertia to its fifth power.

    Attributes:
        scale: Size relative to the satellite.
        mating_point: Position that the chaser's centre must reach, in the principal axes [m].
    """

    scale: float = Field(default=0.05, gt=0.0)
    mating_point: Point = (0.25, 0.0, 0.42)

    def __call__(self) -> Target:
        """Return the target."""
        boxes, scale = boxes_in_model(ENVISAT_BOXES), self.scale
        centre, half_size = _details(boxes)
        details = aligned_boxes(centre * scale, half_size * scale)
        boxes = OrientedBoxes(boxes.centre * scale, boxes.half_size * scale, boxes.rotation)
        seen, known = mesh_of_boxes(boxes, details), mesh_of_boxes(boxes)
        return Target(boxes, seen, np.array(ENVISAT_INERTIA) * scale**5, np.array(self.mating_point), known)


def _details(boxes: OrientedBoxes) -> tuple[FloatArray, FloatArray]:
    """Return centres and half sizes of small boxes that protrude by half from the faces of the bus, shape (n, 3)."""
    streams = Streams(0, np.arange(_DETAILS), np.zeros(_DETAILS, np.int64))
    where = streams.uniform("target.detail.where", 3) * 2.0 - 1.0
    size = _DETAIL_SIZE * (0.3 + 0.7 * streams.uniform("target.detail.size", 3))
    face = (streams.uniform("target.detail.face")[:, 0] * 6).astype(np.int64)
    axis, side = face % 3, np.where(face < 3, -1.0, 1.0)
    where[np.arange(_DETAILS), axis] = side
    return boxes.centre[0] + where * boxes.half_size[0], size
