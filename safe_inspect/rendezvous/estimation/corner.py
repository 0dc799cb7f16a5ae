"""Corners of a mapped surface, which show a camera where it is in all directions."""

from __future__ import annotations

import numpy as np

from safe_inspect.rendezvous.target.model import TriangleMesh
from safe_inspect.types import FloatArray

#: Radius of the neighbourhood of which normals are compared, and distance between the places that are tried [m].
_RADIUS, _SPACING = 0.06, 0.02
#: Minimum mean square of the normals along the direction that they show least: a third at the corner of a box, 0 on its
#: edges and faces, and up to 0.05 on a round or rough surface.
_LEAST_SHOWN = 0.1
#: Minimum share of the surface nearby that faces the point, and maximum distance relative to that of the nearest place.
_LEAST_FACING, _FARTHEST = 0.2, 2.0


def nearest_corner(mesh: TriangleMesh, point: FloatArray) -> FloatArray | None:
    """Return the corner of a surface that is nearest to a point and faces it [m], shape (3,); None without one.

    Args:
        mesh: The surface.
        point: The point [m], shape (3,).
    """
    from scipy.spatial import cKDTree  # slow to import

    corners = mesh.corners
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(area, axis=1)
    area, size, middles = area[size > 0.0], size[size > 0.0], corners[size > 0.0].mean(axis=1)
    cells = np.rint(mesh.vertices / _SPACING).astype(np.int64)
    places = mesh.vertices[np.unique(cells, axis=0, return_index=True)[1]]
    distance = np.linalg.norm(places - point, axis=1)
    order = np.argsort(distance)
    order = order[distance[order] < _FARTHEST * distance.min()]
    tree = cKDTree(middles)
    for place in places[order]:
        around = tree.query_ball_point(place, _RADIUS)
        if not around:
            continue
        normals, weights = area[around] / size[around, None], size[around] / size[around].sum()
        facing = weights[normals @ (point - place) > 0.0].sum()
        if facing > _LEAST_FACING and np.linalg.eigvalsh((weights * normals.T) @ normals)[0] > _LEAST_SHOWN:
            return np.asarray(place)
    return None
