"""Base of the safety filters that act on all deputies of an environment together."""

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
    """What a team's safety filter does to the thrusts of a step.

    Attributes:
        control: Thrust to hold [N], Hill frame, shape (N, D, 3).
        intervening: Deputies whose thrust was changed by more than 0.01 N, shape (N, D).
        infeasible: Environments in which the filter can promise nothing, shape (N,).
        backup: Environments in which a backup plan was flown, shape (N,).
        memory: New values of the arrays that the filter has declared, each of shape (N, ...).
    """

    control: FloatArray
    intervening: BoolArray
    infeasible: BoolArray
    backup: BoolArray
    memory: Mapping[str, AnyArray] = field(default_factory=dict)


class TeamSafety(Plugin):
    """Keeps all deputies of an environment safe, from the chief and from each other. ``rta`` in environment.yml.

    Attributes:
        enabled: True: the thrusts are filtered. False: the filter costs nothing.
        invalid_actions: What an action that is NaN or infinite does where the filter is enabled: ``error`` stops the
            run, ``backup`` asks for no thrust of that deputy; infos and evaluations tell of it.
        undeclared: What components and dynamics that declare no `disturbance_bounds` do where the filter is enabled:
            ``error`` refuses the experiment, ``warn`` flies it with a warning that names them, without a promise.
    """

    kind: ClassVar[str] = "rta"

    enabled: bool = True
    invalid_actions: Literal["error", "backup"] = "error"
    undeclared: Literal["error", "warn"] = "error"

    @abstractmethod
    def __call__(self, desired: FloatArray, team: TeamView) -> TeamFiltered:
        """Return the thrusts to hold in the next step.

        Args:
            desired: Desired thrust of each deputy [N], Hill frame, shape (N, D, 3).
            team: The state at the beginning of the step. What is desired for finished deputies has no meaning; what is
                returned for them is flown, so return zeros where they are to coast.
        """

    @abstractmethod
    def refusals(self, states: Mapping[str, FloatArray]) -> dict[str, BoolArray]:
        """Return for each constraint the environments whose initial state it refuses, shape (R,).

        Args:
            states: ``position`` [m] (R, D, 3), ``velocity`` [m/s] (R, D, 3), ``sun_angle`` [rad] (R,). D may be smaller
                than the number of deputies while a team is drawn one by one.
        """

    @abstractmethod
    def safety(self, states: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return for each constraint its smallest plain safety quantity over the team, at least 0 where safe, (R,)."""

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the arrays that the filter remembers, each with its shape for one environment. None by default."""
        return {}
