"""Sensors of the inspection points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from safe_inspect.compiling import njit
from safe_inspect.geometry.clusters import KMeansRule, RowDraws, cluster_candidates, direction_to_nearest
from safe_inspect.platforms.base import Sensor
from safe_inspect.platforms.copies import copy_number, copy_turned, copy_vector
from safe_inspect.plugins.plugin import PlatformName, PointsName
from safe_inspect.simulators import Group, Simulator, View, World
from safe_inspect.simulators.row_terms import BodyArray, EnvironmentArray, OwnArray, RowTerm, SensorMemory
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.tasks.inspection.points import InspectionPoints
from safe_inspect.tasks.inspection.rotation import array_in_axes_of, rotating_body, turned_direction_to_nearest
from safe_inspect.tasks.inspection.uninspected_moments import MOMENTS, turn_moments, uninspected_moments
from safe_inspect.types import FloatArray

#: The declared arrays of an `UninspectedPointsSensor`, in the order of `cluster_candidates`.
_MEMORY = ("centres", "count", "candidates", "settled")


def _call(kernel: Any, view: View, name: str, entity: str, memory: tuple[str, ...], *more: Any) -> None:
    """Call a kernel of the points of a body, for each deputy of a group. The state keeps its arguments.

    Args:
        kernel: The kernel.
        view: The state.
        name: Name of the sensor.
        entity: The body.
        memory: The arrays of the sensor that it writes.
        *more: Its last arguments.
    """
    state, group, model = view.writable, view.group, view.world.points[entity]
    bound = state.bound.get((group.name, name))
    if bound is None:
        sun = state[array_in_axes_of(entity, view.world, "sun_direction")]
        seen = group.size, sun, model.surface, state.points[entity].inspector
        own = (state.memory[group.name, name, array] for array in memory)
        bound = state.bound[group.name, name] = kernel.dispatcher, (*seen, *own, *more)
    call, arguments = bound
    call(*arguments)


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
        return RowTerm(copy_turned, (1.0, EnvironmentArray("chief_orientation"), vector))


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
    """

    elements: ClassVar[tuple[str, ...]] = ("x_ups", "y_ups", "z_ups")
    bounds: ClassVar[tuple[float, float]] = (-1.0, 1.0)

    inspector_entity_name: PlatformName | None = None
    inspection_entity_name: PointsName = "chief"
    points_per_cluster: int = Field(default=10, ge=1)
    max_iterations: int = Field(default=50, ge=1)

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the centres and the data that show whether they are up to date."""
        points = world.points[self.inspection_entity_name].num_points
        return {
            "centres": ArraySpec((-(-points // self.points_per_cluster), 3)),
            "count": ArraySpec((), np.int64),
            "candidates": ArraySpec((points,), np.bool_),
            "settled": ArraySpec((), np.bool_),
        }

    def remember(self, view: View, name: str) -> None:
        """Cluster the candidates of every row."""
        draws = RowDraws(view.writable.key, view.writable.step)
        rule = KMeansRule(self.points_per_cluster, self.max_iterations)
        _call(cluster_candidates, view, name, self.inspection_entity_name, _MEMORY, draws, rule)

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


_SUMS = "moments"
_KINDS = ("lit", "dark")
_OF_A_KIND = ("share", "x", "y", "z", "xx", "yy", "zz", "xy", "xz", "yz")


@njit
def _uninspected(inspector: NDArray[np.int8], reading: FloatArray) -> None:
    for p in range(len(reading)):
        reading[p] = 1.0 if inspector[p] < 0 else 0.0


class UninspectedPointsMapSensor(Sensor, name="Sensor_UninspectedPointsMap"):
    """1 for each point that no deputy has inspected, 0 for each inspected point [-], shape (R, num_points).

    The points are in the order of the body's sphere, fixed to the body.

    Attributes:
        inspection_entity_name: The body that carries the points.
        num_points: Number of points on the body; default: that of the task.
    """

    bounds: ClassVar[tuple[float, float]] = (0.0, 1.0)

    inspection_entity_name: PointsName = "chief"
    num_points: int = Field(default=100, ge=1)

    @property
    def element_names(self) -> tuple[str, ...]:
        """One name for each point, starting with uninspected_0."""
        return tuple(f"uninspected_{point}" for point in range(self.num_points))

    def in_task(self, simulator: Simulator, horizon: int) -> Self:
        """Return the sensor with the number of the body's points, unless `num_points` is set.

        Raises:
            ValueError: `num_points` is set to another number.
        """
        for component in simulator.compose()[1]:
            if isinstance(component, InspectionPoints) and self.inspection_entity_name in component.bodies:
                found = len(component.inspection_points_map[self.inspection_entity_name].positions)
                if "num_points" in self.model_fields_set:
                    self._require(found)
                return self.model_copy(update={"num_points": found})
        return self

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes 1 for each point that is not inspected, else 0.

        Raises:
            ValueError: The body has another number of points.
        """
        self._require(world.points[self.inspection_entity_name].num_points)
        return RowTerm(_uninspected, (EnvironmentArray(f"points/{self.inspection_entity_name}/inspector"),))

    def _require(self, found: int) -> None:
        if self.num_points != found:
            text = f"`num_points` is {self.num_points}, but {self.inspection_entity_name!r} has {found} points"
            raise ValueError(f"{text}; remove `num_points`")


class UninspectedPointsMomentsSensor(Sensor, name="Sensor_UninspectedPointsMoments"):
    """Distribution of the points that no deputy has inspected, in 20 numbers [-], Hill frame, shape (R, 20).

    The first ten numbers describe the set U of uninspected points that are lit, as seen from the agent's own position,
    and the other ten those that are dark. For the unit vectors u from the body's centre to the points of U they are

        share = |U| / P,   (x, y, z) = sum u / |U|,   (xx, yy, zz, xy, xz, yz) = sum u u^T / |U|,

    where P is the number of all points; all are zero if U is empty. The length of the mean indicates how close together
    the points are, and the second moments along which axes they are spread.

    Attributes:
        inspection_entity_name: The body that carries the points.
    """

    elements: ClassVar[tuple[str, ...]] = tuple(f"{name}_{kind}" for kind in _KINDS for name in _OF_A_KIND)
    bounds: ClassVar[tuple[float, float]] = (-1.0, 1.0)

    inspection_entity_name: PointsName = "chief"

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the moments in the axes of the body."""
        return {_SUMS: ArraySpec((MOMENTS,))}

    def remember(self, view: View, name: str) -> None:
        """Compute the moments of every row."""
        _call(uninspected_moments, view, name, self.inspection_entity_name, (_SUMS,))

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the moments [-], Hill frame."""
        moments = SensorMemory(self.part_name, _SUMS)
        if self.inspection_entity_name != rotating_body(world):
            return RowTerm(copy_vector, (moments,))
        return RowTerm(turn_moments, (EnvironmentArray("chief_orientation"), moments))
