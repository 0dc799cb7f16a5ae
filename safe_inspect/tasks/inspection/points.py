"""`InspectionPoints`: points on bodies that deputies inspect when their cameras see them lit."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator

from safe_inspect.compiling import njit
from safe_inspect.dynamics.rotation_row import Components, rotated
from safe_inspect.geometry.sphere import sphere_points
from safe_inspect.geometry.visibility import (
    Credit,
    Scores,
    Surface,
    count_inspected,
    inspect_body,
    light_row,
    point_axes,
    sum_scores,
    terminator_height,
)
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators import OfView, PassiveComponent, RunningComponent, State, World
from safe_inspect.simulators.resets.initializers import polar, require_length
from safe_inspect.tasks.inspection.points_view import NewPoints, PointsModel, PointsOf
from safe_inspect.tasks.inspection.rotation import array_in_axes_of
from safe_inspect.tasks.inspection.sun import IlluminationParams
from safe_inspect.types import AnyArray, ArraySpec, BoolArray, FloatArray
from safe_inspect.units import ConeOfView, ConeToBody, PositiveLength


class ConeCamera(NamedTuple):
    """Camera with a cone of view, whose apex is the deputy's centre.

    Attributes:
        axis: Unit vector of the cone's axis in body axes.
        half_angle: Half the full angle of the cone [rad]; with pi or more, the camera sees in all directions.
    """

    axis: Components
    half_angle: float


@njit
def in_cone(look: Components, cos_half: float, dx: float, dy: float, dz: float) -> bool:
    """Return whether a direction of any length is within a cone.

    Args:
        look: Unit vector of the cone's axis.
        cos_half: Cosine of half its full angle.
        dx: First component of the direction.
        dy: Second component.
        dz: Third component.
    """
    return look[0] * dx + look[1] * dy + look[2] * dz >= cos_half * math.sqrt(dx * dx + dy * dy + dz * dz)


@njit
def inspect_by_camera(
    position: FloatArray,
    orientation: FloatArray,
    body: int,
    camera: ConeCamera,
    sun: FloatArray,
    surface: Surface,
    active: BoolArray,
    credit: Credit,
    scores: Scores,
) -> None:
    """Credit each lit point that a camera sees to the first deputy that sees it, and sum the weights.

    A point q is visible from p if it is above the horizon, ``q . p >= R^2``, and the angle at the deputy between q and
    the camera's axis is at most half that of the cone.

    Args:
        position: Positions of the bodies, the deputies first [m], shape (N, B, 3).
        orientation: Attitudes of the bodies, shape (N, B, 4).
        body: Index of the body that carries the points.
        camera: The camera of every deputy.
        sun: Unit vectors to the sun [-], shape (N, 3).
        surface: The points of the body, relative to its centre.
        active: Whether a deputy's sensor works, shape (N, D).
        credit: Which deputy inspected each point; read and written.
        scores: Weights of the inspected points; read and written.
    """
    radius, count = surface.radius, surface.points.shape[0]
    axes, bright = point_axes(surface.points), np.empty(count, dtype=np.bool_)
    qx, qy, qz = axes[0], axes[1], axes[2]
    viewer = np.empty(3)
    horizon, cos_half = radius * radius, math.cos(min(camera.half_angle, math.pi))
    inspector = credit.inspector
    for n in range(credit.own_count.shape[0]):
        changed = False
        light_row(sun[n], axes, surface.terminator, bright)
        for d in range(credit.own_count.shape[1]):
            for k in range(3):
                viewer[k] = position[n, d, k] - position[n, body, k]
            vx, vy, vz = viewer[0], viewer[1], viewer[2]
            square = vx * vx + vy * vy + vz * vz
            if not active[n, d] or square < horizon:
                continue
            look = rotated(orientation[n, d], camera.axis[0], camera.axis[1], camera.axis[2])
            distance = math.sqrt(square)
            cosine = -(look[0] * vx + look[1] * vy + look[2] * vz) / distance
            away, outline = math.acos(min(max(cosine, -1.0), 1.0)), math.asin(radius / distance)
            if away - outline > camera.half_angle:  # The body is entirely outside the cone.
                continue
            whole = away + outline <= camera.half_angle  # The body is entirely inside the cone.
            for p in range(count):
                if inspector[n, p] >= 0 or not bright[p] or not qx[p] * vx + qy[p] * vy + qz[p] * vz >= horizon:
                    continue
                if whole or in_cone(look, cos_half, qx[p] - vx, qy[p] - vy, qz[p] - vz):
                    inspector[n, p] = d
                    changed = True
        if changed:
            count_inspected(n, credit)
            sum_scores(n, credit, scores)


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


class CameraAndPoints(Plugin):
    """Fields of the plugins that set the points of bodies, their light and the cameras of the deputies.

    Attributes:
        inspection_points_map: Points by the body that carries them.
        illumination_params: The sunlight; None: every point is lit at all times.
        field_of_view: Full angle of the camera's cone about the line to the body's centre [rad].
        sensor_fov: Full angle of the cone of a camera that rotates with the deputy [rad]; with 2 pi, it sees in all
            directions. None: the camera points to the body's centre, see `field_of_view`. A simulator requires
            platforms that rotate, and its default for these is 2 pi.
        initial_sensor_unit_vec: Axis of that camera in body axes; any length.
    """

    inspection_points_map: dict[str, SpherePoints] = Field(default_factory=lambda: {"chief": SpherePoints()})
    illumination_params: IlluminationParams | None = IlluminationParams()
    field_of_view: ConeToBody = math.pi
    sensor_fov: ConeOfView | None = None
    initial_sensor_unit_vec: tuple[float, float, float] = (1.0, 0.0, 0.0)

    _has_length = field_validator("initial_sensor_unit_vec")(require_length)


class InspectionPoints(CameraAndPoints, PassiveComponent):
    """Points on bodies, each inspected as soon as a deputy's camera sees it lit.

    A point remains inspected. It is credited to the first deputy that sees it, in the order of agents.

    Arrays: ``state.points[body]``, see `PointsModel.arrays`, and ``priority_vector`` [-], shape (N, 3), zeros if there
    is none. Views offer ``points(body)``, a `PointsView`.
    The component ``Sun`` must come before this one. If a reset provides a priority vector, the points are weighted by
    their angle from the direction opposite to it. Points and priority vector are in the axes of their body, which are
    Hill's unless `ChiefRotation` rotates it.

    Attributes:
        report_score: Whether infos and tables also contain the summed weight of the inspected points.
    """

    parameters: ClassVar[Mapping[str, str]] = {_AZIMUTH: "rad", _ELEVATION: "rad"}

    report_score: bool = False

    @property
    def bodies(self) -> tuple[str, ...]:
        """The bodies that carry points."""
        return tuple(self.inspection_points_map)

    @property
    def radii(self) -> Mapping[str, float]:
        """Radius of each sphere that carries points [m]."""
        return {name: sphere.radius for name, sphere in self.inspection_points_map.items()}

    def __call__(self, world: World, num_envs: int) -> RunningComponent:
        """Return the running points.

        Raises:
            ValueError: There is no sun before this component.
        """
        if "sun_direction" not in world.offers.view:
            raise ValueError("InspectionPoints must come after Sun; put Sun before it in `components`")
        light = self.illumination_params
        models = {}
        for name, sphere in self.inspection_points_map.items():
            terminator = -math.inf if light is None else terminator_height(sphere.radius, light.ray_offset)
            models[name] = PointsModel(name, world.bodies[name], sphere.positions, sphere.radius, terminator)
        camera = None
        if self.sensor_fov is not None:
            size = math.hypot(*self.initial_sensor_unit_vec)
            x, y, z = (component / size for component in self.initial_sensor_unit_vec)
            camera = ConeCamera((x, y, z), 0.5 * self.sensor_fov)
        return _RunningPoints(models, world, camera or self.field_of_view, self.report_score)


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
        return self._totals(view.state, {"team": view.per_environment, "own": view.per_agent})

    def team_info(self, team: Any) -> dict[str, AnyArray]:
        return self._totals(team.state, {"team": np.asarray})

    def shared_state(self, team: Any) -> tuple[AnyArray, ...]:
        return tuple(team.state.points[model.entity].inspector >= 0 for model in self._models.values())

    def _totals(self, state: Any, rows_of: Mapping[str, Callable[[AnyArray], AnyArray]]) -> dict[str, AnyArray]:
        """Return the numbers of inspected points of all bodies, their fraction, and the mean score over the bodies.

        Args:
            state: The state.
            rows_of: For ``team``, and ``own`` if the values of single deputies are asked for, the function that gives
                the rows of an array.
        """
        found: dict[str, Any] = {}
        bodies = [state.points[name] for name in self._models]
        for whose, rows in rows_of.items() if bodies else ():
            prefix = "" if whose == "team" else "own_"
            found[f"{prefix}inspected_count"] = sum(rows(getattr(points, f"{whose}_count")) for points in bodies)
            if self._report_score:
                scores = [rows(getattr(points, f"{whose}_score")) for points in bodies]
                found[f"{prefix}inspected_score"] = sum(scores) / len(scores)
        if bodies:
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
        priority = polar(np.ones_like(azimuth), azimuth, elevation)
        state[PRIORITY][...] = priority
        for model in self._models.values():
            normals = model.points / model.radius
            cosine = -(priority[:, None, 0] * normals[:, 0] + priority[:, None, 1] * normals[:, 1])
            cosine -= priority[:, None, 2] * normals[:, 2]
            weights = np.arccos(np.clip(cosine, -1.0, 1.0)) / np.pi
            state.points[model.entity].weights[...] = weights / weights.sum(axis=-1, keepdims=True)
