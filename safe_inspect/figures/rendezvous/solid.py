"""Boxes in parallel projection: faces in patches, edges, and what they hide."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safe_inspect.geometry.oriented_boxes import OrientedBoxes
from safe_inspect.geometry.picture import Camera
from safe_inspect.types import BoolArray, FloatArray

#: Largest number of patches along an edge of a face.
_MOST_PATCHES = 24
#: Brightness of a face that is turned away from the light, as a share of the largest.
_SHADE = 0.58


class Solid(NamedTuple):
    """Boxes, divided into patches for painting.

    Attributes:
        boxes: The boxes.
        patches: Corners of the patches [m], shape (P, 4, 3).
        normals: Their outward normals, shape (P, 3).
        edges: Pieces of the boxes' edges [m], shape (E, 2, 3).
    """

    boxes: OrientedBoxes
    patches: FloatArray
    normals: FloatArray
    edges: FloatArray

    @classmethod
    def of(cls, boxes: OrientedBoxes, cell: float) -> Solid:
        """Return boxes divided into patches of about a given size [m]."""
        patches, normals, edges = [], [], []
        for centre, half, rotation in zip(boxes.centre, boxes.half_size, boxes.rotation, strict=True):
            counts = np.clip(np.ceil(2.0 * half / cell), 1, _MOST_PATCHES).astype(int)
            for axis in range(3):
                a, b = (axis + 1) % 3, (axis + 2) % 3
                for side in (-1.0, 1.0):
                    own = _face(half, axis, side, counts)
                    patches.append(own @ rotation.T + centre)
                    normals.append(np.broadcast_to(side * rotation[:, axis], (len(own), 3)))
                for signs in ((-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)):
                    line = np.empty((counts[axis] + 1, 3))
                    line[:, axis] = np.linspace(-half[axis], half[axis], counts[axis] + 1)
                    line[:, a], line[:, b] = signs[0] * half[a], signs[1] * half[b]
                    line = line @ rotation.T + centre
                    edges.append(np.stack((line[:-1], line[1:]), axis=1))
        return cls(boxes, np.concatenate(patches), np.concatenate(normals), np.concatenate(edges))

    def hides(self, points: FloatArray, sight: FloatArray) -> BoolArray:
        """Return which points, shape (..., 3), the boxes hide from a distant viewer in the direction `sight`."""
        boxes = self.boxes
        direction = np.einsum("bji,j->bi", boxes.rotation, sight)
        direction = np.where(np.abs(direction) < 1e-12, 1e-12, direction)
        origin = np.einsum("bji,...bj->...bi", boxes.rotation, points[..., None, :] - boxes.centre)
        first, last = (-boxes.half_size - origin) / direction, (boxes.half_size - origin) / direction
        near, far = np.minimum(first, last).max(axis=-1), np.maximum(first, last).min(axis=-1)
        tiny = 1e-3 * boxes.half_size.max()
        return np.asarray(((far > np.maximum(near, 0.0) + tiny) & (far > tiny)).any(axis=-1))

    def seen_patches(self, view: Camera) -> tuple[FloatArray, FloatArray]:
        """Return the patches that face the viewer, the farthest first.

        Returns:
            Corners in the picture [m], shape (n, 4, 2), and brightness from 0 to 1, shape (n,).
        """
        front = np.flatnonzero(self.normals @ view.sight > 1e-9)
        order = front[np.argsort(self.patches[front].mean(axis=1) @ view.sight, kind="stable")]
        light = view.sight + 0.55 * view.up - 0.35 * view.right
        bright = np.clip(self.normals[order] @ (light / np.linalg.norm(light)), 0.0, 1.0)
        return view.flat(self.patches[order]), _SHADE + (1.0 - _SHADE) * bright

    def seen_edges(self, view: Camera) -> FloatArray:
        """Return the pieces of the edges that are not hidden, in the picture [m], shape (n, 2, 2)."""
        return view.flat(self.edges[~self.hides(self.edges.mean(axis=1), view.sight)])


def _face(half: FloatArray, axis: int, side: float, counts: FloatArray) -> FloatArray:
    """Return the patches of one face along the box's own axes [m], shape (n, 4, 3)."""
    a, b = (axis + 1) % 3, (axis + 2) % 3
    u = np.linspace(-half[a], half[a], counts[a] + 1)
    v = np.linspace(-half[b], half[b], counts[b] + 1)
    patches = np.empty((counts[a], counts[b], 4, 3))
    patches[..., axis] = side * half[axis]
    for corner, (i, j) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
        patches[:, :, corner, a] = u[i : len(u) - 1 + i, None]
        patches[:, :, corner, b] = v[None, j : len(v) - 1 + j]
    return patches.reshape(-1, 4, 3)


def best_view(path: FloatArray, solid: Solid, rotation: FloatArray) -> Camera:
    """Return the view in which most of a path is visible and its end is far from the origin, from slightly above.

    Args:
        path: Points [m], shape (K, 3).
        solid: Boxes that may hide it.
        rotation: Rotation from the solid's frame to the path's, shape (3, 3).
    """

    def seen(view: Camera) -> float:
        lengths = np.linalg.norm(np.diff(view.flat(path), axis=0), axis=1)
        shown = lengths[~solid.hides(path[1:] @ rotation, view.sight @ rotation)].sum()
        return float(shown + 2.0 * np.linalg.norm(view.flat(path[-1])))

    return max((Camera.at(e, a) for e in (20.0, 35.0) for a in range(-180, 180, 15)), key=seen)
