"""`InspectionPoints`: points on bodies that deputies inspect when they see them lit."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator

from safe_inspect.dynamics.base import NO_DISTURBANCE, DisturbanceBounds, MotionLimits
from safe_inspect.geometry.light import full_light
from safe_inspect.geometry.sphere import sphere_points
from safe_inspect.geometry.visibility import Credit, Scores, inspect_body
from safe_inspect.simulators.component import Component, RunningComponent
from safe_inspect.simulators.offers import OfView
from safe_inspect.simulators.resets.initializers import require_length
from safe_inspect.simulators.state import State
from safe_inspect.simulators.world import World
from safe_inspect.tasks.inspection.camera import ConeCamera, inspect_by_camera
from safe_inspect.tasks.inspection.illumination import IlluminationParams
from safe_inspect.tasks.inspection.points_model import PointsModel
from safe_inspect.tasks.inspection.points_view import NewPoints, PointsOf
from safe_inspect.tasks.inspection.rotation import array_in_axes_of
from safe_inspect.types import AnyArray, ArraySpec, BoolArray, FloatArray
from safe_inspect.units import Angle, ConeOfView, PositiveLength

#: The reset parameters that give the priority vector.
_AZIMUTH, _ELEVATION = "priority_vector_azimuth_angle", "priority_vector_elevation_angle"
#: The array of the priority vector.
PRIORITY = "priority_vector"


class SpherePoints(BaseModel):
    """Points on a body that are to be inspected.

    Attributes:
        num_points: Number of points. ``cmu`` rounds it to whole rings, ``fibonacci`` returns exactly this number.
        radius: Radius of the sphere that carries them [m].
        points_algorithm: ``fibonacci`` (a golden-angle lattice) or ``cmu`` (Deserno's rings of equal area).
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    num_points: int = Field(default=100, ge=1, le=100_000)
    radius: PositiveLength = 10.0
    points_algorithm: Literal["fibonacci", "cmu"] = "fibonacci"

    @property
    def positions(self) -> FloatArray:
        """The points relative to the body's centre [m], shape (P, 3)."""
        return sphere_points(self.points_algorithm, self.num_points, self.radius)


class InspectionPoints(Component):
    """Points on bodies, each inspected as soon as a deputy's camera sees it lit.

    A point remains inspected. It is credited to the first deputy that sees it, in the order of agents.

    Arrays: ``state.points[body]``, see `PointsModel.arrays`, and ``priority_vector`` [-], shape (N, 3), zeros if there
    is none. Views offer ``points(body)``, a `PointsView`.
    The component ``Sun`` must come before this one. If a reset provides a priority vector, the points are weighted by
    their angle from the direction opposite to it. Points and priority vector are in the axes of their body, which are
    Hill's unless `ChiefRotation` rotates it.

    Attributes:
        inspection_points_map: Points by the body that carries them.
        illumination_params: The sunlight; None: every point is lit at all times.
        field_of_view: Full angle of the camera's cone about the line to the body's centre [rad].
        sensor_fov: Full angle of the cone of a camera that rotates with the deputy [rad]; with 2 pi, it sees in all
            directions. None: the camera points to the body's centre, see `field_of_view`.
        initial_sensor_unit_vec: Axis of that camera in body axes; any length.
        report_score: Whether infos and tables also contain the summed weight of the inspected points.
    """

    parameters: ClassVar[Mapping[str, str]] = {_AZIMUTH: "rad", _ELEVATION: "rad"}

    inspection_points_map: dict[str, SpherePoints] = Field(default_factory=lambda: {"chief": SpherePoints()})
    illumination_params: IlluminationParams | None = IlluminationParams()
    field_of_view: Angle = math.pi
    sensor_fov: ConeOfView | None = None
    initial_sensor_unit_vec: tuple[float, float, float] = (1.0, 0.0, 0.0)
    report_score: bool = False

    @field_validator("field_of_view")
    @classmethod
    def _full_angle(cls, value: float) -> float:
        return check_field_of_view(value)

    _has_length = field_validator("initial_sensor_unit_vec")(require_length)

    @property
    def bodies(self) -> tuple[str, ...]:
        """The bodies that carry points."""
        return tuple(self.inspection_points_map)

    @property
    def radii(self) -> Mapping[str, float]:
        """Radius of each sphere that carries points [m]."""
        return {name: sphere.radius for name, sphere in self.inspection_points_map.items()}

    def disturbance_bounds(self, limits: MotionLimits) -> DisturbanceBounds:
        """Return zero bounds: points do not affect the motion of deputies."""
        return NO_DISTURBANCE

    def __call__(self, world: World, num_envs: int) -> RunningComponent:
        """Return the running points.

        Raises:
            ValueError: There is no sun before this component.
        """
        if "sun_direction" not in world.offers.view:
            raise ValueError("InspectionPoints must come after Sun; put Sun before it in `components`")
        light = self.illumination_params
        models = {
            name: PointsModel(
                name,
                world.bodies[name],
                points.positions,
                points.radius,
                full_light() if light is None else light.light(points.radius),
            )
            for name, points in self.inspection_points_map.items()
        }
        camera = None
        if self.sensor_fov is not None:
            size = math.hypot(*self.initial_sensor_unit_vec)
            x, y, z = (component / size for component in self.initial_sensor_unit_vec)
            camera = ConeCamera((x, y, z), 0.5 * self.sensor_fov)
        return _RunningPoints(models, world, camera or self.field_of_view, self.report_score)


def check_field_of_view(angle: float) -> float:
    """Return a field of view [rad] after checking it.

    Raises:
        ValueError: It is not a full angle of a cone.
    """
    if not 0.0 < angle <= math.pi:
        raise ValueError(f"`field_of_view` must be a full angle in (0, pi], not {angle} rad")
    return angle


class _RunningPoints(RunningComponent):
    figures = {  # noqa: RUF012 - never written
        "inspected_count": ("inspected points", "points"),
        "inspected_fraction": ("inspected fraction", "-"),
        "own_inspected_count": ("inspected first", "points"),
        "inspected_score": ("score", "-"),
        "own_inspected_score": ("score of those", "-"),
    }

    def __init__(
        self, models: Mapping[str, PointsModel], world: World, view: float | ConeCamera, report_score: bool
    ) -> None:
        self._models, self._world, self._report_score = models, world, report_score
        self._total = sum(model.num_points for model in models.values())
        num_deputies = self._num_deputies = world.num_deputies
        self._camera = view if isinstance(view, ConeCamera) else None
        self._cos_half_fov = -1.0 if isinstance(view, ConeCamera) or view >= math.pi else math.cos(view / 2.0)
        self._active = np.ones((0, num_deputies), dtype=np.bool_)
        self.arrays = {name: spec for model in models.values() for name, spec in model.arrays(num_deputies).items()}
        self.arrays[PRIORITY] = ArraySpec((3,))

    def reset(self, state: State, values: Mapping[str, Any]) -> None:
        self._weigh(state, values)
        self._look(state)

    def step(self, state: State, running: BoolArray) -> None:
        self._look(state)

    def of_world(self) -> Mapping[str, Any]:
        return {"points": self._models, "camera": self._camera}

    def of_view(self) -> Mapping[str, Callable[[Any], Any]]:
        return {"points": PointsOf, PRIORITY: OfView(PRIORITY)}

    def of_step(self) -> Mapping[str, Callable[[Any], Any]]:
        return {"new_points": NewPoints}

    def info(self, view: Any) -> dict[str, AnyArray]:
        found: dict[str, AnyArray] = {}
        bodies = view.state.points if self._models else {}
        for model in self._models.values():
            points = bodies[model.entity]
            found["inspected_count"] = found.get("inspected_count", 0) + view.per_environment(points.team_count)
            found["own_inspected_count"] = found.get("own_inspected_count", 0) + view.per_agent(points.own_count)
            if self._report_score:  # The mean over all bodies.
                share = 1.0 / len(self._models)
                team, own = view.per_environment(points.team_score), view.per_agent(points.own_score)
                found["inspected_score"] = found.get("inspected_score", 0.0) + share * team
                found["own_inspected_score"] = found.get("own_inspected_score", 0.0) + share * own
        return self._with_fraction(found)

    def team_info(self, team: Any) -> dict[str, AnyArray]:
        counts = [team.state.points[model.entity].team_count for model in self._models.values()]
        found = {"inspected_count": sum(counts[1:], counts[0].copy())} if counts else {}
        if self._report_score and counts:
            scores = [team.state.points[model.entity].team_score for model in self._models.values()]
            found["inspected_score"] = sum(scores[1:], scores[0].copy()) / len(scores)
        return self._with_fraction(found)

    def shared_state(self, team: Any) -> tuple[AnyArray, ...]:
        return tuple(team.state.points[model.entity].inspector >= 0 for model in self._models.values())

    def _with_fraction(self, found: dict[str, AnyArray]) -> dict[str, AnyArray]:
        if self._total:
            found["inspected_fraction"] = found["inspected_count"] / self._total
        return found

    def _look(self, state: State) -> None:
        """Mark the points that are in view and lit as inspected."""
        if len(self._active) < state.num_envs:
            self._active = np.ones((state.num_envs, self._num_deputies), dtype=np.bool_)
        for model in self._models.values():
            call, arguments = state.bound.get(("inspect", model.entity)) or self._bind(state, model)
            call(*arguments)

    def _bind(self, state: State, model: PointsModel) -> tuple[Any, tuple[Any, ...]]:
        points = state.points[model.entity]
        credit = Credit(points.inspector, points.team_count, points.own_count)
        scores = Scores(points.weights, points.team_score, points.own_score)
        active = self._active[: state.num_envs]
        position, sun, orientation = (
            state.arrays.get(array_in_axes_of(model.entity, self._world, name))
            for name in ("position", "sun_direction", "orientation")
        )
        seen = sun, model.surface
        call: Any
        fixed: tuple[Any, ...]
        if self._camera is None:
            call, fixed = inspect_body, (position, model.body, *seen, self._cos_half_fov)
        else:
            call, fixed = inspect_by_camera, (position, orientation, model.body, self._camera, *seen)
        found = state.bound["inspect", model.entity] = call.dispatcher, (*fixed, active, credit, scores)
        return found

    def _weigh(self, state: State, values: Mapping[str, Any]) -> None:
        """Weight the points by their angle from the direction opposite to the priority vector, if there is one."""
        if any(name not in values for name in (_AZIMUTH, _ELEVATION)):
            return
        azimuth, elevation = values[_AZIMUTH], values[_ELEVATION]
        # Usually all rows are equal, and one row is enough.
        if (azimuth == azimuth[:1]).all() and (elevation == elevation[:1]).all():
            azimuth, elevation = azimuth[:1], elevation[:1]
        priority = np.stack(
            (np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)), axis=-1
        )
        state[PRIORITY][...] = priority
        for model in self._models.values():
            normals = model.points / model.radius
            cosine = -(priority[:, None, 0] * normals[:, 0] + priority[:, None, 1] * normals[:, 1])
            cosine -= priority[:, None, 2] * normals[:, 2]
            weights = np.arccos(np.clip(cosine, -1.0, 1.0)) / np.pi
            state.points[model.entity].weights[...] = weights / weights.sum(axis=-1, keepdims=True)
