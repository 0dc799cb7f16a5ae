"""Active-set invariance filter in its continuous-time form."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Literal

import numpy as np

from safe_inspect.rta.constraints.base import Constraint, ConstraintValues, RelativeState
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.constraints.sets import NAMES
from safe_inspect.rta.filters import SafetyFilter, checked, differs, responds_to_thrust
from safe_inspect.rta.projection import solve_qp
from safe_inspect.simulators.view import FilterResult
from safe_inspect.types import FloatArray, IntArray

#: Outside the safe set, alpha is multiplied by this ...
RETURN_GAIN = 10.0
#: ... and the bias is this [units of h].
RETURN_BIAS = -0.01
_SHORTEST = 1e-12


class ContinuousFilter(SafetyFilter):
    """Filter that applies the nearest control satisfying a condition on the present derivative of every h.

    min |u - u_des|^2 subject to gradient . (drift + input u) + rate + alpha(h + bias) >= 0 for every constraint and
    |u_i| <= u_max; where h < 0, with 10 alpha and a bias of -0.01. If the condition were satisfied at every moment,
    h >= 0 would be guaranteed. However, it is only enforced at the start of a hold: **over a hold of 10 s, this filter
    guarantees none of the constraints**. It is here for comparison; use `BackupFilter`.

    Where no control satisfies all conditions, `infeasible` selects what is applied: ``"least_violating"``, the
    admissible control that minimises the largest violation, measured in newtons (as the distance of the control from
    each condition's half-space), and of those the nearest to the desired one; or ``"pass"``, the desired control
    clipped to the limits of the thrusters.

    Source:
        Gurriet et al., "Towards a framework for realizable safety critical control through active set invariance",
        ICCPS 2018.
    """

    def __init__(
        self,
        parameters: Mapping[str, Any] | ConstraintParameters | None = None,
        names: Iterable[str | Constraint] = NAMES,
        infeasible: Literal["least_violating", "pass"] = "least_violating",
    ) -> None:
        """Build the filter; see `SafetyFilter` for the arguments.

        Raises:
            ValueError: An argument is wrong, the thrusters cannot brake against the tide, or no thrust acts on a
                constraint.
        """
        super().__init__(parameters, names)
        p = self.parameters
        if p.net_acceleration <= 0.0:
            raise ValueError(
                f"thrust u_max {p.u_max} N on {p.m} kg cannot brake against the tide at r_max {p.r_max} m "
                f"(net {p.net_acceleration:.3g} m/s^2), as the method 'continuous' needs; raise u_max, lower r_max, "
                "or use the method 'backup'"
            )
        for name, constraint in self.constraints.items():
            if name not in NAMES and not responds_to_thrust(constraint):
                raise ValueError(
                    f"the method 'continuous' cannot enforce the constraint {name!r}: the velocity part of the "
                    "gradient of its h is 0 everywhere, so thrust cannot affect it; let h depend on the velocity too"
                )
        self.infeasible = infeasible

    def __call__(self, state: RelativeState, desired: FloatArray) -> FilterResult:
        """Return the controls to apply; see `SafetyFilter`.

        `active` names the conditions that the desired controls violate.
        """
        desired = checked(state, desired)
        evaluations = [constraint.evaluate(state) for constraint in self.constraints.values()]
        rows, bounds = self.conditions(state, evaluations)
        limit = float(self.parameters.u_max)
        clipped = np.clip(desired, -limit, limit)
        control, feasible = solve_qp(clipped, rows, bounds, limit)
        if self.infeasible == "pass":
            control = np.where(feasible[:, None], control, clipped)
        value = np.zeros(bounds.shape)
        for axis in range(3):
            value += rows[..., axis] * clipped[:, None, axis]
        active: IntArray = ((value < bounds - 1e-9) << np.arange(len(self.names))).sum(axis=1)
        return FilterResult(
            control=control,
            intervening=differs(control, desired),
            infeasible=~feasible,
            backup=np.zeros(len(state), np.bool_),
            active=active,
            phi=self.columns([evaluation.phi for evaluation in evaluations], len(state)),
            names=self.names,
        )

    def conditions(self, state: RelativeState, evaluations: list[ConstraintValues]) -> tuple[FloatArray, FloatArray]:
        """Return the half-spaces rows . u >= bounds of the constraints [N], shapes (R, C, 3) and (R, C).

        The normals have unit length, except where a condition does not depend on the control.
        """
        count = len(self.constraints)
        rows, bounds = np.zeros((len(state), count, 3)), np.zeros((len(state), count))
        n, mass = float(self.parameters.n), float(self.parameters.m)
        x, z = state.position[:, 0], state.position[:, 2]
        vx, vy, vz = state.velocity[:, 0], state.velocity[:, 1], state.velocity[:, 2]
        drift = (vx, vy, vz, 3.0 * n * n * x + 2.0 * n * vy, -2.0 * n * vx, -n * n * z)
        for j, (constraint, value) in enumerate(zip(self.constraints.values(), evaluations, strict=True)):
            outside = RETURN_GAIN * constraint.alpha(value.h + RETURN_BIAS)
            total = value.rate + np.where(value.h < 0.0, outside, constraint.alpha(value.h + constraint.bias))
            for i, part in enumerate(drift):
                total = total + value.gradient[:, i] * part
            normal = value.gradient[:, 3:] / mass
            length = np.sqrt(normal[:, 0] ** 2 + normal[:, 1] ** 2 + normal[:, 2] ** 2)
            length = np.where(length > _SHORTEST, length, 1.0)
            rows[:, j], bounds[:, j] = normal / length[:, None], -total / length
        return rows, bounds
