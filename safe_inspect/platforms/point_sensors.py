"""Sensors of the inspection points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from safe_inspect.platforms.base import Sensor
from safe_inspect.plugins.plugin import PlatformName, PointsName
from safe_inspect.simulators.arrays import for_kernel
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.simulators.view import View
from safe_inspect.simulators.world import World
from safe_inspect.types import FloatArray


class InspectedPointsSensor(Sensor, name="Sensor_InspectedPoints"):
    """Number of points that one deputy was the first to inspect [-], shape (R, 1).

    Attributes:
        inspector_entity_name: The deputy; the own one unless given.
        inspection_entity_name: The body that carries the points.
    """

    elements: ClassVar[tuple[str, ...]] = ("n_inspected",)
    bounds: ClassVar[tuple[float, float]] = (0.0, np.inf)

    inspector_entity_name: PlatformName | None = None
    inspection_entity_name: PointsName = "chief"

    def __call__(self, view: View) -> FloatArray:
        """Return the count, shape (R, 1)."""
        count = view.points(self.inspection_entity_name).count_of(self.inspector_entity_name)
        return np.asarray(count[:, None], dtype=np.float64)


class UninspectedPointsSensor(Sensor, name="Sensor_UninspectedPoints"):
    """Direction to the nearest cluster of points that are lit and not inspected [-], shape (R, 3).

    The lit, uninspected points are clustered by K-means with one centre for every `points_per_cluster` of them,
    started from the centres of the step before. The reading is the unit vector from the body's centre to the centre
    nearest to the deputy, in Hill's frame; zeros when no point is left.

    Attributes:
        inspector_entity_name: The deputy; the own one unless given.
        inspection_entity_name: The body that carries the points.
        points_per_cluster: Candidates for each centre, rounded up.
        max_iterations: Largest number of Lloyd iterations in a step.
        backend: ``native`` (compiled, over the whole batch) or ``sklearn`` (scikit-learn's KMeans from the same start).
    """

    elements: ClassVar[tuple[str, ...]] = ("x_ups", "y_ups", "z_ups")
    bounds: ClassVar[tuple[float, float]] = (-1.0, 1.0)

    inspector_entity_name: PlatformName | None = None
    inspection_entity_name: PointsName = "chief"
    points_per_cluster: int = Field(default=10, ge=1)
    max_iterations: int = Field(default=50, ge=1)
    backend: Literal["native", "sklearn"] = "native"

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the centres and what tells whether they are up to date."""
        points = world.points[self.inspection_entity_name].num_points
        return {
            "centres": ArraySpec((-(-points // self.points_per_cluster), 3)),
            "count": ArraySpec((), np.int64),
            "candidates": ArraySpec((points,), np.bool_),
            "settled": ArraySpec((), np.bool_),
        }

    def remember(self, view: View, name: str) -> None:
        """Cluster the candidates of every row."""
        if self.backend == "sklearn":
            self._remember_with_sklearn(view, name)
            return
        from safe_inspect.geometry.looking import cluster_candidates

        state, group, model = view.writable, view.group, view.world.points[self.inspection_entity_name]
        memory = state.memory
        cluster_candidates(
            state.position,
            model.body,
            group.first,
            group.size,
            state.sun_direction,
            model.points,
            model.radius,
            model.light,
            state.points[self.inspection_entity_name].inspector,
            memory[group.name, name, "centres"],
            memory[group.name, name, "count"],
            state.key,
            state.step,
            self.points_per_cluster,
            self.max_iterations,
            memory[group.name, name, "candidates"],
            memory[group.name, name, "settled"],
        )

    def _remember_with_sklearn(self, view: View, name: str) -> None:
        from safe_inspect.geometry.clusters import cluster_sklearn

        points = view.points(self.inspection_entity_name)
        cluster_sklearn(
            points.model.points,
            points.candidates,
            view.memory(name, "centres"),
            view.memory(name, "count"),
            for_kernel(view.per_environment(view.state.key)),
            for_kernel(view.step),
            self.points_per_cluster,
            self.max_iterations,
            view.memory(name, "candidates"),
            view.memory(name, "settled"),
        )

    def __call__(self, view: View) -> FloatArray:
        """Return the direction [-], Hill frame, shape (R, 3)."""
        from safe_inspect.geometry.clusters import nearest_centre

        name = self.part_name
        entity = self.inspection_entity_name
        if self.inspector_entity_name is None:
            position = view.position
        else:
            position = view.entity_position(self.inspector_entity_name)
        relative = position - view.entity_position(entity)
        memory, group = view.writable.memory, view.group.name
        return nearest_centre(relative, memory[group, name, "centres"], memory[group, name, "count"])
