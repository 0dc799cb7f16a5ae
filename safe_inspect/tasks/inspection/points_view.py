"""`PointsModel`, the constant data of one body's inspection points, and `PointsView`, the points in one state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np

from safe_inspect.geometry.visibility import Surface, lit
from safe_inspect.simulators.arrays import read_only
from safe_inspect.simulators.view import Step, View
from safe_inspect.tasks.inspection.rotation import array_in_axes_of
from safe_inspect.types import AnyArray, ArraySpec, BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class PointsModel:
    """Inspection points of one body.

    Attributes:
        entity: Name of the body.
        body: Index of the body in the state's body axis.
        points: Positions relative to the body's centre [m], in its axes, shape (P, 3).
        radius: Radius of the sphere that carries them [m].
        terminator: Height towards the sun above which a point is lit [m]; see `Surface`.
    """

    entity: str
    body: int
    points: FloatArray
    radius: float
    terminator: float

    @cached_property
    def surface(self) -> Surface:
        """Points, radius and terminator in the form used by the compiled kernels."""
        return Surface(self.points, self.radius, self.terminator)

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

    def lit(self, sun: FloatArray) -> BoolArray:
        """Return the mask of the points that are lit, shape (R, P), for unit vectors to the sun, axes of the body."""
        return lit(sun, self.points, self.terminator)


class PointsView:
    """Inspection points of one body, for the agents of a group. The arrays are read-only."""

    def __init__(self, view: View, model: PointsModel) -> None:
        self._view = view
        self._state = view.state.points[model.entity]
        self.model = model

    @property
    def num_points(self) -> int:
        """Number of points, P."""
        return self.model.num_points

    @property
    def inspector(self) -> AnyArray:
        """Index of the deputy that first inspected each point, -1 for none, shape (R, P)."""
        return self._view.per_environment(self._state.inspector)

    @cached_property
    def inspected(self) -> BoolArray:
        """Points that any deputy has inspected, shape (R, P)."""
        return read_only(np.asarray(self.inspector >= 0))

    @property
    def count(self) -> IntArray:
        """Number of points that the team has inspected, shape (R,)."""
        return self._view.per_environment(self._state.team_count)

    @property
    def fraction(self) -> FloatArray:
        """Fraction of the points that the team has inspected [-], shape (R,)."""
        return self.count / self.num_points

    def count_of(self, platform: str | None = None) -> IntArray:
        """Return the number of points first inspected by one deputy, by default the agent's own, shape (R,)."""
        if platform is None:
            return self._view.per_agent(self._state.own_count)
        return self._view.per_environment(self._state.own_count[:, self._view.world.bodies[platform]])

    @property
    def weights(self) -> FloatArray:
        """Weight of each point, rows sum to 1, shape (R, P)."""
        return self._view.per_environment(self._state.weights)

    @property
    def inspected_weight(self) -> FloatArray:
        """Summed weight of the points that the team has inspected, 0 to 1, shape (R,)."""
        return self._view.per_environment(self._state.team_score)

    @cached_property
    def lit(self) -> BoolArray:
        """Points that are lit, shape (R, P)."""
        sun = self._view.writable[array_in_axes_of(self.model.entity, self._view.world, "sun_direction")]
        return read_only(self.model.lit(self._view.per_environment(sun)))


@dataclass(frozen=True)
class PointsOf:
    """Inspection points in one state, by the body that carries them."""

    view: View

    def __call__(self, entity: str) -> PointsView:
        """Return the inspection points of a body."""
        points = PointsView(self.view, self.view.world.points[entity])
        return cast(PointsView, self.view.derived.setdefault(("points", entity), points))


@dataclass(frozen=True)
class NewPoints:
    """Points that were first inspected in a step."""

    step: Step

    def __call__(self, entity: str) -> IntArray:
        """Return the number of points of a body that the team first inspected in this step, shape (R,).

        Points seen at the reset count as new in the first step of the episode.
        """
        after = self.step.after.points(entity).count
        before = self.step.before.points(entity).count
        return np.asarray(after - np.where(self.step.first, 0, before))
