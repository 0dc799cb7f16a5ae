"""Switching filter: applies the desired control while it is safe, and otherwise a controller that tracks an ellipse."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from safe_inspect.dynamics.cwh import propagate, transition
from safe_inspect.dynamics.regulator import regulator
from safe_inspect.rta.constraints.base import Constraint, RelativeState
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.constraints.sets import NAMES
from safe_inspect.rta.filters.backup.safety_filter import BackupFilter
from safe_inspect.rta.filters.base import checked, differs
from safe_inspect.simulators.view import FilterResult
from safe_inspect.types import BoolArray, FloatArray

#: An ellipse whose angle about the chief leads or lags the axis of the sun cone by this much stays out of a cone of 60
#: deg: the direction on a 2:1 ellipse differs from a uniform rotation by at most 19.5 deg.
_STRAY = math.asin(1.0 / 3.0)
_CLEAR = math.radians(5.0)
#: Weights of the regulator, of squared errors of position [1/m^2] and velocity [s^2/m^2]; that of thrust is 1 [1/N^2].
_WEIGHTS = [1e-6] * 3 + [1.0] * 3


@dataclass(frozen=True, eq=False)
class SimplexMemory:
    """Memory of the switching filter between steps, reset to zero with the episode.

    Attributes:
        delta_v: Delta-v used so far, the sum of |u_i| dt / m over steps and axes [m/s], shape (R,).
        latched: True where the limit is reached: the deputy coasts on a safe motion until the episode ends, shape (R,).
    """

    delta_v: FloatArray
    latched: BoolArray

    @classmethod
    def zeros(cls, rows: int) -> SimplexMemory:
        """Return the memory at the start of R episodes."""
        return cls(np.zeros(rows), np.zeros(rows, np.bool_))


class SimplexFilter:
    """Filter that switches between the desired control and a backup controller.

    The desired control is applied where `BackupFilter` would not change it. Elsewhere, the backup controller is used: a
    linear-quadratic regulator on the discrete dynamics tracks the closed 2:1 ellipse about the chief that is nearest to
    the present position in size and phase, within bounds that keep it safe. Its control is also passed through
    `BackupFilter`, so the switching filter gives the same guarantees.

    A control is applied only if its delta-v, added to what was used before, leaves enough of `delta_v_limit` for the
    plan of the state after it. Otherwise, the plan of the present state is applied, for which enough was left one step
    before, and from then on the deputy coasts on the closed motion of that plan. An episode therefore satisfies the
    limit if the plan of its initial state does; the limit is not enforced for a state without a plan.

    Attributes:
        parameters: The task's parameters.
        names: The names of the constraints.
        delta_v_limit: Delta-v limit of an episode [m/s].
        gain: Gain of the regulator from (position, velocity) errors [N/m, N s/m], shape (3, 6).
    """

    def __init__(
        self,
        parameters: Mapping[str, Any] | ConstraintParameters | None = None,
        names: Iterable[str | Constraint] = NAMES,
        delta_v_limit: float = math.inf,
    ) -> None:
        """Build the filter.

        Args:
            parameters: Parameters by name, as in safe-autonomy-sims; see `ConstraintParameters`.
            names: Constraints that `BackupFilter` can enforce, by name or built.
            delta_v_limit: Delta-v limit of an episode [m/s].

        Raises:
            ValueError: An argument is wrong.
        """
        self._safe = BackupFilter(parameters, names, several_holds=False)  # The delta-v reserve assumes one hold.
        self.parameters, self.names, self.delta_v_limit = self._safe.parameters, self._safe.names, delta_v_limit
        p = self.parameters
        self._hold = transition(float(p.n), float(p.m), float(p.step_size))
        self.gain = regulator(*self._hold, np.diag(_WEIGHTS), np.eye(3))

    def __call__(
        self, state: RelativeState, desired: FloatArray, memory: SimplexMemory
    ) -> tuple[FilterResult, SimplexMemory]:  # fmt: skip
        """Return the controls to apply, and the memory after the step; `memory` itself is not changed.

        Raises:
            ValueError: The shapes differ, or a number is not finite; the message names the first such row.
        """
        desired = checked(state, desired)
        limit = float(self.parameters.u_max)
        clipped = np.clip(desired, -limit, limit)
        refusal = self._safe(state, clipped)
        switched = refusal.backup | refusal.infeasible | (refusal.active != 0)
        control, infeasible = clipped.copy(), np.zeros(len(state), np.bool_)
        if switched.any():
            backup = self._safe(state[switched], self.tracking(state[switched]))
            control[switched], infeasible[switched] = backup.control, backup.infeasible
        latched = memory.latched | (memory.delta_v + self._with_reserve(state, control) > self.delta_v_limit)
        if latched.any():
            planned, thrust = self._safe.backups(state[latched])
            known = np.flatnonzero(latched)[planned]
            control[known], infeasible[known] = thrust[planned], False
        result = FilterResult(
            control, differs(control, desired), infeasible, switched | latched, refusal.active, refusal.phi, self.names
        )  # fmt: skip
        return result, SimplexMemory(memory.delta_v + self._delta_v(control), latched)

    def _with_reserve(self, state: RelativeState, control: FloatArray) -> FloatArray:
        """Return the delta-v of a control and of the plan that follows it [m/s], shape (R,)."""
        if math.isinf(self.delta_v_limit):
            return np.zeros(len(state))
        position, velocity = np.empty_like(state.position), np.empty_like(state.velocity)
        propagate(state.position, state.velocity, control, *self._hold, position, velocity)
        after = RelativeState(
            position, velocity, state.sun_angle + float(self.parameters.n * self.parameters.step_size)
        )
        return self._delta_v(control) + self._delta_v(self._safe.backups(after)[1])

    def _delta_v(self, control: FloatArray) -> FloatArray:
        thrust = np.abs(control)
        return (thrust[:, 0] + thrust[:, 1] + thrust[:, 2]) * float(self.parameters.step_size / self.parameters.m)

    def tracking(self, state: RelativeState) -> FloatArray:
        """Return the regulator's thrust towards the safe ellipse, clipped to the thrusters [N], shape (R, 3)."""
        position, velocity = self.ellipse(state)
        errors = np.concatenate((state.position - position, state.velocity - velocity), axis=1)
        control = np.zeros((len(state), 3))
        for axis in range(3):
            for j in range(6):
                control[:, axis] -= self.gain[axis, j] * errors[:, j]
        limit = float(self.parameters.u_max)
        return np.clip(control, -limit, limit)

    def ellipse(self, state: RelativeState) -> tuple[FloatArray, FloatArray]:
        """Return the reference state on each deputy's safe ellipse: position [m] and velocity [m/s], shape (R, 3) each.

        The ellipse is x = A sin tau, y = 2 A cos tau, z = 0, where tau advances at the rate n. A is that of the ellipse
        through the present position, clipped between 1.5 collision radii and 0.45 times the largest range and what the
        axis speeds allow; tau is that of the present position, kept away from the axis of the sun cone.
        """
        n, limit = float(self.parameters.n), self._safe.limit
        x, y = state.position[:, 0], state.position[:, 1]
        smallest = 1.5 * limit("collision_radius", "chief_collision", "PSM")
        fastest = min(limit("vel_limit", "x_vel"), limit("vel_limit", "y_vel"))
        largest = max(smallest, min(0.45 * limit("r_max", "r_max"), 0.45 * fastest / n))
        size = np.clip(np.sqrt(x * x + 0.25 * y * y), smallest, largest)
        tau = np.arctan2(x, 0.5 * y)
        # The cone's axis (-cos theta, sin theta) is at the angle theta - pi/2 in the same sense.
        axis = state.sun_angle - 0.5 * math.pi
        lead = np.mod(tau - axis + math.pi, 2.0 * math.pi) - math.pi
        away = min(0.5 * limit("fov", "sun") + _STRAY + _CLEAR, math.pi)
        lead = np.where(np.abs(lead) < away, np.where(lead < 0.0, -away, away), lead)
        sine, cosine = np.sin(axis + lead), np.cos(axis + lead)
        rest = np.zeros(len(state))
        position = np.stack((size * sine, 2.0 * size * cosine, rest), axis=1)
        velocity = np.stack((size * n * cosine, -2.0 * size * n * sine, rest), axis=1)
        return position, velocity
