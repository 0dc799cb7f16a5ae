"""Safety glue of docking, and its filter, which enforces a speed limit that decreases towards the chief."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property

import numpy as np
from pydantic import model_validator

from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.dynamics.cwh import transition
from safe_inspect.geometry.distance import lengths
from safe_inspect.rta.base import SafetyGlue, seen_motion
from safe_inspect.rta.constraints.parameters import TaskParameters
from safe_inspect.rta.filters import differs
from safe_inspect.simulators.view import FilterResult, View
from safe_inspect.types import BoolArray, FloatArray
from safe_inspect.units import PositiveDuration, PositiveLength, PositiveSpeed

_HALVINGS = 40


class SpeedLimitFilter:
    """Filter that keeps the speed below L(r) = min(v0 + v1 max(r - d0, 0), vel_limit) at every moment, v1 = v1_coef n.

    A hold is accepted if at its end the speed is at most L(r) - e(r), where

        e(r) = 0.51 v1 dt L(r) + dt^2 / 8 (2 n a + 3 n^2 vel_limit)
        a = sqrt(3) u_max / m + 2 n vel_limit + 3 n^2 r_max

    covers what can happen between the steps: the speed exceeds the chord between its ends by no more than the second
    term, because |v''| <= 2 n a + 3 n^2 |v|, and the limit, whose slope over time is at most v1 |v|, stays below its
    values at the ends by no more than the first.

    The backup plan is to brake: each axis applies the thrust that would bring its speed to zero, as far as it can.
    Braking slows the deputy by at least u_max / m, because the sum of the components of a unit vector is at least 1.
    Coriolis accelerations do no work, the gravity gradient adds at most 3 n^2 r, and the limit decreases by at most
    v1 |v|. Therefore, with

        u_max / m >= 1.05 (3 n^2 r_max + v1 vel_limit)

    a hold of braking leads from every state within the limit to such a state: by induction, each of them has a plan
    at all times, up to the range r_max. If the desired thrust is rejected, the filter searches for a thrust between
    braking and the desired one, along the nearest points of the box of thrusts and of the balls of velocities.

    Under a disturbance, the filter receives estimates. A disturbance between the steps, by w in velocity, adds 2 w to
    e(r). A thrust is accepted if the state it predicts from the estimate is within the limit by e(r) and by the largest
    possible error of the predicted velocity, plus v1 times that of the position; braking must compensate for that too.

    Args:
        parameters: `step_size`, `n`, `m`, `u_max`, `v0`, `v0_distance`, `v1_coef`, `vel_limit` and `r_max`.
        bounds: Bounds of the disturbances; None: there are none, the motion is that of the model.

    Raises:
        ValueError: The thrusters are too weak for the guarantee, steps are too long for the limit, or the bounds leave
            nothing of either.
    """

    def __init__(self, parameters: TaskParameters, bounds: DisturbanceBounds | None = None) -> None:
        p, b = parameters, bounds or DisturbanceBounds()
        self._v0, self._d0, self._slope, self._top = p.v0, p.v0_distance or 0.0, p.v1_coef * p.n, p.vel_limit
        self._u_max = p.u_max
        self._phi, self._gamma = transition(p.n, p.m, p.step_size)
        self._gain = np.diag(self._gamma[3:]).copy()
        largest = math.sqrt(3.0) * p.u_max
        acceleration = largest * (1.0 + b.thrust_error) / p.m + 2.0 * p.n * p.vel_limit + 3.0 * p.n**2 * p.r_max
        bend = 2.0 * p.n * acceleration + 3.0 * p.n**2 * p.vel_limit
        added = 1.01 * b.velocity  # Coasting does not increase a velocity by more than 1 % within a step.
        self._share, self._rest = 0.51 * self._slope * p.step_size, 0.125 * p.step_size**2 * bend + 2.0 * added
        error = largest * b.thrust_error
        parts = np.linalg.norm([self._phi[3:, :3], self._phi[3:, 3:], self._phi[:3, :3], self._phi[:3, 3:]], 2, (1, 2))
        pushes = np.linalg.norm([self._gamma[3:], self._gamma[:3]], 2, (1, 2)) * error
        velocity = float(parts[0] * b.position_error + parts[1] * b.velocity_error + pushes[0]) + added
        place = float(parts[2] * b.position_error + parts[3] * b.velocity_error + pushes[1]) + added * p.step_size
        self._missed = velocity + self._slope * place
        needed = 1.05 * (3.0 * p.n**2 * p.r_max + self._slope * p.vel_limit)
        lost = (b.velocity_error + self._slope * b.position_error + self._missed) / p.step_size
        if p.u_max / p.m < needed:
            raise ValueError(
                f"the thrusters give {p.u_max / p.m:.3g} m/s^2, but braking below the speed limit needs {needed:.3g} "
                "m/s^2 at `vel_limit` and `r_max`; lower these"
            )
        room = 0.1 * min(p.v0, p.vel_limit)
        if self._slope * p.step_size > 0.01 or self._rest - 2.0 * added > room:
            raise ValueError(
                f"the speed or the speed limit changes too much within a step of {p.step_size:g} s; use shorter steps"
            )
        if p.u_max / p.m < needed + lost or self._rest + self._missed > room:
            raise ValueError(
                "the bounds of `disturbance` exceed the margin of the speed limit or of braking; lower them"
            )

    def phi(self, position: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return L(r) - speed [m/s], shape (R,)."""
        return self._limit(position) - lengths(velocity)

    def is_safe(self, position: FloatArray, velocity: FloatArray) -> BoolArray:
        """Return the rows within the limit and its margin e, from which the filter guarantees the limit, shape (R,)."""
        limit = self._limit(position)
        return np.asarray(lengths(velocity) <= (1.0 - self._share) * limit - self._rest)

    def __call__(self, position: FloatArray, velocity: FloatArray, desired: FloatArray) -> FilterResult:
        """Return the nearest thrust that is found to satisfy the limit, or that of braking if none is found.

        Args:
            position: Position, or the estimate of it [m], Hill frame, shape (R, 3).
            velocity: Velocity, or the estimate of it [m/s], shape (R, 3).
            desired: Desired thrust [N], shape (R, 3).
        """
        state = np.concatenate((position, velocity), axis=1)
        control = np.clip(desired, -self._u_max, self._u_max)
        refused = ~self._keeps(state, control)
        rows = np.flatnonzero(refused)
        infeasible = np.zeros(len(desired), dtype=np.bool_)
        if len(rows):
            control[rows] = self._search(state[rows], control[rows])
            infeasible[rows] = ~self._keeps(state[rows], control[rows])
        return FilterResult(
            control=control,
            intervening=differs(control, desired),
            infeasible=infeasible,
            backup=refused,
            active=refused.astype(np.int64),
            phi=self.phi(position, velocity)[:, None],
            names=("speed_limit",),
        )

    def _keeps(self, state: FloatArray, control: FloatArray) -> BoolArray:
        """Return whether the state after a hold is safe under every disturbance within the bounds, shape (R,)."""
        after = _times(self._phi, state) + _times(self._gamma, control)
        limit = self._limit(after[:, :3])
        return np.asarray(lengths(after[:, 3:]) <= (1.0 - self._share) * limit - self._rest - self._missed)

    def _search(self, state: FloatArray, wanted: FloatArray) -> FloatArray:
        """Return the thrust nearest to `wanted` on the path from braking that satisfies the limit [N], shape (R, 3)."""
        brake = -_times(self._phi, state)[:, 3:] / self._gain
        low, high = np.zeros(len(state)), np.ones(len(state))

        def thrust(share: FloatArray) -> FloatArray:
            mixed = share[:, None] * wanted + (1.0 - share[:, None]) * brake
            return np.asarray(np.clip(mixed, -self._u_max, self._u_max))

        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            good = self._keeps(state, thrust(middle))
            low, high = np.where(good, middle, low), np.where(good, high, middle)
        return thrust(low)

    def _limit(self, position: FloatArray) -> FloatArray:
        beyond = np.maximum(lengths(position) - self._d0, 0.0)
        return np.asarray(np.minimum(self._v0 + self._slope * beyond, self._top))


