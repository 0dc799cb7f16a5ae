"""Signed distance to a union of oriented boxes, with its gradient."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.types import FloatArray


class BoxArrays(NamedTuple):
    """The arrays of `OrientedBoxes`, in the form that kernels use.

    Attributes:
        centre: Centres [m], shape (B, 3).
        half_size: Half sizes along the boxes' own axes [m], shape (B, 3).
        rotation: Rotations from a box's axes to the common frame, shape (B, 3, 3).
    """

    centre: FloatArray
    half_size: FloatArray
    rotation: FloatArray


@njit
def box_distance(boxes: BoxArrays, x: float, y: float, z: float) -> float:
    """Return the smallest signed distance to the boxes [m], negative inside; see `OrientedBoxes.distance`.

    Args:
        boxes: The boxes.
        x: First coordinate of the point in the boxes' frame [m].
        y: Second coordinate [m].
        z: Third coordinate [m].
    """
    least = math.inf
    for b in range(boxes.centre.shape[0]):
        centre, half_size, rotation = boxes.centre[b], boxes.half_size[b], boxes.rotation[b]
        dx, dy, dz = x - centre[0], y - centre[1], z - centre[2]
        square, deepest = 0.0, -math.inf
        for i in range(3):
            a = abs(rotation[0, i] * dx + rotation[1, i] * dy + rotation[2, i] * dz) - half_size[i]
            deepest = max(deepest, a)
            if a > 0.0:
                square += a * a
        least = min(least, math.sqrt(square) if square > 0.0 else deepest)
    return least


@dataclass(frozen=True, eq=False)
class OrientedBoxes:
    """Boxes that are fixed in one frame.

    Attributes:
        centre: Centres [m], shape (B, 3).
        half_size: Half sizes along the boxes' own axes [m], shape (B, 3).
        rotation: Rotations from a box's axes to the common frame, shape (B, 3, 3).
    """

    centre: FloatArray
    half_size: FloatArray
    rotation: FloatArray

    def __post_init__(self) -> None:
        for name, tail in (("centre", (3,)), ("half_size", (3,)), ("rotation", (3, 3))):
            array = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            object.__setattr__(self, name, array)
            if array.ndim != 1 + len(tail) or array.shape[1:] != tail or len(array) != len(self.centre):
                raise ValueError(
                    f"boxes: {name} must have the shape (B, {', '.join(map(str, tail))}), got {array.shape}"
                )
        if not (self.half_size > 0.0).all():
            raise ValueError(f"boxes: half_size must be positive [m], got {self.half_size.min()}")

    def __len__(self) -> int:
        return len(self.centre)

    @property
    def corners(self) -> FloatArray:
        """The corners of each box [m], shape (B, 8, 3)."""
        signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, 8).T
        offsets = np.einsum("bij,kj,bj->bki", self.rotation, signs, self.half_size)
        return np.asarray(self.centre[:, None, :] + offsets)

    @property
    def vertices(self) -> FloatArray:
        """The corners of all boxes [m], shape (8 B, 3)."""
        return self.corners.reshape(-1, 3)

    def in_units_of(self, length: float) -> OrientedBoxes:
        """Return the boxes with all lengths divided by a length [m]."""
        return OrientedBoxes(self.centre / length, self.half_size / length, self.rotation)

    def distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the signed distance to each box and its gradient.

        With ``q = R^T (p - centre)`` and ``a = |q| - half_size``: outside ``d = |max(a, 0)|`` and the gradient is
        ``R (max(a, 0) / d * sign(q))``; inside ``d = max(a)`` and the gradient is the outward axis of that face.

        Args:
            points: Points [m], shape (N, 3), in the boxes' frame.

        Returns:
            Distances [m], negative inside, shape (N, B), and unit gradients [-], shape (N, B, 3).
        """
        q, a, positive, outside, distance = self._parts(points)
        sign, face, is_outside = np.where(q < 0.0, -1.0, 1.0), a.argmax(axis=2), outside > 0.0
        normal = np.where(
            is_outside[..., None], positive / np.where(is_outside, outside, 1.0)[..., None], np.eye(3)[face]
        )
        return distance, np.einsum("bij,nbj->nbi", self.rotation, normal * sign)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance to the union [m], the smallest over the boxes, shape (N,).

        Outside it is exact; inside, where boxes overlap, the true depth may be larger. It is 1-Lipschitz everywhere.

        Args:
            points: Points [m], shape (N, 3), in the boxes' frame.
        """
        return np.asarray(self._parts(points)[-1].min(axis=1))

    def _parts(self, points: FloatArray) -> tuple[FloatArray, ...]:
        """Return q, a, max(a, 0), its length and the signed distance to each box, shape (N, B); see `distances`."""
        q = np.einsum("bji,nbj->nbi", self.rotation, points[:, None, :] - self.centre)
        a = np.abs(q) - self.half_size
        positive = np.maximum(a, 0.0)
        outside = np.sqrt(np.einsum("nbi,nbi->nb", positive, positive))
        return q, a, positive, outside, np.where(outside > 0.0, outside, a.max(axis=2))
