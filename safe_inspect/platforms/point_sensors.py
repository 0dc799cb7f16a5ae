"""Sensors of the inspection points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from safe_inspect.compiling import njit
from safe_inspect.dynamics.rotation_row import rotated
from safe_inspect.geometry.clusters import KMeansRule, RowDraws, cluster_candidates, direction_to_nearest
from safe_inspect.geometry.visibility import Surface, light_row, point_axes
from safe_inspect.platforms.base import Sensor
from safe_inspect.platforms.copies import copy_number, copy_turned, copy_vector
from safe_inspect.plugins.plugin import PlatformName, PointsName
from safe_inspect.simulators import Group, Simulator, View, World
from safe_inspect.simulators.row_terms import BodyArray, EnvironmentArray, OwnArray, RowTerm, SensorMemory
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.tasks.inspection.points import InspectionPoints
from safe_inspect.tasks.inspection.rotation import array_in_axes_of, rotating_body
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


@njit
def _turned_direction_to_nearest(
    orientation: FloatArray,
    viewer: FloatArray,
    body: FloatArray,
    centres: FloatArray,
    count: int,
    direction: FloatArray,
) -> None:
    """Call `direction_to_nearest` in the axes of a rotating body, and write the direction in Hill's frame.

    Args:
        orientation: Attitude of the body, from its axes to Hill's frame, shape (4,).
        viewer: As in `direction_to_nearest`, in the body's axes.
        body: As in `direction_to_nearest`, in the body's axes.
        centres: As in `direction_to_nearest`, in the body's axes.
        count: As in `direction_to_nearest`.
        direction: Receives the direction [-], Hill frame, shape (3,).
    """
    direction_to_nearest(viewer, body, centres, count, direction)
    turned = rotated(orientation, direction[0], direction[1], direction[2])
    for k in range(3):
        direction[k] = turned[k]


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
        return RowTerm(_turned_direction_to_nearest, (EnvironmentArray("chief_orientation"), *inputs))


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


_SUMS = "moments"
_KINDS = ("lit", "dark")
_OF_A_KIND = ("share", "x", "y", "z", "xx", "yy", "zz", "xy", "xz", "yz")
#: Length of the moments of one kind of points.
_ELEMENTS = len(_OF_A_KIND)


@njit
def _within_unit(value: float) -> float:
    return min(max(value, -1.0), 1.0)


@njit
def _uninspected_moments(
    size: int, sun: FloatArray, surface: Surface, inspector: NDArray[np.int8], moments: FloatArray
) -> None:
    """Write the moments of the points that no deputy has inspected, lit and dark, for each deputy of a group.

    Args:
        size: Number of deputies of the group, G; R = N * G rows.
        sun: Unit vectors to the sun [-], shape (N, 3).
        surface: The points of the body, relative to its centre.
        inspector: Index of the deputy that inspected each point, -1 for none, shape (N, P).
        moments: Receives, for the lit points and then for the dark ones: their number over P, the mean of their unit
            vectors, and the mean of the products xx, yy, zz, xy, xz, yz; zeros if there are none; shape (R, 20).
    """
    total = surface.points.shape[0]
    axes, bright = point_axes(surface.points), np.empty(total, dtype=np.bool_)
    for n in range(sun.shape[0]):
        light_row(sun[n], axes, surface.terminator, bright)
        for g in range(size):
            sums = moments[n * size + g]
            sums[:] = 0.0
            for p in range(total):
                if inspector[n, p] >= 0:
                    continue
                at = 0 if bright[p] else _ELEMENTS
                x, y, z = axes[0, p] / surface.radius, axes[1, p] / surface.radius, axes[2, p] / surface.radius
                sums[at] += 1.0
                sums[at + 1] += x
                sums[at + 2] += y
                sums[at + 3] += z
                sums[at + 4] += x * x
                sums[at + 5] += y * y
                sums[at + 6] += z * z
                sums[at + 7] += x * y
                sums[at + 8] += x * z
                sums[at + 9] += y * z
            for at in (0, _ELEMENTS):
                count = sums[at]
                if count > 0.0:
                    sums[at] = count / total
                    for k in range(1, _ELEMENTS):
                        sums[at + k] = _within_unit(sums[at + k] / count)


@njit
def _turn_moments(orientation: FloatArray, moments: FloatArray, turned: FloatArray) -> None:
    """Write moments in Hill's frame: ``R m`` of the means, ``R M R^T`` of the second moments.

    Args:
        orientation: Attitude of the body, from its axes to Hill's frame, shape (4,).
        moments: Moments in the axes of the body, see `_uninspected_moments`, shape (20,).
        turned: Receives the moments in Hill's frame, shape (20,).
    """
    for at in (0, _ELEMENTS):
        m = moments[at : at + _ELEMENTS]
        turned[at] = m[0]
        mean = rotated(orientation, m[1], m[2], m[3])
        # The columns of R M; its rows, rotated again, are those of R M R^T.
        x = rotated(orientation, m[4], m[7], m[8])
        y = rotated(orientation, m[7], m[5], m[9])
        z = rotated(orientation, m[8], m[9], m[6])
        first = rotated(orientation, x[0], y[0], z[0])
        second = rotated(orientation, x[1], y[1], z[1])
        third = rotated(orientation, x[2], y[2], z[2])
        found = (mean[0], mean[1], mean[2], first[0], second[1], third[2], first[1], first[2], second[2])
        for k in range(9):
            turned[at + 1 + k] = _within_unit(found[k])


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
        return {_SUMS: ArraySpec((2 * _ELEMENTS,))}

    def remember(self, view: View, name: str) -> None:
        """Compute the moments of every row."""
        _call(_uninspected_moments, view, name, self.inspection_entity_name, (_SUMS,))

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the moments [-], Hill frame."""
        moments = SensorMemory(self.part_name, _SUMS)
        if self.inspection_entity_name != rotating_body(world):
            return RowTerm(copy_vector, (moments,))
        return RowTerm(_turn_moments, (EnvironmentArray("chief_orientation"), moments))
