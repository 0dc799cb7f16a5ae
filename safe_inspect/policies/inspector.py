"""Inspectors: `NaturalMotionInspector` flies coasting arcs and a few burns, `SixDofInspector` also points a camera."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field, field_validator

from safe_inspect.dynamics.quaternion import exp, multiply, rotate_back
from safe_inspect.dynamics.step_maps import step_maps
from safe_inspect.errors import SafeInspectError
from safe_inspect.geometry.distance import lengths
from safe_inspect.geometry.visibility import sight_range
from safe_inspect.plugins.functor import functor_field
from safe_inspect.plugins.plugin import EntityName, Plugin, PointsName
from safe_inspect.policies.base import SCRIPTED_POLICY, ScriptedPolicy, ThrustLimits, dot_rows, shortened
from safe_inspect.policies.burn_execution import DeputyRows, PlanRows, follow_plans, rows_to_plan, take_turns
from safe_inspect.policies.burn_problem import BurnProblem, FlightLimits, coast_others
from safe_inspect.policies.burn_search import AnnealingEffort, revise_plan
from safe_inspect.simulators.arrays import for_kernel
from safe_inspect.simulators.resets.initializers import require_length
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.simulators.view import View
from safe_inspect.simulators.world import World
from safe_inspect.tasks.inspection.rotation import rotating_body
from safe_inspect.tasks.inspection.sun import predicted_sun
from safe_inspect.types import FloatArray
from safe_inspect.units import NonNegativeSpeed, PositiveLength, quantity

_KeepOutAngle = quantity("rad", ge=0, lt=math.pi)
_FieldOfView = quantity("rad", gt=0, le=math.pi)


#: Increase of the speed limit with range, in mean motions [-], and cost of time [m/s^2].
_SPEED_SLOPE, _HASTE = 2.0, 2e-7
_WORD = 0xFFFFFFFFFFFFFFFF
_MIX_DEPUTY, _MIX_STEP = 0xD1342543DE82EF95, 0xA24BAED4963EE407  # odd numbers that separate the random streams of a key


class NaturalMotionInspector(ScriptedPolicy):
    """Inspector that observes all points of a body on natural motion, with a few small burns found by a search.

    A deputy without thrust follows an arc that can be computed exactly, and so does the sun; the inspector therefore
    predicts which points an arc will inspect. It plans up to `burns` burns at steps of its choice, each of constant
    thrust over as few whole steps as the limits allow. The plan must inspect all points within `horizon` and minimises

        sum over the burns of |dv_x| + |dv_y| + |dv_z|, plus 2e-7 m/s^2 times the time to the last point,

    within the limits below. The search is simulated annealing from several starts: the current plan, and burns that
    remove most of the drift along the track, which leaves a nearly closed ellipse about the chief. The inspector plans
    at the first step, searches for a better remainder of the plan whenever a burn is due, and plans again when it is
    off its course (a safety filter may have changed the thrust) or when points are left that should have been
    inspected.

    Several deputies plan in turn: only one may start a burn in each step, and those that are about to meet come first.
    A deputy assumes that the others coast, leaves to them the points that they will inspect in this way, and keeps
    clear of their arcs; the others take a new plan into account at their next `review`. Deputies do not communicate
    their plans, and the others may have different policies.

    The speed limit is that of the shipped safety filter and adds very little to the cost. To fly with that filter set
    `glare` slightly above half its `fov` (0.56 rad): the filter then hardly ever acts.

    Attributes:
        inspection_entity_name: The body whose points are inspected.
        horizon: Number of steps of an episode; a plan ends there.
        burns: Largest number of burns of a plan.
        restarts: Number of starts of the search at the first step.
        iterations: Number of plans that are tried from each start.
        stride: Number of steps between two checks of the points during the search; the result is checked at every step.
        review: Number of steps between two reviews of a plan if there are other deputies.
        near: Least range of a plan to the body's centre [m].
        far: Largest range of a plan to the body's centre [m].
        clearance: Least distance of a plan to the other deputies [m].
        speed: Largest speed at the range `near` [m/s], which increases by two mean motions with range; None: no limit.
        glare: Half angle of the excluded cone about the direction away from the sun [rad]; 0: no cone is excluded.
        field_of_view: Full angle of the camera's cone about the line to the body's centre, as in the simulator [rad].
    """

    needs: ClassVar[tuple[str, ...]] = ("mean_motion", "points", "sun_angle")

    inspection_entity_name: PointsName = "chief"
    horizon: int = Field(default=1224, ge=1, le=100_000)
    burns: int = Field(default=3, ge=1, le=20)
    restarts: int = Field(default=3, ge=1)
    iterations: int = Field(default=1000, ge=1)
    stride: int = Field(default=8, ge=1)
    review: int = Field(default=50, ge=1)
    near: PositiveLength = 16.0
    far: PositiveLength = 780.0
    clearance: PositiveLength = 20.0
    speed: NonNegativeSpeed | None = 0.2
    glare: _KeepOutAngle = 0.0  # type: ignore[valid-type]
    field_of_view: _FieldOfView = math.pi  # type: ignore[valid-type]

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the plan (its burns, the step of its review, where it leads and when) and the turn to plan."""
        return {
            "start": ArraySpec((self.burns,), np.int64),
            "delta_v": ArraySpec((self.burns, 3)),
            "review": ArraySpec((), np.int64),
            "expected": ArraySpec((6,)),
            "arrival": ArraySpec((), np.int64),
            "turn": ArraySpec((), np.int64, -1),
        }

    def __call__(self, view: View, limits: ThrustLimits) -> FloatArray:
        """Return the thrust of the plans [N], Hill frame, shape (R, 3)."""
        # Computed here, as it compiles code, which a mere validation of a configuration must not do.
        world = view.world
        maps = step_maps(world.mean_motion, world.step_size, self.horizon)
        mass = view.mass[:, None]
        strength = np.maximum(np.minimum(limits.high, -limits.low), 0.0)  # burns may have either sign
        remembered = {name: view.memory(SCRIPTED_POLICY, name) for name in self.memory(world)}
        plans = PlanRows(reach=strength * (world.step_size / mass), **remembered)
        deputies = DeputyRows(
            *(for_kernel(array) for array in (view.step, view.finished, view.position, view.velocity))
        )
        if (plans.turn < 0).any():
            state, count = view.writable, world.num_deputies
            team = state.position[:, :count], state.velocity[:, :count]
            take_turns(plans.turn, for_kernel(view.own_index), view.group.size, *team, maps, self.clearance)
        due = rows_to_plan(deputies, plans, world.num_deputies)
        for row in np.flatnonzero(due & (deputies.step < self.horizon)):
            self._plan(view, int(row), plans)
        acceleration = np.zeros((view.num_rows, 3))
        follow_plans(deputies, plans, maps, acceleration)
        return acceleration * mass

    def _plan(self, view: View, row: int, plans: PlanRows) -> None:
        """Review the plan of one row and improve it if necessary; its arrays are written in place."""
        world, entity = view.world, self.inspection_entity_name
        now, deputy = int(view.step[row]), int(view.own_index[row])
        start, delta_v = plans.start[row], plans.delta_v[row]
        problem = self.burn_problem(view, row, now, plans.reach[row])
        state = np.concatenate((view.position[row], view.velocity[row]))
        state -= np.concatenate((view.entity_position(entity)[row], view.entity_velocity(entity)[row]))
        delta_v[start < now] = 0.0  # these burns have been executed
        from_now = np.maximum(start - now, 0)
        mixed = int(view.per_environment(view.state.key)[row]) + _MIX_DEPUTY * (deputy + 1) + _MIX_STEP * now
        seed = np.array([mixed & _WORD], np.uint64)
        effort = AnnealingEffort(self.restarts, self.iterations, self.stride)
        left, end = revise_plan(problem, state, from_now, delta_v, seed, effort)
        start[:] = now + from_now
        # A single deputy can predict the whole episode; with others the prediction changes whenever one of them burns.
        alone = world.num_deputies == 1 and left == 0
        plans.review[row] = now + (end + 1 if alone else self.review)

    def burn_problem(self, view: View, row: int, now: int, reach: FloatArray) -> BurnProblem:
        """Return the planning problem of one row.

        Args:
            view: The current state.
            row: The row.
            now: Steps since the reset.
            reach: Velocity change that one step can give along each axis [m/s], shape (3,).
        """
        world, state, entity = view.world, view.state, self.inspection_entity_name
        if rotating_body(world) == entity:
            raise SafeInspectError(
                f"NaturalMotionInspector requires a body at rest, but {entity!r} rotates; use another policy"
            )
        points = view.points(entity)
        model, body = points.model, points.model.body
        env, deputy, deputies = row // view.group.size, int(view.own_index[row]), world.num_deputies
        steps = self.horizon - now
        angle = view.sun_angle[row] + world.sun_rate * world.step_size * np.arange(steps + 1)
        sun, light = predicted_sun(view.state, env, angle, world)
        problem = BurnProblem(
            maps=step_maps(world.mean_motion, world.step_size, self.horizon),
            lit=model.lit(light),
            sun=sun,
            points=model.points,
            radius=model.radius,
            sight=sight_range(model.radius, self.field_of_view),
            needed=~points.inspected[row],
            others=np.empty((deputies - 1, steps + 1, 6)),
            wait=0,
            margin=self.review + deputies if deputies > 1 else 0,
            phase=now % self.stride,
            period=deputies,
            reach=reach,
            limits=FlightLimits(
                near=self.near,
                far=self.far,
                speed=math.inf if self.speed is None else self.speed,
                slope=_SPEED_SLOPE * world.mean_motion,
                cos_glare=2.0 if self.glare == 0.0 else math.cos(self.glare),
            ),
            clearance=self.clearance,
            haste=_HASTE,
        )
        position = np.delete(state.position[env, :deputies], deputy, axis=0) - state.position[env, body]
        velocity = np.delete(state.velocity[env, :deputies], deputy, axis=0) - state.velocity[env, body]
        return problem._replace(wait=coast_others(problem, position, velocity))


