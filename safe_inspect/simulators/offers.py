"""Values that dynamics and components provide to plugins by name, in `World`, `View`, `TeamView` and `Step`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from safe_inspect.errors import MissingNameError, did_you_mean


def missing(what: str, name: str, offered: Iterable[str], thing: object = None) -> MissingNameError:
    """Return the error for a name that the task does not provide, with a suggestion.

    Args:
        what: What was read, such as ``view``.
        name: The name.
        offered: Names that the task provides.
        thing: The object that was read; its own public names are suggested too, if they are similar.
    """
    hint = did_you_mean(name, offered)
    if thing is not None and "?" not in hint:
        own = did_you_mean(name, [known for known in dir(type(thing)) if not known.startswith("_")])
        hint = own if "?" in own else hint
    return MissingNameError(f"the {what} of this task has no {name!r}; {hint}", name=name)


def offered(what: str, name: str, seen: Any) -> Any:
    """Return a value that the task provides by name in a view or a step, which has a `world`.

    Args:
        what: What is read: ``view``, ``team`` or ``step``.
        name: The name.
        seen: The view or the step; one that is being copied has no world yet.

    Raises:
        MissingNameError: The task does not provide it.
    """
    world = seen.__dict__.get("world")
    values = {} if world is None else getattr(world.offers, what)
    if name not in values:
        raise missing("view of the team" if what == "team" else what, name, values, seen)
    return values[name](seen)


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
    components: list[Any] = field(default_factory=list)

    def add(self, component: Any) -> None:
        """Add the names that a `RunningComponent` provides.

        Raises:
            ValueError: Another component provides the same name.
        """
        for what in ("world", "view", "team", "step"):
            known, new = getattr(self, what), getattr(component, f"of_{what}")()
            if repeated := [name for name in new if name in known]:
                raise ValueError(
                    f"two components provide the name {repeated[0]!r}; rename one, or remove one of the components"
                )
            known.update(new)
        self.components.append(component)


@dataclass(frozen=True)
class _OfState:
    """An array of the state that plugins read by name."""

    name: str


class OfView(_OfState):
    """Array of the state with the environment axis, for a `View`: one row for each environment and agent."""

    def __call__(self, view: Any) -> Any:
        """Return the array, shape (R, ...)."""
        return view.per_environment(view.state[self.name])


class OwnOfView(_OfState):
    """Array of the state with a deputy axis, for a `View`: the row of each agent is its own entry."""

    def __call__(self, view: Any) -> Any:
        """Return the array, shape (R, ...)."""
        return view.per_agent(view.state[self.name])


class OfTeam(_OfState):
    """Array of the state with the environment axis, for a `TeamView`: one row for each environment."""

    def __call__(self, team: Any) -> Any:
        """Return the array, shape (N, ...)."""
        return team.state[self.name]
