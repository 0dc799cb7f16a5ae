"""Base class of the safety filters that act on all deputies of an environment together."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.simulators.team import TeamView
from safe_inspect.simulators.world import World
from safe_inspect.types import AnyArray, BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class TeamFiltered:
    """Effect of a team's safety filter on the thrusts of a step.

    Attributes:
        control: Thrust to hold [N], Hill frame, shape (N, D, 3).
        intervening: Deputies whose thrust was changed by more than 0.01 N, shape (N, D).
        infeasible: Environments in which the filter can guarantee nothing, shape (N,).
        backup: Environments in which a backup plan was applied, shape (N,).
        memory: New values of the arrays that the filter has declared, each of shape (N, ...).
    """

    control: FloatArray
    intervening: BoolArray
    infeasible: BoolArray
    backup: BoolArray
    memory: Mapping[str, AnyArray] = field(default_factory=dict)


class TeamSafety(Plugin):
    """Base class of the filters that keep the deputies of a team safe: from the chief, and from each other.

    The key ``rta`` of environment.yml configures one.

    Attributes:
        enabled: Whether the thrusts are filtered. If False, the filter costs nothing.
        invalid_actions: What happens if an action is NaN or infinite while the filter is enabled: ``error`` stops the
            run, ``backup`` sets the desired thrust of that deputy to zero; infos and evaluations report it.
        undeclared: What happens if components or dynamics declare no `disturbance_bounds` while the filter is enabled:
            ``error`` rejects the experiment, ``warn`` runs it without a guarantee, with a warning that names them.
    """

    kind: ClassVar[str] = "rta"

    enabled: bool = True
    invalid_actions: Literal["error", "backup"] = "error"
    undeclared: Literal["error", "warn"] = "error"

    @abstractmethod
    def __call__(self, desired: FloatArray, team: TeamView) -> TeamFiltered:
        """Return the thrusts to hold during the next step.

        Args:
            desired: Desired thrust of each deputy [N], Hill frame, shape (N, D, 3).
            team: The state at the start of the step. The desired thrusts of finished deputies have no meaning, but the
                returned ones are applied: return zeros if they should coast.
        """

    @abstractmethod
    def refusals(self, states: Mapping[str, FloatArray]) -> dict[str, BoolArray]:
        """Return, for each constraint, the mask of the environments whose initial state it rejects, shape (R,).

        Args:
            states: ``position`` [m] (R, D, 3), ``velocity`` [m/s] (R, D, 3), ``sun_angle`` [rad] (R,). D may be smaller
                than the number of deputies while the deputies of a team are sampled one by one.
        """

    @abstractmethod
    def safety(self, states: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return, for each constraint, the least safety quantity phi of the team, >= 0 where it is safe, shape (R,)."""

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the arrays that the filter stores between steps, with their shapes for one environment."""
        return {}
