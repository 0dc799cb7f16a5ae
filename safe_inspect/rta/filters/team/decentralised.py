"""Filter of one deputy that keeps its distance from others, which are assumed to coast."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from safe_inspect.rta.constraints.base import Constraint, RelativeState
from safe_inspect.rta.constraints.deputies import DEPUTY_RADIUS
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.filters.base import as_columns, checked, differs
from safe_inspect.rta.filters.team.safety_filter import TeamFilter, TeamState
from safe_inspect.simulators.view import FilterResult
from safe_inspect.types import BoolArray, FloatArray


class DecentralisedFilter:
    """Filter that applies the nearest thrust of one deputy that is safe if the others coast.

    It is the team's filter with the others as obstacles. The hold must satisfy every constraint, and the distance from
    the others on their coasting motion, at every moment, and leave a backup plan that satisfies both. What the others
    do instead of coasting is unknown: two deputies that thrust towards each other can come too near, or reach states
    without a plan. `TeamFilter` decides for all deputies at once.

    Attributes:
        names: The names of the constraints: those about the chief first, then those of the pairs.
    """

    def __init__(
        self,
        parameters: Mapping[str, Any] | ConstraintParameters | None,
        names: Iterable[str | Constraint],
        pair_names: Iterable[str | Constraint],
        deputy_radius: float = DEPUTY_RADIUS,
    ) -> None:  # fmt: skip
        """Build the filter.

        Args:
            parameters: Parameters by name, as in safe-autonomy-sims; see `ConstraintParameters`.
            names: Names of the single filter's constraints, or constraints.
            pair_names: Constraints between deputies, ``deputy_collision`` or ``deputy_PSM``, by name or built.
            deputy_radius: Radius about each deputy [m].

        Raises:
            ValueError: An argument is wrong; see `TeamFilter`.
        """
        self._team = TeamFilter(parameters, (*names, *pair_names), deputy_radius)
        self.names = self._team.names

    def __call__(
        self, state: RelativeState, desired: FloatArray, others_position: FloatArray, others_velocity: FloatArray
    ) -> FilterResult:  # fmt: skip
        """Return the thrusts to apply.

        Args:
            state: The states of R deputies.
            desired: Their desired thrusts [N], Hill frame, shape (R, 3).
            others_position: Positions of the other deputies [m], Hill frame, shape (R, D - 1, 3).
            others_velocity: Their velocities [m/s], Hill frame, shape (R, D - 1, 3).

        Raises:
            ValueError: The shapes differ, or a number is not finite.
        """
        desired = checked(state, desired)
        team = self._with(state, others_position, others_velocity)
        wanted = np.zeros(team.position.shape)
        wanted[:, 0] = desired
        result = self._team(team, wanted)
        control = np.ascontiguousarray(result.control[:, 0])
        return FilterResult(
            control=control,
            intervening=differs(control, desired),
            infeasible=result.infeasible,
            backup=result.backup,
            active=np.ascontiguousarray(result.active[:, 0]),
            phi=as_columns(list(self.phi(state, others_position, others_velocity).values()), len(state)),
            names=self.names,
        )

    def recoverable(
        self, state: RelativeState, others_position: FloatArray, others_velocity: FloatArray
    ) -> BoolArray:  # fmt: skip
        """Return the rows that have a backup plan if the others coast, shape (R,)."""
        return self._team.recoverable(self._with(state, others_position, others_velocity))

    def phi(
        self, state: RelativeState, others_position: FloatArray, others_velocity: FloatArray
    ) -> dict[str, FloatArray]:  # fmt: skip
        """Return each constraint's safety quantity phi, >= 0 where safe; for a pair, with the nearest other, (R,)."""
        team = self._with(state, others_position, others_velocity)
        found = {name: constraint.phi(state) for name, constraint in self._team.alone.constraints.items()}
        for name, pair in self._team.pair_constraints.items():
            least = np.full(len(state), np.inf)
            for other in range(1, team.position.shape[1]):
                least = np.minimum(least, pair.phi(team.relative(0, other)))
            found[name] = least
        return found

    @staticmethod
    def _with(state: RelativeState, others_position: FloatArray, others_velocity: FloatArray) -> TeamState:
        rows, others = others_position.shape[0], others_position.shape[1]
        coasting = np.ones((rows, others + 1), np.bool_)
        coasting[:, 0] = False
        return TeamState(
            np.concatenate((state.position[:, None], others_position), axis=1),
            np.concatenate((state.velocity[:, None], others_velocity), axis=1),
            state.sun_angle, coasting,
        )  # fmt: skip
