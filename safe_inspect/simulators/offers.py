"""Values that dynamics and components provide to plugins by name, in `World`, `View`, `TeamView` and `Step`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from safe_inspect.types import AnyArray


class _Offering(Protocol):
    """A provider of named values: a running component, see `RunningComponent`."""

    def of_world(self) -> Mapping[str, Any]:
        """Return values of `World` by name."""

    def of_view(self) -> Mapping[str, Callable[[Any], Any]]:
        """Return functions of a `View` by name."""

    def of_team(self) -> Mapping[str, Callable[[Any], Any]]:
        """Return functions of a `TeamView` by name."""

    def of_step(self) -> Mapping[str, Callable[[Any], Any]]:
        """Return functions of a `Step` by name."""

    def info(self, view: Any) -> dict[str, AnyArray]:
        """Return columns of an agent's info, each of shape (R,)."""

    def team_info(self, team: Any) -> dict[str, AnyArray]:
        """Return columns of the team's info, each of shape (N,)."""

    def shared_state(self, team: Any) -> tuple[AnyArray, ...]:
        """Return parts of the state of all agents, each of shape (N, ...)."""


@dataclass(frozen=True)
class Offers:
    """Names that the dynamics and components of a task provide.

    Attributes:
        world: Values by name.
        view: Functions of a `View` by name.
        team: Functions of a `TeamView` by name.
        step: Functions of a `Step` by name.
        components: The running components, in the order in which they are called after a step.
    """

    world: dict[str, Any] = field(default_factory=dict)
    view: dict[str, Callable[[Any], Any]] = field(default_factory=dict)
    team: dict[str, Callable[[Any], Any]] = field(default_factory=dict)
    step: dict[str, Callable[[Any], Any]] = field(default_factory=dict)
    components: list[_Offering] = field(default_factory=list)

    def add(self, component: _Offering) -> None:
        """Add the names that a component provides.

        Raises:
            ValueError: Another component provides the same name.
        """
        given: tuple[Mapping[str, Any], ...] = (
            component.of_world(), component.of_view(), component.of_team(), component.of_step()
        )  # fmt: skip
        for known, new in zip((self.world, self.view, self.team, self.step), given, strict=True):
            for name in new:
                if name in known:
                    raise ValueError(
                        f"two components provide the name {name!r}; rename one, or remove one of the components"
                    )
            known.update(new)
        self.components.append(component)


@dataclass(frozen=True)
class OfView:
    """Array of the state with the environment axis, for a `View`: one row for each environment and agent."""

    name: str

    def __call__(self, view: Any) -> Any:
        """Return the array, shape (R, ...)."""
        return view.per_environment(view.state[self.name])


@dataclass(frozen=True)
class OwnOfView:
    """Array of the state with a deputy axis, for a `View`: the row of each agent is its own entry."""

    name: str

    def __call__(self, view: Any) -> Any:
        """Return the array, shape (R, ...)."""
        return view.per_agent(view.state[self.name])


@dataclass(frozen=True)
class OfTeam:
    """Array of the state with the environment axis, for a `TeamView`: one row for each environment."""

    name: str

    def __call__(self, team: Any) -> Any:
        """Return the array, shape (N, ...)."""
        return team.state[self.name]
