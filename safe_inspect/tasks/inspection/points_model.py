"""`PointsModel`: the constant data of one body's inspection points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from safe_inspect.geometry.light import Light
from safe_inspect.geometry.visibility import Surface, lit
from safe_inspect.types import AnyArray, ArraySpec, BoolArray, FloatArray


@dataclass(frozen=True)
class PointsModel:
    """Inspection points of one body.

    Attributes:
        entity: Name of the body.
        body: Index of the body in the state's body axis.
        points: Positions relative to the body's centre [m], in its axes, shape (P, 3).
        radius: Radius of the sphere that carries them [m].
        light: The light model, for the compiled kernels.
    """

    entity: str
    body: int
    points: FloatArray
    radius: float
    light: Light

    @cached_property
    def surface(self) -> Surface:
        """Points, radius and light in the form used by the compiled kernels."""
        return Surface(self.points, self.radius, self.light)

    @property
    def num_points(self) -> int:
        """Number of points, P."""
        return len(self.points)

    def arrays(self, num_deputies: int) -> Mapping[str, ArraySpec]:
        """Return the arrays of a state that record the inspection, ``state.points[entity]``.

        ``inspector``: index of the deputy that first inspected each point, -1 for none, int8, shape (N, P).
        ``team_count``: points inspected by all deputies, shape (N,).
        ``own_count``: points first inspected by each deputy, shape (N, D).
        ``weights``: weight of each point, each row sums to 1, shape (N, P).
        ``team_score``: summed weight of the points inspected by all deputies, shape (N,).
        ``own_score``: summed weight of the points first inspected by each deputy, shape (N, D).
        """
        count = self.num_points
        specs = {
            "inspector": ArraySpec((count,), np.int8, -1),
            "team_count": ArraySpec((), np.int64),
            "own_count": ArraySpec((num_deputies,), np.int64),
            "team_score": ArraySpec(()),
            "own_score": ArraySpec((num_deputies,)),
            "weights": ArraySpec((count,), np.float64, 1.0 / count, constant=True),
        }
        return {f"points/{self.entity}/{name}": spec for name, spec in specs.items()}

    def lit(self, viewer: FloatArray, sun: FloatArray) -> BoolArray:
        """Return the mask of the points that are lit well enough to be inspected, shape (R, P).

        Args:
            viewer: Position of the viewer relative to the centre [m], axes of the body, shape (R, 3).
            sun: Unit vector to the sun, axes of the body, shape (R, 3).
        """
        return lit(np.ascontiguousarray(viewer), sun, self.points, self.radius, self.light)

    def candidates(self, viewer: FloatArray, sun: FloatArray, inspector: AnyArray) -> BoolArray:
        """Return the mask of the points that are lit well enough and not inspected, shape (R, P).

        Args:
            viewer: Position of the viewer relative to the centre [m], axes of the body, shape (R, 3).
            sun: Unit vector to the sun, axes of the body, shape (R, 3).
            inspector: Index of the deputy that inspected each point, -1 for none, shape (R, P).
        """
        return self.lit(viewer, sun) & (inspector < 0)
