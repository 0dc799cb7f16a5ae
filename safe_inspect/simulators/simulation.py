"""The running simulation of N environments: reset by rows, step all."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from safe_inspect.dynamics.cwh import transition
from safe_inspect.geometry.light import Light, full_light
from safe_inspect.geometry.looking import inspect_body
from safe_inspect.geometry.sphere import sphere_points
from safe_inspect.randomness import Streams
from safe_inspect.simulators.advance import advance, point_sun
from safe_inspect.simulators.ahead import DEEP, Ahead
from safe_inspect.simulators.delta_v_scale import DeltaVScale
from safe_inspect.simulators.inspection_simulator import InspectionPoints, InspectionSimulator
from safe_inspect.simulators.reset import ResetPlan
from safe_inspect.simulators.state import ArraySpec, State, base_specs
from safe_inspect.simulators.team import TEAM, TEAM_GUARD
from safe_inspect.simulators.view import GUARD, PILOT, Group, View
from safe_inspect.simulators.world import PointsModel, World
from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from safe_inspect.rta.team import TeamSafety


class Simulation:
    """N environments with D deputies. SI units, Hill's frame.

    Attributes:
        world: What does not change.
        before: State at the beginning of the last step.
        state: The current state.
        views: The current state as each group of agents sees it.
        sun_rate: Rate of the sun's angle [rad/s].
        reset_facts: Statistics of the draws that began the current episodes, each of shape (N,).
        running: Environments whose episode runs, shape (N,); see `end`.
    """

    def __init__(
        self,
        config: InspectionSimulator,
        *,
        platforms: tuple[str, ...],
        masses: FloatArray,
        groups: Sequence[Group],
        reset: ResetPlan,
        step_size: float,
        num_envs: int,
        seed: int,
        first_slot: int,
        team_guard: TeamSafety | None = None,
    ) -> None:
        self._config = config
        self._reset_plan = reset
        self._groups = tuple(groups)
        self._team_guard = team_guard
        self._seed = seed
        self._slots = first_slot + np.arange(num_envs, dtype=np.int64)
        self._episodes = np.full(num_envs, -1, dtype=np.int64)
        bodies = {name: index for index, name in enumerate((*platforms, *reset.entities))}
        illumination = config.illumination_params
        self._lights = {
            name: full_light() if illumination is None else illumination.light(points.radius)
            for name, points in config.inspection_points_map.items()
        }
        self._points = {
            name: _points_model(name, bodies[name], points, self._lights[name])
            for name, points in config.inspection_points_map.items()
        }
        self.world = World(
            platforms, bodies, np.asarray(masses, dtype=np.float64), step_size, config.mean_motion, self._points
        )
        self.sun_rate = illumination.mean_motion if illumination else config.mean_motion
        self._cos_half_fov = -1.0 if config.field_of_view >= math.pi else math.cos(config.field_of_view / 2.0)
        # Thrust over mass drives every body alike, so one map for unit mass serves them all.
        self._phi, self._gamma = transition(config.mean_motion, 1.0, step_size)
        self._remembering = [
            [(name, sensor) for name, sensor in group.sensors.items() if sensor.memory(self.world)]
            for group in self._groups
        ]
        self._specs = self._declare()
        self.state = State(num_envs, self._specs)
        self.before = State(num_envs, self._specs, self.state)
        self._active = np.ones((max(num_envs, DEEP), len(platforms)), dtype=np.bool_)
        self._scale = DeltaVScale(config.schedule, num_envs)
        self._ahead = Ahead(num_envs, self._specs, self._begin)
        self.reset_facts: dict[str, IntArray] = {}
        self.running = np.zeros(num_envs, dtype=np.bool_)
        self.views = self._views(self.state)

    @property
    def num_envs(self) -> int:
        """Number of environments, N."""
        return len(self._slots)

    @property
    def episodes(self) -> IntArray:
        """Index of the current episode of each slot, shape (N,)."""
        return self._episodes

    def seed(self, seed: int) -> None:
        """Begin again with another seed: the next reset starts every slot's first episode."""
        self._seed = seed
        self._episodes[:] = -1
        self._ahead.forget()
        self._scale = DeltaVScale(self._config.schedule, self.num_envs)

    def carried(self) -> dict[str, AnyArray]:
        """Return what lives through resets, for a checkpoint: the adaptive scale of the delta-v reward."""
        return self._scale.carried()

    def restore(self, carried: Mapping[str, AnyArray]) -> None:
        """Go on from what `carried` returned; call it before a reset."""
        self._scale.restore(carried)

    def reset(self, rows: IntArray) -> State:
        """Begin a new episode in some rows.

        Args:
            rows: Indices of the environments, shape (R,).

        Returns:
            The fresh state of these rows alone, R environments.
        """
        if len(rows) == self.num_envs and (self.num_envs > DEEP or self._episodes.min() < 0):
            self._episodes[rows] += 1
            fresh, facts = self._begin(rows, self._episodes[rows])
            self._ahead.forget()
        else:
            fresh, facts = self._ahead.take(rows, self._episodes)
        fresh.delta_v_scale[:] = self._scale.scale[rows]
        self.state.put(rows, fresh)
        for name, array in facts.items():
            self.reset_facts.setdefault(name, np.zeros(self.num_envs, dtype=np.int64))[rows] = array
        self.running[rows] = True
        self.views = self._views(self.state)  # what the old ones have computed is out of date
        return fresh

    def _begin(self, rows: IntArray, episodes: IntArray) -> tuple[State, dict[str, AnyArray]]:
        """Return the beginning of an episode of each of some rows, and the statistics of its draw."""
        streams = Streams(self._seed, self._slots[rows], episodes)
        fresh = State(len(rows), self._specs)
        states, sun_angle, values = self._reset_plan.draw(streams)
        for name, index in self.world.bodies.items():
            fresh.position[:, index] = states[name]["position"]
            fresh.velocity[:, index] = states[name]["velocity"]
        fresh.sun_angle[:] = sun_angle
        point_sun(fresh.sun_angle, fresh.sun_direction)
        fresh.key[:] = streams.bits("step")[:, 0]
        fresh.delta_v_scale[:] = self._config.schedule.start
        self._weigh(fresh, values)
        self._look(fresh)
        facts = {
            name: array
            for value in values.values()
            for name, array in (value.items() if isinstance(value, dict) else ())
            if "/" in name  # statistics of the draw, not a state
        }
        return fresh, facts

    def step(self, control: FloatArray) -> None:
        """Hold a thrust over one step.

        Args:
            control: Thrust of each deputy [N], Hill frame, shape (N, D, 3).
        """
        self.before, self.state = self.state, self.before
        after, world = self.state, self.world
        after.copy_from(self.before)
        advance(
            control,
            world.masses,
            self._phi,
            self._gamma,
            world.step_size,
            self.sun_rate,
            after.position,
            after.velocity,
            after.delta_v,
            after.time,
            after.step,
            after.sun_angle,
            after.sun_direction,
        )
        after.control[...] = control
        self._scale.advance(self.running)
        after.delta_v_scale[:] = self._scale.scale
        self.views = self._look(after)

    def end(self, ended: BoolArray) -> None:
        """End the episodes of a mask of environments, shape (N,); what they inspected moves the delta-v scale.

        An environment that has ended may be stepped on until it is reset: that counts for nothing.
        """
        rows = np.flatnonzero(ended & self.running)
        self.running[rows] = False
        if len(rows) and self._points:
            name, model = next(iter(self._points.items()))
            self._scale.end_episodes(rows, self.state.points[name].team_count[rows] / model.num_points)

    def _views(self, state: State) -> tuple[View, ...]:
        return tuple(View(state, self.world, group) for group in self._groups)

    def _look(self, state: State) -> tuple[View, ...]:
        """Inspect what is in view and lit, then let the sensors remember; return the views of what they see."""
        for name, model in self._points.items():
            points = state.points[name]
            inspect_body(
                state.position,
                model.body,
                state.sun_direction,
                model.points,
                model.radius,
                self._cos_half_fov,
                model.light,
                self._active[: state.num_envs],
                points.inspector,
                points.team_count,
                points.own_count,
            )
        views = self._views(state)
        for view, remembering in zip(views, self._remembering, strict=True):
            for name, sensor in remembering:
                view.remembering = name
                sensor.remember(view, name)
            view.remembering = None
        return views

    def _weigh(self, state: State, values: object) -> None:
        """Weigh the points by their angle from the direction opposite to the priority vector, if there is one."""
        names = ("priority_vector_azimuth_angle", "priority_vector_elevation_angle")
        if not isinstance(values, dict) or any(name not in values for name in names):
            return
        azimuth, elevation = (values[name] for name in names)
        if (azimuth == azimuth[:1]).all() and (elevation == elevation[:1]).all():  # as a rule: one row stands for all
            azimuth, elevation = azimuth[:1], elevation[:1]
        priority = np.stack(
            (np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)), axis=-1
        )
        for name, model in self._points.items():
            normals = model.points / model.radius
            cosine = -(priority[:, None, 0] * normals[:, 0] + priority[:, None, 1] * normals[:, 1])
            cosine -= priority[:, None, 2] * normals[:, 2]
            weights = np.arccos(np.clip(cosine, -1.0, 1.0)) / np.pi
            state.points[name].weights[...] = weights / weights.sum(axis=-1, keepdims=True)

    def _declare(self) -> dict[str, ArraySpec]:
        world = self.world
        points = [(name, model.num_points) for name, model in world.points.items()]
        specs = base_specs(len(world.bodies), world.num_deputies, points)
        for group in self._groups:
            declared = {name: sensor.memory(world) for name, sensor in group.sensors.items()}
            if group.guard is not None:
                declared[GUARD] = group.guard.memory(world)
            if group.pilot is not None:
                declared[PILOT] = group.pilot.memory(world)
            for name, arrays in declared.items():
                for array, spec in arrays.items():
                    specs[f"memory/{group.name}/{name}/{array}"] = ArraySpec(
                        (group.size, *spec.shape), spec.dtype, spec.fill
                    )
        for array, spec in (self._team_guard.memory(world) if self._team_guard is not None else {}).items():
            specs[f"memory/{TEAM}/{TEAM_GUARD}/{array}"] = ArraySpec((1, *spec.shape), spec.dtype, spec.fill)
        return specs


def _points_model(name: str, body: int, points: InspectionPoints, light: Light) -> PointsModel:
    positions = sphere_points(points.points_algorithm, points.num_points, points.radius)
    return PointsModel(name, body, positions, points.radius, light)
