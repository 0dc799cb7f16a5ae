"""Components: what a task adds to the motion of its vehicles. The simulator uses them only through this interface."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

from safe_inspect.dynamics.base import NO_DISTURBANCE, DisturbanceBounds, MotionLimits
from safe_inspect.errors import ArgumentError
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators.offers import OfTeam, OfView, OwnOfView
from safe_inspect.simulators.state import State
from safe_inspect.simulators.world import World
from safe_inspect.types import AnyArray, ArraySpec, BoolArray, FloatArray, IntArray


class EntityParameter(NamedTuple):
    """A parameter of a component that an experiment lists among its bodies.

    Attributes:
        symbol: SI unit of the number.
        value: Name under which a reset passes the drawn number to the components.
        purpose: Purpose of the draw, see `safe_inspect.random.streams`.
    """

    symbol: str
    value: str
    purpose: str


class Component(Plugin):
    """A part of a task, such as the sun or the points of a chief. Calling it returns the running part of a simulation.

    Class attributes:
        entity: Parameters, by name, of the entry under ``additional_entities`` whose ``entity_class`` is the
            component's name; empty if it has no such entry.
        parameters: SI unit by the name of each reset parameter that the component reads if the configuration gives it;
            None for a mapping of states.
        optional_parameters: Condition under which the component reads a reset parameter, by its name, for messages.
    """

    kind: ClassVar[str] = "component"
    entity: ClassVar[Mapping[str, EntityParameter]] = {}
    parameters: ClassVar[Mapping[str, str | None]] = {}
    optional_parameters: ClassVar[Mapping[str, str]] = {}

    @property
    def allowed(self) -> Mapping[str, tuple[float, float]]:
        """Smallest and largest allowed value, in SI, by the name of a reset parameter. Empty by default."""
        return {}

    @abstractmethod
    def __call__(self, world: World, num_envs: int) -> RunningComponent:
        """Return the running component of N environments.

        Args:
            world: The constant data of the simulation, including what the dynamics and the preceding components
                provide.
            num_envs: Number of environments, N.
        """

    def disturbance_bounds(self, limits: MotionLimits) -> DisturbanceBounds | None:
        """Return bounds of the disturbance of a deputy's motion, thrust and estimated state in one step of the agents.

        Safety filters use these bounds: an enabled filter is rejected if their sum exceeds what it tolerates. A
        component that only observes is a `PassiveComponent`. The default, None, states nothing.

        Args:
            limits: The range of motion for which the bounds must be valid.
        """
        return None

    @property
    def estimates(self) -> bool:
        """Whether the component estimates the states of the deputies, with errors. False by default."""
        return False

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies that the component needs. Empty by default."""
        return ()

    @property
    def radii(self) -> Mapping[str, float]:
        """Radius [m], by name, of the bodies whose size the component defines. Empty by default."""
        return {}


class PassiveComponent(Component):
    """A component that only observes: it does not affect the motion of deputies."""

    def disturbance_bounds(self, limits: MotionLimits) -> DisturbanceBounds:
        """Return zero bounds."""
        return NO_DISTURBANCE


def require_different(components: Sequence[Component]) -> None:
    """Check that there are no two components of one class, or with estimates, which would write the same arrays.

    Raises:
        ArgumentError: There are.
    """
    names = [component.registered_name for component in components]
    for name in names:
        if names.count(name) > 1:
            raise ArgumentError(f"there are {names.count(name)} components {name}; combine them into one")
    if len(estimating := [component.registered_name for component in components if component.estimates]) > 1:
        raise ArgumentError(f"{' and '.join(estimating)} estimate the states; remove one of them, or its errors")


