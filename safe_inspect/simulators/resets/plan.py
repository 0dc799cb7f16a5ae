"""Initial states: reset parameters, the deputies' initialisers, the other bodies and the sun."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from safe_inspect.errors import InitialStateError
from safe_inspect.random.streams import Streams
from safe_inspect.simulators.resets.initializers import Initializer
from safe_inspect.simulators.resets.parameters import Draw, Parameter, SimAttributeAccessor, Value, either
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: States that belong to a deputy; all other states of a parameter, such as the sun's angle, belong to the environment.
OWN_STATES = ("position", "velocity", "orientation", "angular_velocity")
#: Maximum number of draws for a deputy that starts too close to the preceding ones.
_MAX_DRAWS = 100

#: Function of the states of one deputy (R, ...), the index of the deputy and the states of the preceding deputies
#: (R, d, 3); it returns masks of the rows to reject, by reason.
TeamTest = Callable[[Mapping[str, FloatArray], int, Mapping[str, FloatArray]], dict[str, BoolArray]]

#: Function of the states of every body (R, ...) and of the drawn values, both by name.
StartWatch = Callable[[Mapping[str, Mapping[str, FloatArray]], Mapping[str, Value]], None]


@dataclass(frozen=True)
class BodyReset:
    """The initial state of one body: an initialiser and the parameters that it needs."""

    initializer: Initializer
    parameters: Mapping[str, Parameter] = field(default_factory=dict)

    def __call__(self, draw: Draw) -> dict[str, FloatArray]:
        """Return the body's states, each with R rows."""
        taken = {**self.initializer.defaults, **self.parameters}
        return self.initializer({name: drawn(draw.child(name)) for name, drawn in taken.items()})

    @property
    def draws(self) -> bool:
        """Whether the body draws values itself, instead of only using reset parameters."""
        return any(not isinstance(item, SimAttributeAccessor) for item in self.parameters.values())

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of the reset parameters that the body uses."""
        taken = [item for item in self.parameters.values() if isinstance(item, SimAttributeAccessor)]
        return tuple(dict.fromkeys(item.attribute_name.partition(".")[0] for item in taken))


class EnvironmentDraw(NamedTuple):
    """A value of the environment that is drawn for a component: its name, the purpose of the draw and the parameter."""

    name: str
    purpose: str
    parameter: Parameter


@dataclass(frozen=True)
class ResetPlan:
    """The parameters and initialisers from which initial states are drawn.

    A reset parameter whose value is the state of a body is drawn separately for each deputy that uses it: the first
    deputy has the first draw, and the others have further draws with the same values of the environment (such as the
    sun's angle). A parameter whose value is one number is drawn once for all deputies.

    Attributes:
        parameters: Reset parameters by name, drawn in order.
        deputies: Initial state of each deputy, by platform.
        entities: Initial state of each other body, by name.
        environment: Values that are drawn for components, such as ``sun_angle``.
        separation: Minimum distance between two deputies in an initial state [m].
        tests: Further tests of the states of a deputy against those of the preceding deputies.
        watches: Functions that are called at each reset with the states of every body and the drawn values.
    """

    parameters: Mapping[str, Parameter]
    deputies: Mapping[str, BodyReset]
    entities: Mapping[str, BodyReset]
    environment: tuple[EnvironmentDraw, ...] = ()
    separation: float = 0.0
    tests: tuple[TeamTest, ...] = ()
    watches: tuple[StartWatch, ...] = ()

    def draw(self, streams: Streams) -> tuple[dict[str, dict[str, FloatArray]], dict[str, Value]]:
        """Draw the initial states of R episodes.

        Returns:
            The states of every body by name; and the reset parameters together with the components' draws, by name.

        Raises:
            InitialStateError: Two deputies start too close to each other, and no further draw can fix it.
        """
        first = next(iter(self.deputies.values()), None)
        lead = () if first is None else first.sources
        values: dict[str, Value] = {}
        for name, parameter in self.parameters.items():
            draw = Draw(streams, name, values=values)
            values[name] = parameter(self.tested(draw) if name in lead else draw)
        bodies: dict[str, dict[str, FloatArray]] = {}
        placed: dict[str, FloatArray] = {}
        for index, (name, body) in enumerate(self.deputies.items()):
            own = values if index == 0 else self._redrawn(streams, values, body, index, placed)
            bodies[name] = self._apart(body, index, Draw(streams, name, values=own), placed)
            placed = _joined(placed, bodies[name])
        bodies |= {name: body(Draw(streams, name, values=values)) for name, body in self.entities.items()}
        drawn = {item.name: item.parameter(Draw(streams, item.purpose, values=values)) for item in self.environment}
        for watch in self.watches:
            watch(bodies, values | drawn)
        return bodies, values | drawn

    def _redrawn(
        self, streams: Streams, values: dict[str, Value], body: BodyReset, index: int, placed: Mapping[str, FloatArray]
    ) -> dict[str, Value]:
        """Return the reset parameters for a further deputy, with new draws of those whose value is a body's state."""
        own = dict(values)
        for name in body.sources:
            base = values[name]
            if not isinstance(base, dict):
                continue
            shared = {state: array for state, array in base.items() if state not in OWN_STATES and "/" not in state}
            draw = Draw(streams, f"{name}@{index}", values=values, fixed=shared)
            drawn = self.parameters[name](self.tested(draw, index, placed))
            assert isinstance(drawn, dict), "a parameter always returns the same kind of value"
            own[name] = drawn
            for key in drawn:  # sum the statistics of the draw over all deputies
                if "/" in key:
                    base[key] = base[key] + drawn[key] if key in base else drawn[key]
        return own

    def _apart(
        self, body: BodyReset, index: int, draw: Draw, placed: Mapping[str, FloatArray]
    ) -> dict[str, FloatArray]:
        """Return a body's states; rows that are too close to preceding bodies are drawn again if the body draws.

        Raises:
            InitialStateError: Some are still too close.
        """
        states = body(draw)
        if not placed or self.separation == 0.0:
            return states
        for attempt in range(1, _MAX_DRAWS + 1):
            rows = np.flatnonzero(_too_near(states["position"], placed["position"], self.separation))
            if not len(rows):
                return states
            if attempt == _MAX_DRAWS or not body.draws:
                break
            for name, array in body(draw.part(rows, attempt)).items():
                states[name][rows] = array
        names = list(self.deputies)
        raise InitialStateError(
            f"{names[index]} starts closer than {self.separation:g} m to {' or '.join(names[:index])} in "
            f"{len(rows)} of {len(states['position'])} environments; give each deputy its own initial state"
        )

    def tested(self, draw: Draw, index: int = 0, placed: Mapping[str, FloatArray] | None = None) -> Draw:
        """Return the draw of a deputy's states, with the plan's tests and the distance to other deputies.

        Args:
            draw: The draw.
            index: Index of the deputy.
            placed: Stacked states of the deputies that are drawn before it, by name; None for the first one.
        """
        placed = {} if placed is None else placed
        if not self.tests and (self.separation == 0.0 or not placed):
            return draw

        def refusals(states: Mapping[str, FloatArray], rows: IntArray) -> dict[str, BoolArray]:
            before = {name: array[rows] for name, array in placed.items()}
            refused: dict[str, BoolArray] = {}
            if placed and self.separation > 0.0:
                refused["separation"] = _too_near(states["position"], before["position"], self.separation)
            for test in self.tests:
                refused = either(refused, test(states, index, before))
            return refused

        return replace(draw, test=refusals)


def _too_near(position: FloatArray, others: FloatArray, separation: float) -> BoolArray:
    """Return a mask of rows in which a position (R, 3) is closer than the separation [m] to one of others (R, d, 3)."""
    x, y, z = (others[:, :, axis] - position[:, None, axis] for axis in range(3))
    return np.asarray((x * x + y * y + z * z < separation * separation).any(axis=1))


def _joined(placed: Mapping[str, FloatArray], states: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    return {
        name: np.concatenate((placed[name], states[name][:, None]), axis=1) if placed else states[name][:, None]
        for name in OWN_STATES
        if name in states
    }
