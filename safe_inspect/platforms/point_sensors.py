"""Sensors of the inspection points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from safe_inspect.geometry.clusters import (
    Clusters,
    KMeansRule,
    RowDraws,
    cluster_candidates,
    cluster_sklearn,
    direction_to_nearest,
)
from safe_inspect.platforms.base import Sensor
from safe_inspect.platforms.copies import copy_number, copy_turned, copy_vector
from safe_inspect.plugins.plugin import PlatformName, PointsName
from safe_inspect.simulators.arrays import for_kernel
from safe_inspect.simulators.row_terms.inputs import BodyArray, EnvironmentArray, OwnArray, SensorMemory
from safe_inspect.simulators.row_terms.loops import RowTerm
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.simulators.view import Group, View
from safe_inspect.simulators.world import World
from safe_inspect.tasks.inspection.rotation import array_in_axes_of, rotating_body, turned_direction_to_nearest

#: The declared arrays of an `UninspectedPointsSensor`, in the order of `Clusters`.
_MEMORY = ("centres", "count", "candidates", "settled")


class InspectedPointsSensor(Sensor, name="Sensor_InspectedPoints"):
    """Number of points that one deputy was the first to inspect [-], shape (R, 1).

    Attributes:
        inspector_entity_name: The deputy; default: the agent's own.
        inspection_entity_name: The body that carries the points.
    """

    elements: ClassVar[tuple[str, ...]] = ("n_inspected",)
    bounds: ClassVar[tuple[float, float]] = (0.0, np.inf)

    inspector_entity_name: PlatformName | None = None
    inspection_entity_name: PointsName = "chief"

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the count."""
        name, inspector = f"points/{self.inspection_entity_name}/own_count", self.inspector_entity_name
        return RowTerm(copy_number, (OwnArray(name) if inspector is None else BodyArray(name, inspector),))


class InspectedPointsScoreSensor(Sensor, name="Sensor_InspectedPointsScore"):
    """Total weight of the points that one deputy was the first to inspect [-], shape (R, 1).

    Attributes:
        inspector_entity_name: The deputy; default: the agent's own.
        inspection_entity_name: The body that carries the points.
    """

    elements: ClassVar[tuple[str, ...]] = ("score",)
    bounds: ClassVar[tuple[float, float]] = (0.0, np.inf)  # rounding may raise a complete score above 1

    inspector_entity_name: PlatformName | None = None
    inspection_entity_name: PointsName = "chief"

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the score."""
        name, inspector = f"points/{self.inspection_entity_name}/own_score", self.inspector_entity_name
        return RowTerm(copy_number, (OwnArray(name) if inspector is None else BodyArray(name, inspector),))


class PriorityVectorSensor(Sensor, name="Sensor_PriorityVector"):
    """Direction of the points with the largest weights [-], Hill frame, shape (R, 3); zeros if all weights are equal.

    It is fixed to the body.
    """

    elements: ClassVar[tuple[str, ...]] = ("x_priority", "y_priority", "z_priority")
    bounds: ClassVar[tuple[float, float]] = (-1.0, 1.0)

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the priority vector [-]."""
        vector = EnvironmentArray("priority_vector")
        if rotating_body(world) is None:
            return RowTerm(copy_vector, (vector,))
        return RowTerm(copy_turned, (EnvironmentArray("chief_orientation"), vector))


class UninspectedPointsSensor(Sensor, name="Sensor_UninspectedPoints"):
    """Direction to the nearest cluster of points that are lit and not inspected [-], shape (R, 3).

    The lit, uninspected points are clustered by K-means with one centre for every `points_per_cluster` of them,
    starting from the centres of the previous step. The reading is the unit vector from the body's centre to the cluster
    centre nearest to the deputy, in Hill's frame; zeros if no such point is left.

    Attributes:
        inspector_entity_name: The deputy; default: the agent's own.
        inspection_entity_name: The body that carries the points.
        points_per_cluster: Candidate points per centre; the number of centres is rounded up.
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
        """Declare the centres and the data that show whether they are up to date."""
        points = world.points[self.inspection_entity_name].num_points
        return {
            "centres": ArraySpec((-(-points // self.points_per_cluster), 3)),
            "count": ArraySpec((), np.int64),
            "candidates": ArraySpec((points,), np.bool_),
            "settled": ArraySpec((), np.bool_),
        }

    @property
    def _rule(self) -> KMeansRule:
        return KMeansRule(self.points_per_cluster, self.max_iterations)

    def remember(self, view: View, name: str) -> None:
        """Cluster the candidates of every row."""
        if self.backend == "sklearn":
            self._remember_with_sklearn(view, name)
            return
        bound = view.writable.bound.get((view.group.name, name))
        call, arguments = bound or self._bind(view, name)
        call(*arguments)

    def _bind(self, view: View, name: str) -> tuple[Any, tuple[Any, ...]]:
        state, group, model = view.writable, view.group, view.world.points[self.inspection_entity_name]
        found = state.bound[group.name, name] = (
            cluster_candidates.dispatcher,
            (
                state[array_in_axes_of(model.entity, view.world, "position")],
                model.body,
                (group.first, group.size),
                state[array_in_axes_of(model.entity, view.world, "sun_direction")],
                model.surface,
                state.points[self.inspection_entity_name].inspector,
                *(state.memory[group.name, name, array] for array in _MEMORY),
                RowDraws(state.key, state.step),
                self._rule,
            ),
        )
        return found

    def _remember_with_sklearn(self, view: View, name: str) -> None:
        points = view.points(self.inspection_entity_name)
        cluster_sklearn(
            points.model.points,
            points.candidates,
            Clusters(*(view.memory(name, array) for array in _MEMORY)),
            RowDraws(for_kernel(view.per_environment(view.state.key)), for_kernel(view.step)),
            self._rule,
        )

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the direction [-], Hill frame."""
        inspector, entity = self.inspector_entity_name, self.inspection_entity_name
        position = array_in_axes_of(entity, world, "position")
        viewer = OwnArray(position) if inspector is None else BodyArray(position, inspector)
        memory = (SensorMemory(self.part_name, name) for name in ("centres", "count"))
        inputs = viewer, BodyArray(position, entity), *memory
        if entity != rotating_body(world):
            return RowTerm(direction_to_nearest, inputs)
        return RowTerm(turned_direction_to_nearest, (EnvironmentArray("chief_orientation"), *inputs))
