"""`NaturalMotionInspector`: inspects every point on coasting arcs, for as little fuel as a search finds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from safe_inspect.plugins.plugin import PointsName
from safe_inspect.policies.base import PILOT, ScriptedPolicy, ThrustLimits
from safe_inspect.policies.fields import FieldOfView, KeepOutAngle, NonNegativeAcceleration
from safe_inspect.simulators.arrays import for_kernel
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.simulators.view import View
from safe_inspect.simulators.world import World
from safe_inspect.types import FloatArray, IntArray
from safe_inspect.units import AngularRate, NonNegativeSpeed, PositiveLength

if TYPE_CHECKING:
    from safe_inspect.policies.plan import Course

#: Distance from which the light on the points is judged before the flight [m].
_AFAR = 1e6
_WORD = 0xFFFFFFFFFFFFFFFF
_MIX_DEPUTY, _MIX_STEP = 0xD1342543DE82EF95, 0xA24BAED4963EE407  # odd numbers that part the draws of a key


class NaturalMotionInspector(ScriptedPolicy):
    """Inspect all points of a body on natural motion, with a few burns that a search makes as small as it can.

    Without thrust a deputy flies an arc that is known exactly, and so is the sun: the inspector knows which points an
    arc will inspect. It plans up to `burns` burns at steps of its choice, each of constant thrust over as few whole
    steps as the limits allow, and looks for the plan that inspects all points within `horizon` at the least

        sum over the burns of |dv_x| + |dv_y| + |dv_z|, plus `haste` times the time to the last point,

    within the limits below, by simulated annealing from several beginnings: the plan that it has, and burns that take
    away most of the drift along the track, which leaves a nearly closed ellipse about the chief. It plans at the
    first step, looks for a better rest of the plan whenever a burn is due, and plans anew when it finds itself off its
    course (a safety filter may have changed the thrust) or points left that should have been inspected.

    Several deputies plan by turns: in a step only one may begin a burn, and those that are about to meet come first.
    It takes the others to coast, leaves to them the points that they will inspect so, and keeps clear of their arcs;
    they find out at their next `review`. None tells another its plan, and the others may fly by other policies.

    The limit of speed is that of the shipped safety filter, and costs next to nothing. To fly with that filter set
    `glare` a little above half its `fov` (0.56 rad): it then hardly ever acts.

    Attributes:
        inspection_entity_name: The body whose points are inspected.
        horizon: Steps of an episode; a plan ends there.
        burns: Largest number of burns of a plan.
        restarts: Beginnings of the search at the first step.
        iterations: Plans that are tried from each beginning.
        stride: The search looks at the points every so-many-th step; what it finds is checked in every step.
        review: Steps between two reviews of a plan in the company of others.
        near: Least range to the body's centre that a plan keeps to [m].
        far: Largest range that it keeps to [m].
        clearance: Least distance to the other deputies that it keeps to [m].
        speed: Largest speed at the range `near` [m/s]; None: no limit of speed.
        speed_slope: What the limit of speed gains with range, in mean motions [-].
        glare: Angle about the direction away from the sun that is kept out of [rad]; 0: none is.
        field_of_view: Full angle of the camera's cone about the line to the body's centre, as the simulator's [rad].
        sun_rate: Rate of the sun's angle [rad/s]; None: the mean motion.
        haste: Price of time [m/s^2].
    """

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
    speed_slope: float = Field(default=2.0, ge=0.0)
    glare: KeepOutAngle = 0.0
    field_of_view: FieldOfView = math.pi
    sun_rate: AngularRate | None = None
    haste: NonNegativeAcceleration = 2e-7

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
        """Return the thrust that the plans ask for [N], Hill frame, shape (R, 3)."""
        from safe_inspect.policies.arcs import step_maps  # compiled: not when a configuration is only validated
        from safe_inspect.policies.pilot import follow, who_plans
        from safe_inspect.policies.turns import take_turns

        world = view.world
        start, delta_v, review, expected, arrival, turn = (
            view.memory(PILOT, name) for name in ("start", "delta_v", "review", "expected", "arrival", "turn")
        )
        phi, gamma = step_maps(world.mean_motion, world.step_size, self.horizon)
        mass = np.broadcast_to(view.mass, (view.num_rows,))[:, None]
        strength = np.maximum(np.minimum(limits.high, -limits.low), 0.0)  # burns go either way
        reach = strength * (world.step_size / mass)
        step, deputy, finished = for_kernel(view.step), for_kernel(view.own_index), for_kernel(view.finished)
        position, velocity = for_kernel(view.position), for_kernel(view.velocity)
        flown = (start, delta_v, reach)
        if (turn < 0).any():
            state, deputies = view.writable, world.num_deputies
            team = state.position[:, :deputies], state.velocity[:, :deputies]
            take_turns(turn, deputy, view.group.size, *team, phi, gamma, self.clearance)
        due = who_plans(step, turn, world.num_deputies, finished, position, velocity, expected, arrival, *flown, review)
        for row in np.flatnonzero(due & (step < self.horizon)):
            self._plan(view, int(row), reach[row], start[row], delta_v[row], review)
        acceleration = np.zeros((view.num_rows, 3))
        follow(step, position, velocity, *flown, world.step_size, phi, gamma, finished, expected, arrival, acceleration)
        return acceleration * mass

    def _plan(
        self,
        view: View,
        row: int,
        reach: FloatArray,
        start: IntArray,
        delta_v: FloatArray,
        review: IntArray,
    ) -> None:
        """Look at the plan of one row and better it where that is needed; its arrays are written in place."""
        from safe_inspect.policies.search import revise

        world, entity = view.world, self.inspection_entity_name
        now, deputy = int(view.step[row]), int(view.own_index[row])
        course = self._course(view, row, now, reach)
        state = np.concatenate((view.position[row], view.velocity[row]))
        state -= np.concatenate((view.entity_position(entity)[row], view.entity_velocity(entity)[row]))
        delta_v[start < now] = 0.0  # those are flown
        begin = np.maximum(start - now, 0)
        mixed = int(view.per_environment(view.state.key)[row]) + _MIX_DEPUTY * (deputy + 1) + _MIX_STEP * now
        seed = np.array([mixed & _WORD], np.uint64)
        left, end = revise(course, state, begin, delta_v, seed, self.restarts, self.iterations, self.stride)
        start[:] = now + begin
        # Alone the future is known up to the end; in company it changes whenever another deputy burns.
        alone = world.num_deputies == 1 and left == 0
        review[row] = now + (end + 1 if alone else self.review)

    def _course(self, view: View, row: int, now: int, reach: FloatArray) -> Course:
        """Return what one row plans for."""
        from safe_inspect.policies.arcs import coast_of_others, step_maps
        from safe_inspect.policies.plan import Course

        world, state = view.world, view.state
        points = view.points(self.inspection_entity_name)
        model, body = points.model, points.model.body
        env, deputy, deputies = row // view.group.size, int(view.own_index[row]), world.num_deputies
        phi, gamma = step_maps(world.mean_motion, world.step_size, self.horizon)
        steps = self.horizon - now
        rate = world.mean_motion if self.sun_rate is None else self.sun_rate
        angle = view.sun_angle[row] + rate * world.step_size * np.arange(steps + 1)
        sun = np.stack((np.cos(angle), -np.sin(angle), np.zeros_like(angle)), axis=1)
        # A highlight may wash a point out; it lies elsewhere for a viewer above and one below the orbit's plane.
        above = np.tile((0.0, 0.0, _AFAR), (steps + 1, 1))
        lit = model.lit(above, sun) & model.lit(-above, sun)
        half = self.field_of_view / 2.0
        sight = model.radius if half >= math.pi / 2.0 else model.radius / math.sin(half)
        needed = ~points.inspected[row]
        track = np.empty((deputies - 1, steps + 1, 6))
        wait = coast_of_others(
            phi,
            gamma,
            np.delete(state.position[env, :deputies], deputy, axis=0) - state.position[env, body],
            np.delete(state.velocity[env, :deputies], deputy, axis=0) - state.velocity[env, body],
            model.points,
            model.radius,
            sight,
            self.far,
            lit,
            needed,
            track,
        )
        return Course(
            phi=phi,
            gamma=gamma,
            step_size=world.step_size,
            lit=lit,
            sun=sun,
            points=model.points,
            radius=model.radius,
            sight=sight,
            needed=needed,
            others=track,
            wait=wait,
            margin=self.review + deputies if deputies > 1 else 0,
            phase=now % self.stride,
            period=deputies,
            reach=reach,
            near=self.near,
            far=self.far,
            clearance=self.clearance,
            speed=math.inf if self.speed is None else self.speed,
            slope=self.speed_slope * world.mean_motion,
            cos_glare=2.0 if self.glare == 0.0 else math.cos(self.glare),
            haste=self.haste,
        )