def _times(matrix: FloatArray, rows: FloatArray) -> FloatArray:
    """Return the products of a matrix with rows, shape (R, 6); the result is bit-identical for any batch size."""
    total = np.zeros((len(rows), len(matrix)))
    for column in range(rows.shape[1]):
        total += rows[:, column, None] * matrix[:, column]
    return total


class RTAGlueCWHDocking3d(TaskParameters, SafetyGlue):
    """Run-time assurance for one deputy that docks with a chief at the origin of Hill's frame.

    It keeps the speed below the limit of docking, and the speed along each axis below `vel_limit`, at every moment; see
    `SpeedLimitFilter`. `collision_radius`, `fov` and `psm_horizon` are not used.

    Attributes:
        step_size: Time for which a control is held [s].
        v0_distance: Range up to which the limit is `v0` [m].
        vel_limit: Largest speed, and therefore the largest speed along each axis [m/s].
        r_max: Range up to which the guarantee is valid [m].
        disturbance: Bounds of the disturbances under which the limit is enforced; None: the motion is that of the
            model.
    """

    step_size: PositiveDuration = 1.0
    v0_distance: PositiveLength = 0.5
    vel_limit: PositiveSpeed = 10.0
    r_max: PositiveLength = 10_000.0
    disturbance: DisturbanceBounds | None = None

    @model_validator(mode="after")
    def _check(self) -> RTAGlueCWHDocking3d:
        if self.enabled:
            assert self._filter is not None  # Reports wrong parameters now, not at the first step.
        return self

    @cached_property
    def _filter(self) -> SpeedLimitFilter:
        return SpeedLimitFilter(self, self.disturbance)

    @property
    def units(self) -> dict[str, str]:
        """Unit of the safety quantity."""
        return {"speed_limit": "m/s"}

    def refusals(self, states: Mapping[str, FloatArray]) -> dict[str, BoolArray]:
        """Return the mask of the states that are not below the limit by the filter's margin, NaN included, (R,)."""
        return {"speed_limit": ~self._filter.is_safe(states["position"], states["velocity"])}

    def safety(self, states: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return the limit minus the speed [m/s], shape (R,)."""
        return {"speed_limit": self._filter.phi(states["position"], states["velocity"])}

    def filter(self, desired: FloatArray, view: View) -> FilterResult:
        """Return the thrust to hold during the next step."""
        return self._filter(*seen_motion(view, view.world.offers.view), desired)
