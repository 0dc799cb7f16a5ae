"""Shape and inertia of a target, from its model frame M to its principal axes T, and those of Envisat."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from safe_inspect.geometry.oriented_boxes import BoxArrays, OrientedBoxes
from safe_inspect.types import FloatArray
from safe_inspect.units import Angle, Length, PositiveLength

#: Radius of the sphere that contains Astrobee, a cube of 0.32 m: half its diagonal is 0.277 m.
ASTROBEE_RADIUS = 0.28
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


#: Inertia of Envisat about the centre of mass in its model frame M at full scale [kg m^2], as published for the
#: e.Deorbit studies.
ENVISAT_INERTIA = ((17023.3, 397.1, -2171.4), (397.1, 124825.7, 344.2), (-2171.4, 344.2, 129112.2))
#: Boxes that cover Envisat: bus, solar array, boom and radar antenna; sizes from public drawings, rounded.
ENVISAT_BOXES = (
    TargetBox(centre=(-1.14, 0.0, 0.0), half_size=(5.0, 1.375, 1.05)),
    TargetBox(centre=(12.9, 0.0, 0.0), half_size=(7.0, 2.5, 0.06), roll="22 deg"),
    TargetBox(centre=(4.88, 0.0, 0.0), half_size=(1.02, 0.15, 0.15)),
    TargetBox(centre=(-1.14, 0.0, -1.45), half_size=(5.0, 0.65, 0.10)),
)
