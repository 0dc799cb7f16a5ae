"""Safety glue for docking with a tumbling target: it keeps an escape at every moment."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from pydantic import model_validator

from safe_inspect.dynamics.quaternion import rotate_back
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.geometry.distance import lengths
from safe_inspect.geometry.oriented_boxes import OrientedBoxes
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.rta.constraints.parameters import FromWorld
from safe_inspect.rta.filters import differs
from safe_inspect.rta.tumbling_rows import BACKUP, DESIRED, ESCAPE, UNSAFE, EscapeModel, keep_escapes
from safe_inspect.simulators.arrays import for_kernel
from safe_inspect.simulators.state import ArraySpec, State
from safe_inspect.simulators.view import SAFETY_FILTER, FilterResult, View
from safe_inspect.simulators.world import World
from safe_inspect.tasks.docking.shape import ASTROBEE_RADIUS
from safe_inspect.types import BoolArray, FloatArray
from safe_inspect.units import PositiveDuration, PositiveForce, PositiveLength, PositiveMass

#: Distance to the target and to the sphere that it sweeps which is kept beyond the chaser's radius [m].
_MARGIN = 1e-3
#: Largest time between the moments at which distances are computed [s].
_CELL = 0.1
#: Directions of escapes in T: outwards in place of the first, then the axes and the diagonals, in both ways.
_DIRECTIONS = np.array(
    [np.zeros(3), *(sign * axis for axis in np.eye(3) for sign in (1.0, -1.0))]
    + [math.sqrt(1.0 / 3.0) * np.array([x, y, z]) for z in (-1.0, 1.0) for y in (-1.0, 1.0) for x in (-1.0, 1.0)]
)
#: Speed of an escape as a share of the speed from which the chaser can brake between the swept sphere and `r_max`.
_PACE = 0.7


class RTAGlueTumblingTarget(FromWorld, SafetyGlue):
    """Run-time assurance for a chaser that docks with a `TumblingTarget`: no contact, and a range of at most `r_max`.

    A desired thrust is applied if the chaser stays clear of the target while it is held, and if the state after it has
    an escape: a rule for the thrust of all later steps that leads, clear of the target, to rest outside the sphere that
    the target sweeps. The escapes brake, push with full thrust, or follow a speed: outwards, along the principal axes
    of the target, or along their diagonals. The filter flies each with the predicted rotation of the target until one
    is clear; it is stored. If the desired thrust is refused, mixtures with the thrust of the stored escape are tried,
    and then that thrust itself is applied. Therefore, from an initial state outside the swept sphere that braking does
    not lead into it, a contact never occurs (an induction over the steps; Gurriet et al., "A Scalable Safety Critical
    Control Framework for Nonlinear Systems", IEEE Access 2020, for backup trajectories in general).

    Distances are bounded at every moment, not sampled, see `tumbling_rows`. The guarantee is for the exact model: a
    `DoubleIntegrator` whose thrust is held for `step_size`, and a target that turns without torque, whose shape,
    attitude and angular velocity are known. Disturbances are refused.

    Attributes:
        radius: Radius of the chaser [m].
        r_max: Largest range [m].
        swept_radius: Radius of the sphere about the origin that the target never leaves [m]; that of the simulator's
            target.
        step_size: Time for which a thrust is held [s]; by default, the period of the frame rate.
        m: Mass of the chaser [kg]; by default, that of the platform.
        u_max: Largest thrust along each axis [N]; by default, the limit of the controllers.
    """

    dynamics: ClassVar[tuple[str, ...]] = ("DoubleIntegrator",)
    components: ClassVar[tuple[str, ...]] = ("TumblingTarget",)
    tests: ClassVar[tuple[str, ...]] = ("position", "velocity")

    radius: PositiveLength = ASTROBEE_RADIUS
    r_max: PositiveLength = 3.0
    swept_radius: PositiveLength = 1.0
    step_size: PositiveDuration = 1.0
    m: PositiveMass = 9.583788668
    u_max: PositiveForce = 0.3

    @model_validator(mode="after")
    def _leaves_room(self) -> RTAGlueTumblingTarget:
        if self.enabled and self.r_max <= self._outside:
            raise ValueError(
                f"`r_max` is {self.r_max:g} m, but the target and the radius of the chaser reach {self._outside:g} m, "
                "so there is no room to escape to; raise it"
            )
        return self

    @property
    def _outside(self) -> float:
        return float(self.swept_radius + self.radius + _MARGIN)

    @property
    def units(self) -> dict[str, str]:
        """Unit of the safety quantities."""
        return {"clearance": "m", "r_max": "m"}

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the stored escape."""
        return {"escape": ArraySpec((ESCAPE,))}

    def refusals(self, states: Mapping[str, FloatArray]) -> dict[str, BoolArray]:
        """Return the masks of the states that are within the swept sphere or from which braking leads into it, (R,).

        ``clearance`` is about the swept sphere, and ``r_max`` about the largest range.
        """
        position, velocity = states["position"], states["velocity"]
        speed = lengths(velocity)
        stop = speed * (0.5 * speed * self.m / self.u_max + self.step_size)
        way = velocity / np.maximum(speed, 1e-300)[:, None]
        nearest = np.clip(-(position * way).sum(axis=1), 0.0, stop)
        least = lengths(position + nearest[:, None] * way)
        return {
            "clearance": ~(least > self._outside + _MARGIN),
            "r_max": ~(lengths(position) + stop < self.r_max - 2.0 * _MARGIN),
        }

    def safety(self, states: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return the clearance beyond the chaser's radius and the room to the largest range [m], shape (R,).

        Without the state ``clearance``, the distance is that to the swept sphere.
        """
        reach = lengths(states["position"])
        return {
            "clearance": states.get("clearance", reach - self.swept_radius) - self.radius,
            "r_max": self.r_max - reach,
        }

    def states(self, state: State) -> dict[str, FloatArray]:
        """Return position, velocity and clearance of the first deputy."""
        return {**super().states(state), "clearance": state["clearance"][:, 0]}

    def states_within(self, before: State, world: World, control: FloatArray, time: float) -> dict[str, FloatArray]:
        """Return position, velocity and clearance of the first deputy, a time after the start of a hold."""
        acceleration, velocity, body = control / world.masses[0], before.velocity[:, 0], world.target_body
        position = before.position[:, 0] + time * (velocity + 0.5 * time * acceleration)
        turned = tumble(body.inertia, before.target_orientation, before.target_angular_velocity, np.array([time]))[0]
        clearance = OrientedBoxes(*body.boxes).distance(rotate_back(turned[:, 0], position))
        return {"position": position, "velocity": velocity + time * acceleration, "clearance": clearance}

    def filter(self, desired: FloatArray, view: View) -> FilterResult:
        """Return the thrust to hold during the next step, and the escapes after it."""
        model, state, position = self._model(view.world), view.state, view.position
        control = desired / self.m
        escapes = np.array(view.memory(SAFETY_FILTER, "escape"))
        stages = np.empty(len(control), dtype=np.int64)
        attitudes = np.empty((1 + (1 + model.horizon) * model.cells, 7))
        turning = (view.per_environment(state[name]) for name in ("target_orientation", "target_angular_velocity"))
        motion: Any = tuple(for_kernel(array) for array in (position, view.velocity, *turning))
        keep_escapes(model, motion, control, escapes, attitudes, stages)
        control *= self.m
        refused = stages != DESIRED
        return FilterResult(
            control=control,
            intervening=differs(control, desired),
            infeasible=stages == UNSAFE,
            backup=stages == BACKUP,
            active=refused.astype(np.int64),
            phi=np.stack([view.clearance - self.radius, self.r_max - lengths(position)], axis=1),
            names=("clearance", "r_max"),
            memory={"escape": escapes},
        )

    def _model(self, world: World) -> EscapeModel:
        body, acceleration = world.target_body, self.u_max / self.m
        pace = _PACE * math.sqrt(2.0 * acceleration * (self.r_max - self._outside))
        return EscapeModel(
            inertia=body.inertia,
            boxes=body.boxes,
            least=self.radius + _MARGIN,
            swept=self.swept_radius,
            outside=self._outside,
            farthest=self.r_max - _MARGIN,
            acceleration=acceleration,
            step=self.step_size,
            cells=math.ceil(self.step_size / _CELL - 1e-9),
            horizon=math.ceil(2.0 * (self._outside / pace + pace / acceleration) / self.step_size),
            pace=pace,
            directions=_DIRECTIONS,
        )
