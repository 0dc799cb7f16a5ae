"""Shape and inertia of a target, from its model frame M to its principal axes T."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from safe_inspect.geometry.oriented_boxes import BoxArrays, OrientedBoxes
from safe_inspect.types import FloatArray
from safe_inspect.units import Angle, Length, PositiveLength

#: A matrix of three rows.
Matrix3 = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]


class TargetBox(BaseModel):
    """Box of a target, fixed in its model frame M.

    Attributes:
        centre: Centre [m].
        half_size: Half sizes along the box's own axes [m].
        roll: Rotation of the box about the x axis [rad].
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    centre: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)
    half_size: tuple[PositiveLength, PositiveLength, PositiveLength] = Field(default=(1.0, 1.0, 1.0))
    roll: Angle = 0.0


def boxes_in_model(boxes: Sequence[TargetBox]) -> OrientedBoxes:
    """Return boxes as arrays, in M at full scale."""
    rolls = np.zeros((len(boxes), 3, 3))
    for index, box in enumerate(boxes):
        sine, cosine = np.sin(box.roll), np.cos(box.roll)
        rolls[index] = ((1.0, 0.0, 0.0), (0.0, cosine, -sine), (0.0, sine, cosine))
    return OrientedBoxes(np.array([box.centre for box in boxes]), np.array([box.half_size for box in boxes]), rolls)


def boxes_in_principal_axes(boxes: Sequence[TargetBox], scale: float, rotation: FloatArray) -> BoxArrays:
    """Return boxes in T.

    Args:
        boxes: The boxes in M, at full scale.
        scale: Size of the target relative to full scale [-].
        rotation: R_MT, shape (3, 3).
    """
    model = boxes_in_model(boxes)
    return BoxArrays(
        np.ascontiguousarray(scale * model.centre @ rotation),
        scale * model.half_size,
        np.ascontiguousarray(rotation.T[None] @ model.rotation),
    )
