"""Targets made of boxes: any boxes, and Envisat at any scale."""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator

from safe_inspect.dynamics.quaternion import exp, to_matrix
from safe_inspect.geometry.oriented_boxes import OrientedBoxes
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.target.model import (
    InertiaMatrix,
    Point,
    Target,
    TargetModel,
    TriangleMesh,
    checked_inertia,
)
from safe_inspect.tasks.rendezvous.envisat import ENVISAT_BOXES, ENVISAT_INERTIA
from safe_inspect.tasks.rendezvous.shape import boxes_in_model
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
#: Mass [kg].
MASS = 7827.867
#: Number of small boxes on the bus that only sensors see, and their largest half size [m] at full scale.
_DETAILS, _DETAIL_SIZE = 16, 0.3


def aligned_boxes(centre: FloatArray, half_size: FloatArray) -> OrientedBoxes:
    """Return boxes aligned with the axes of the frame, from centres and half sizes [m], shape (B, 3)."""
    return OrientedBoxes(centre, half_size, np.broadcast_to(np.eye(3), (len(centre), 3, 3)))


def _join_boxes(*parts: OrientedBoxes) -> OrientedBoxes:
    """Return the boxes of several sets as one set."""
    return OrientedBoxes(
        np.concatenate([part.centre for part in parts]),
        np.concatenate([part.half_size for part in parts]),
        np.concatenate([part.rotation for part in parts]),
    )


def _scale_boxes(boxes: OrientedBoxes, scale: float) -> OrientedBoxes:
    """Return boxes scaled about the origin."""
    return OrientedBoxes(boxes.centre * scale, boxes.half_size * scale, boxes.rotation)


def _mesh_of_boxes(boxes: OrientedBoxes) -> TriangleMesh:
    """Return the faces of all boxes, twelve triangles for each."""
    corners = boxes.centre[:, None, :] + np.einsum("bij,kj,bj->bki", boxes.rotation, _SIGNS, boxes.half_size)
    faces = _FACES[None, :, :] + 8 * np.arange(len(boxes))[:, None, None]
    return TriangleMesh(corners.reshape(-1, 3), faces.reshape(-1, 3).astype(np.int64))


def _inertia_of_boxes(boxes: OrientedBoxes, mass: float) -> FloatArray:
    """Return the inertia of boxes of equal density that do not overlap, about their common centre of mass.

    It is the sum of ``m/3 R diag(|h|^2 - h^2) R^T + m (|c|^2 I - c c^T)`` over all boxes of mass m and half sizes h.

    Args:
        boxes: The boxes.
        mass: The total mass of the boxes [kg].

    Returns:
        Inertia in the boxes' frame [kg m^2], shape (3, 3).
    """
    volume = boxes.half_size.prod(axis=1)
    share = mass * volume / volume.sum()
    offset = boxes.centre - (share[:, None] * boxes.centre).sum(axis=0) / mass
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

    _check_inertia = field_validator("inertia")(checked_inertia)

    def __call__(self) -> Target:
        """Return the target."""
        rotation = to_matrix(exp(np.array([box.rotation for box in self.boxes])))
        centre = np.array([box.centre for box in self.boxes])
        half_size = np.array([box.half_size for box in self.boxes])
        inertia: FloatArray | None = None if self.inertia is None else np.array(self.inertia)
        if inertia is None:
            volume = half_size.prod(axis=1, keepdims=True)
            centre = centre - (volume * centre).sum(axis=0) / volume.sum()
            inertia = _inertia_of_boxes(OrientedBoxes(centre, half_size, rotation), 1.0)
        boxes = OrientedBoxes(centre, half_size, rotation)
        return Target(boxes, _mesh_of_boxes(boxes), inertia, np.array(self.mating_point))


def envisat_boxes() -> OrientedBoxes:
    """Return the boxes of the bus, the solar array, the boom and the radar antenna at full scale, in M."""
    return boxes_in_model(ENVISAT_BOXES)


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
        boxes = envisat_boxes()
        seen = _join_boxes(boxes, _details(boxes))
        return Target(
            boxes=_scale_boxes(boxes, self.scale),
            mesh=_mesh_of_boxes(_scale_boxes(seen, self.scale)),
            inertia=np.array(ENVISAT_INERTIA) * self.scale**5,
            mating_point=np.array(self.mating_point),
        )


def _details(boxes: OrientedBoxes) -> OrientedBoxes:
    """Return small boxes that protrude by half from the faces of the bus."""
    streams = Streams(0, np.arange(_DETAILS), np.zeros(_DETAILS, np.int64))
    where = streams.uniform("target.detail.where", 3) * 2.0 - 1.0
    size = _DETAIL_SIZE * (0.3 + 0.7 * streams.uniform("target.detail.size", 3))
    face = (streams.uniform("target.detail.face")[:, 0] * 6).astype(np.int64)
    axis, side = face % 3, np.where(face < 3, -1.0, 1.0)
    where[np.arange(_DETAILS), axis] = side
    return aligned_boxes(boxes.centre[0] + where * boxes.half_size[0], size)
