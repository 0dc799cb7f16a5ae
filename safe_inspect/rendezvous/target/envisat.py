"""Envisat as boxes: full size 26 x 10 x 5 m, or scaled down.

Sources:
    Inertia and mass as published for the e.Deorbit studies; sizes from public drawings, rounded.
"""

from __future__ import annotations

import numpy as np

from safe_inspect.geometry.oriented_boxes import OrientedBoxes
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.target.box import aligned_boxes, join_boxes, mesh_of_boxes, scale_boxes
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.tasks.rendezvous.envisat import ENVISAT_BOXES, ENVISAT_INERTIA
from safe_inspect.tasks.rendezvous.shape import boxes_in_model
from safe_inspect.types import FloatArray

#: Mass [kg].
MASS = 7827.867
#: Number of small boxes on the bus that only sensors see, and their largest half size [m] at full scale.
_DETAILS, _DETAIL_SIZE = 16, 0.3


def envisat_boxes() -> OrientedBoxes:
    """Return the boxes of the bus, the solar array, the boom and the radar antenna at full scale, in M."""
    return boxes_in_model(ENVISAT_BOXES)


def envisat(scale: float, mating_point: FloatArray, detail_seed: int = 0) -> Target:
    """Return the target.

    Args:
        scale: Its size relative to the satellite's.
        mating_point: In T [m], shape (3,).
        detail_seed: Seed of the small boxes on the bus that are in the mesh and not in the boxes.

    Returns:
        The target; mass scales by the cube and inertia by the fifth power of the scale.
    """
    boxes = envisat_boxes()
    seen = join_boxes(boxes, _details(boxes, detail_seed))
    return Target(
        boxes=scale_boxes(boxes, scale),
        mesh=mesh_of_boxes(scale_boxes(seen, scale)),
        inertia=np.array(ENVISAT_INERTIA) * scale**5,
        mating_point=np.asarray(mating_point, dtype=np.float64),
    )


def _details(boxes: OrientedBoxes, detail_seed: int) -> OrientedBoxes:
    """Return small boxes that stand half out of the bus's faces."""
    streams = Streams(detail_seed, np.arange(_DETAILS), np.zeros(_DETAILS, np.int64))
    where = streams.uniform("target.detail.where", 3) * 2.0 - 1.0
    size = _DETAIL_SIZE * (0.3 + 0.7 * streams.uniform("target.detail.size", 3))
    face = (streams.uniform("target.detail.face")[:, 0] * 6).astype(np.int64)
    axis, side = face % 3, np.where(face < 3, -1.0, 1.0)
    where[np.arange(_DETAILS), axis] = side
    return aligned_boxes(boxes.centre[0] + where * boxes.half_size[0], size)