class RunningComponent:
    """A component in a simulation of N environments. Methods that are not overridden do nothing.

    Attributes:
        arrays: The arrays that it adds to the state, by name.
        recorded: Names of the arrays that recorded episodes contain for every step, and that evaluations list among the
            initial states. Each must contain real numbers, with the environment axis first.
        offered: Arrays that plugins can read by name from a `View` and a `TeamView`, and what a view returns of each:
            `OfView`, the rows of the environments, or `OwnOfView`, each agent's own entries.
        figures: Label and unit, in tables of evaluations, for names of `info` and `team_info`; a missing name is shown
            as it is, without a unit.
    """

    arrays: Mapping[str, ArraySpec] = {}
    recorded: tuple[str, ...] = ()
    offered: Mapping[str, type[OfView | OwnOfView]] = {}
    figures: Mapping[str, tuple[str, str]] = {}

    def reset(self, state: State, values: Mapping[str, Any]) -> None:
        """Write the initial values of new episodes.

        Args:
            state: The environments at the start of their episodes, R rows; the states of the bodies are already set.
            values: The reset parameters and states that were drawn, by name, each with R rows.
        """

    def resume(self, state: State, rows: IntArray) -> None:
        """Write the values that persist across resets into the state of new episodes.

        Args:
            state: The environments at the start of their episodes, R rows.
            rows: Their indices in the batch, shape (R,).
        """

    def actuate(self, state: State, control: FloatArray) -> FloatArray:
        """Return the control that is applied; a new array if it differs from the commanded control.

        Args:
            state: The state before the step, N rows.
            control: Commanded control of each deputy, in the unit of the dynamics, shape (N, D, C).
        """
        return control

    def step(self, state: State, running: BoolArray) -> None:
        """Update the component's arrays in place after a step, for the new states of the bodies.

        Args:
            state: The state after the dynamics, N rows; the component's arrays still contain the values before the
                step.
            running: Mask of the environments whose episode is running, shape (N,).
        """

    def end(self, state: State, rows: IntArray) -> None:
        """Record that the episodes of some environments, shape (E,), have just ended."""

    def part(self, rows: IntArray) -> RunningComponent:
        """Return a component for a batch of R rows that contains only some environments; the default returns itself.

        Override it together with `join` if the component has data that persist across resets. Then environments that
        wait during decisions of several steps do not have to be stepped.

        Args:
            rows: Indices of the environments, shape (R,).
        """
        return self

    def join(self, part: Any, rows: IntArray) -> None:
        """Copy the persistent data of some environments back from a part.

        Args:
            part: The return value of `part`.
            rows: Indices of the environments, shape (R,); they are the first R rows of the part.
        """

    def restart(self) -> None:
        """Clear the data that persist across resets, because the run restarts with another seed."""

    def state_dict(self) -> dict[str, AnyArray]:
        """Return copies of the data that persist across resets, for a checkpoint."""
        return {}

    def load_state_dict(self, state: Mapping[str, AnyArray]) -> None:
        """Restore the data that `state_dict` returned; called before a reset."""

    def of_world(self) -> Mapping[str, Any]:
        """Return the values that plugins can read by name from `World`."""
        return {}

    def of_view(self) -> Mapping[str, Callable[[Any], Any]]:
        """Return the values that plugins can read by name from a `View`, each as a function of the view."""
        return {name: of_view(name) for name, of_view in self.offered.items()}

    def of_team(self) -> Mapping[str, Callable[[Any], Any]]:
        """Return the values that plugins can read by name from a `TeamView`, each as a function of the view."""
        return {name: OfTeam(name) for name in self.offered}

    def of_step(self) -> Mapping[str, Callable[[Any], Any]]:
        """Return the values that plugins can read by name from a `Step`, each as a function of the step."""
        return {}

    def info(self, view: Any) -> dict[str, AnyArray]:
        """Return the values for the info of an agent in a state (a `View`), each of shape (R,)."""
        return {}

    def team_info(self, team: Any) -> dict[str, AnyArray]:
        """Return the values for the info of the whole team in a state (a `TeamView`), each of shape (N,)."""
        return {}

    def shared_state(self, team: Any) -> tuple[AnyArray, ...]:
        """Return parts of the state (a `TeamView`) for a centralised critic, each of shape (N, ...)."""
        return ()