#: Largest magnitude of the desired angular velocity as a share of the rate limit [-].
_RATE_SHARE = 0.98


class SixDofInspector(ScriptedPolicy):
    """Inspector for vehicles that turn: it points the camera at a body while another policy commands the thrust.

    Let phi be the rotation vector of the smallest rotation that takes the camera's axis to the line of sight, e the
    error of the angular velocity w with respect to that of the line of sight, and T the step. The next angular velocity
    is

        w' = w + phi / T - 3/2 e,        |w'| <= 0.98 rate limit

    in body axes, and the moment is J (w' - w) / T. If no limit is reached, moments of this size, held over the steps,
    take both errors to zero in two steps (the deadbeat controller of a double integrator); a long turn first proceeds
    at the rate limit. The thrust of the other policy is rotated into body axes with the attitude expected in the middle
    of the step.

    Attributes:
        translation: The policy that commands the thrust, along Hill's axes.
        entity_name: The body at which the camera points.
        initial_sensor_unit_vec: Axis of the camera in body axes; any length.
    """

    commands_attitude: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ("turning_body", "orientation", "angular_velocity")

    translation: functor_field("policy") = NaturalMotionInspector(field_of_view="60 deg", near=20.0)  # type: ignore[valid-type]
    entity_name: EntityName = "chief"
    initial_sensor_unit_vec: tuple[float, float, float] = (1.0, 0.0, 0.0)

    _has_length = field_validator("initial_sensor_unit_vec")(require_length)

    @field_validator("translation")
    @classmethod
    def _gives_thrust(cls, value: Plugin) -> Plugin:
        if isinstance(value, ScriptedPolicy) and value.commands_attitude:
            raise ValueError(f"{value.registered_name} commands the attitude itself; use one that only commands thrust")
        return value

    def needed(self) -> tuple[str, ...]:
        """Return the needs of this policy and of the other policy."""
        return (*self.needs, *self.translation.needed())

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the memory of the other policy."""
        remembered: Mapping[str, ArraySpec] = self.translation.memory(world)
        return remembered

    def __call__(self, view: View, limits: ThrustLimits) -> FloatArray:
        """Return the control along body axes [N, N m], shape (R, 6)."""
        thrust_limits = ThrustLimits(limits.low[:3], limits.high[:3])
        thrust = self.translation(view, thrust_limits)
        vehicle, step = view.world.turning_body, view.world.step_size
        q, w = view.per_agent(view.state["orientation"]), view.per_agent(view.state["angular_velocity"])
        frame = rotate_back(q, np.tile([0.0, 0.0, vehicle.frame_rate], (view.num_rows, 1)))
        way = view.entity_position(self.entity_name) - view.position
        sight = rotate_back(q, _turn_of(way, view.entity_velocity(self.entity_name) - view.velocity)) + frame
        phi = self._rotation(rotate_back(q, way))
        wanted = w + phi / step - 1.5 * (w - sight)
        if vehicle.rate_limit is not None:
            size = lengths(wanted)
            wanted *= np.minimum(1.0, _RATE_SHARE * vehicle.rate_limit / np.maximum(size, 1e-12))[:, None]
        change = (wanted - w) / step
        moment = shortened(change * np.array(vehicle.inertia), ThrustLimits(limits.low[3:], limits.high[3:]))
        middle = multiply(q, exp(0.5 * step * (w - frame + 0.25 * step * moment / np.array(vehicle.inertia))))
        along = rotate_back(middle, thrust) if vehicle.turns_thrust else thrust
        return np.concatenate((shortened(along, thrust_limits), moment), axis=1)

    def _rotation(self, way: FloatArray) -> FloatArray:
        """Return the rotation vectors that take the camera's axis to a direction, body axes [rad], shape (R, 3)."""
        axis = np.array(self.initial_sensor_unit_vec) / np.linalg.norm(self.initial_sensor_unit_vec)
        least = np.eye(3)[np.abs(axis).argmin()]
        across = np.cross(axis, least) / np.linalg.norm(np.cross(axis, least))
        normal = np.cross(np.broadcast_to(axis, way.shape), way)
        size, along = lengths(normal), dot_rows(np.broadcast_to(axis, way.shape), way)
        straight = size < 1e-12  # ahead or exactly behind: use any perpendicular axis
        unit = np.where(straight[:, None], across, normal / np.where(straight, 1.0, size)[:, None])
        return np.asarray(np.arctan2(size, along)[:, None] * unit)


def _turn_of(way: FloatArray, rate: FloatArray) -> FloatArray:
    """Return the angular velocity of a line of sight, Hill frame [rad/s], shape (R, 3)."""
    return np.asarray(np.cross(way, rate) / np.maximum(dot_rows(way, way), 1e-12)[:, None])
