"""Components: what a task adds to the simulation of its vehicles. The simulator knows them by this interface alone."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple

from safe_inspect.dynamics.base import DisturbanceBounds, MotionLimits
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators.state import State
from safe_inspect.simulators.world import World
from safe_inspect.types import AnyArray, ArraySpec, BoolArray, FloatArray, IntArray


class EntityParameter(NamedTuple):
    """A parameter of a component that an experiment lists among its bodies.

    Attributes:
        symbol: SI unit of the number.
        value: Name under which a reset gives the drawn number to the components.
        purpose: Purpose of the draw, see `safe_inspect.random.streams`.
    """

    symbol: str
    value: str
    purpose: str


class Component(Plugin):
    """A part of a task, such as the sun or the points of a chief. Called, it gives the running part of a simulation.

    Class attributes:
        entity: Parameters, by name, of the entry under ``additional_entities`` whose ``entity_class`` is the
            component's name; empty where it has no such entry.
        parameters: SI unit by the name of each reset parameter that it reads where a configuration gives it; None for
            a mapping of states.
    """

    kind: ClassVar[str] = "component"
    entity: ClassVar[Mapping[str, EntityParameter]] = {}
    parameters: ClassVar[Mapping[str, str | None]] = {}

    @abstractmethod
    def __call__(self, world: World, num_envs: int) -> RunningComponent:
        """Return the running component of N environments.

        Args:
            world: What does not change, with what the dynamics and the components before this one offer.
            num_envs: Number of environments, N.
        """

    def disturbance_bounds(self, limits: MotionLimits) -> DisturbanceBounds | None:
        """Return bounds of what it does in a step of the agents to a deputy's motion, thrust and estimated state.

        Safety filters count on them: an enabled filter is refused where their sum exceeds what it withstands.
        ``NO_DISTURBANCE`` of a component that only watches; None, the default, says nothing.

        Args:
            limits: The flight for which the bounds must be valid.
        """
        return None

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies that it needs. None by default."""
        return ()

    @property
    def radii(self) -> Mapping[str, float]:
        """Radius [m] of the bodies whose size it knows, by name. None by default."""
        return {}


class RunningComponent:
    """A component in a simulation of N environments. Every method does nothing unless it is overridden.

    Attributes:
        arrays: The arrays that it adds to the state, by name.
        recorded: Names of those arrays that recorded episodes keep at every step, and that evaluations list among the
            initial states. Each is of real numbers, with the axis of environments first.
        figures: Label and unit in tables of evaluations, for names of `info` and `team_info`; the name itself, without
            a unit, for those that are missing.
    """

    arrays: Mapping[str, ArraySpec] = {}
    recorded: tuple[str, ...] = ()
    figures: Mapping[str, tuple[str, str]] = {}

    def reset(self, state: State, values: Mapping[str, Any]) -> None:
        """Write the initial values of fresh environments.

        Args:
            state: Fresh environments, R rows, whose bodies stand where their episodes start.
            values: The reset parameters and states that were drawn, by name, each with R rows.
        """

    def resume(self, state: State, rows: IntArray) -> None:
        """Write what lives through resets into fresh environments.

        Args:
            state: Fresh environments, R rows.
            rows: Their indices in the batch, shape (R,).
        """

    def actuate(self, state: State, control: FloatArray) -> FloatArray:
        """Return the control that is flown, a new array where it differs from the commanded one.

        Args:
            state: The state before the step, N rows.
            control: Commanded control of each deputy, in the unit of the dynamics, shape (N, D, C).
        """
        return control

    def step(self, state: State, running: BoolArray) -> None:
        """Follow a step: write the component's arrays for the bodies' new states, in place.

        Args:
            state: The state after the dynamics, N rows; the component's arrays are those before the step.
            running: Environments whose episode runs, shape (N,).
        """

    def end(self, state: State, rows: IntArray) -> None:
        """Take note of the environments whose episodes have just ended, shape (E,)."""

    def part(self, rows: IntArray) -> RunningComponent:
        """Return what follows the steps of some environments alone, as a batch of R rows: by default itself.

        Override it, and `join`, where something lives through resets, so that decisions that last are stepped without
        the environments that wait.

        Args:
            rows: Their indices, shape (R,).
        """
        return self

    def join(self, part: Any, rows: IntArray) -> None:
        """Take back what a part has kept of some environments.

        Args:
            part: What `part` returned.
            rows: Their indices, shape (R,); they are the first R rows of the part.
        """

    def restart(self) -> None:
        """Forget what lives through resets: the run starts again with another seed."""

    def state_dict(self) -> dict[str, AnyArray]:
        """Return copies of what lives through resets, for a checkpoint."""
        return {}

    def load_state_dict(self, state: Mapping[str, AnyArray]) -> None:
        """Go on from what `state_dict` returned; called before a reset."""

    def of_world(self) -> Mapping[str, Any]:
        """Return what plugins find by name in `World`."""
        return {}

    def of_view(self) -> Mapping[str, Callable[[Any], Any]]:
        """Return what plugins find by name in a `View`, each as a function of the view."""
        return {}

    def of_team(self) -> Mapping[str, Callable[[Any], Any]]:
        """Return what plugins find by name in a `TeamView`, each as a function of the view."""
        return {}

    def of_step(self) -> Mapping[str, Callable[[Any], Any]]:
        """Return what plugins find by name in a `Step`, each as a function of the step."""
        return {}

    def info(self, view: Any) -> dict[str, AnyArray]:
        """Return what the info of an agent holds of a state (a `View`), each of shape (R,)."""
        return {}

    def team_info(self, team: Any) -> dict[str, AnyArray]:
        """Return what the info of the whole team holds of a state (a `TeamView`), each of shape (N,)."""
        return {}

    def shared_state(self, team: Any) -> tuple[AnyArray, ...]:
        """Return what a critic of all agents sees of a state (a `TeamView`), each of shape (N, ...)."""
        return ()
