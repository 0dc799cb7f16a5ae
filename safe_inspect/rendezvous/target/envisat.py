"""Envisat as boxes: full size 26 x 10 x 5 m, or scaled down.

Sources:
    Inertia and mass as published for the e.Deorbit studies; sizes from public drawings, rounded.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from safe_inspect.geometry.oriented_boxes import OrientedBoxes
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.target.box import aligned_boxes, join_boxes, mesh_of_boxes, scale_boxes
from safe_inspect.rendezvous.target.model import Point, Target, TargetModel
from safe_inspect.tasks.rendezvous.envisat import ENVISAT_BOXES, ENVISAT_INERTIA
from safe_inspect.tasks.rendezvous.shape import boxes_in_model

#: Mass [kg].
MASS = 7827.867
#: Number of small boxes on the bus that only sensors see, and their largest half size [m] at full scale.
_DETAILS, _DETAIL_SIZE = 16, 0.3


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
        seen = join_boxes(boxes, _details(boxes))
        return Target(
            boxes=scale_boxes(boxes, self.scale),
            mesh=mesh_of_boxes(scale_boxes(seen, self.scale)),
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
