"""Initial states: reset parameters, the deputies' initialisers, the other bodies and the sun."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from safe_inspect.errors import InitialStateError
from safe_inspect.random.streams import Streams
from safe_inspect.simulators.resets.initializers import Initializer
from safe_inspect.simulators.resets.parameters import Draw, Parameter, SimAttributeAccessor, Value
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: States that are a deputy's own; all others that a parameter gives, such as the sun's angle, are the environment's.
OWN_STATES = ("position", "velocity", "orientation", "angular_velocity")
#: Draws of a further deputy that may start too near to those before it.
_MAX_DRAWS = 100

#: From the states of one deputy (R, ...), the index of the deputy and those of the deputies before it (R, d, 3) to the
#: rows that it refuses, by the reason.
TeamTest = Callable[[Mapping[str, FloatArray], int, Mapping[str, FloatArray]], dict[str, BoolArray]]

#: Takes the states of every body (R, ...) and the values that were drawn, both by name.
StartWatch = Callable[[Mapping[str, Mapping[str, FloatArray]], Mapping[str, Value]], None]


@dataclass(frozen=True)
class BodyReset:
    """The initial state of one body: an initialiser and the parameters that it takes."""

    initializer: Initializer
    parameters: Mapping[str, Parameter] = field(default_factory=dict)

    def __call__(self, draw: Draw) -> dict[str, FloatArray]:
        """Return the body's states, each with R rows."""
        taken = {**self.initializer.defaults, **self.parameters}
        return self.initializer({name: drawn(draw.child(name)) for name, drawn in taken.items()})

    @property
    def draws(self) -> bool:
        """Whether it draws anything itself, and does not take over reset parameters alone."""
        return any(not isinstance(item, SimAttributeAccessor) for item in self.parameters.values())

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of the reset parameters that the body takes."""
        taken = [item for item in self.parameters.values() if isinstance(item, SimAttributeAccessor)]
        return tuple(dict.fromkeys(item.attribute_name.partition(".")[0] for item in taken))


class EnvironmentDraw(NamedTuple):
    """A value of the environment that is drawn for a component: its name, the purpose of the draw and the parameter."""

    name: str
    purpose: str
    parameter: Parameter


@dataclass(frozen=True)
class ResetPlan:
    """What initial states are drawn from.

    A reset parameter that gives the states of a body is drawn for each deputy that takes it: the first has the draw
    itself, the others draws of their own, in which only what is the environment's (such as the sun's angle) stays. A
    parameter that gives one number is drawn once for all.

    Attributes:
        parameters: Reset parameters by name, drawn in order.
        deputies: Initial state of each deputy, by platform.
        entities: Initial state of each other body, by name.
        environment: What is drawn for components, such as ``sun_angle``.
        separation: Smallest distance of two deputies in an initial state [m].
        tests: Further tests of the states of a deputy against those of the deputies before it.
        watches: Called with the states of every body and the values that were drawn, at each reset.
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
            The states of every body by name; and the reset parameters with what the components draw, by name.

        Raises:
            InitialStateError: Two deputies begin too near to each other, and no draw can mend it.
        """
        first = next(iter(self.deputies.values()), None)
        lead = () if first is None else first.sources
        values: dict[str, Value] = {}
        for name, parameter in self.parameters.items():
            draw = Draw(streams, name, values=values)
            values[name] = parameter(self._tested(draw, 0, {}) if name in lead else draw)
        bodies: dict[str, dict[str, FloatArray]] = {}
        placed: dict[str, FloatArray] = {}
        for index, (name, body) in enumerate(self.deputies.items()):
            own = values if index == 0 else self._redrawn(streams, values, body, index, placed)
            bodies[name] = self._apart(body, Draw(streams, name, values=own), placed)
            self._check_apart(bodies[name], index, placed)
            placed = _joined(placed, bodies[name])
        bodies |= {name: body(Draw(streams, name, values=values)) for name, body in self.entities.items()}
        drawn = {item.name: item.parameter(Draw(streams, item.purpose, values=values)) for item in self.environment}
        for watch in self.watches:
            watch(bodies, values | drawn)
        return bodies, values | drawn

    def _redrawn(
        self,
        streams: Streams,
        values: dict[str, Value],
        body: BodyReset,
        index: int,
        placed: Mapping[str, FloatArray],
    ) -> dict[str, Value]:
        """Return the reset parameters with those that give a body's states drawn anew for a further deputy."""
        own = dict(values)
        for name in body.sources:
            base = values[name]
            if not isinstance(base, dict):
                continue
            shared = {state: array for state, array in base.items() if state not in OWN_STATES and "/" not in state}
            draw = Draw(streams, f"{name}@{index}", values=values, fixed=shared)
            drawn = self.parameters[name](self._tested(draw, index, placed))
            assert isinstance(drawn, dict), "a parameter always gives the same kind of value"
            own[name] = drawn
            for key in drawn:  # statistics of the draw: of all deputies together
                if "/" in key:
                    base[key] = base[key] + drawn[key] if key in base else drawn[key]
        return own

    def _apart(self, body: BodyReset, draw: Draw, placed: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return a body's states, drawn anew where it starts too near to those before it and draws of its own."""
        states = body(draw)
        if not placed or self.separation == 0.0:
            return states
        for attempt in range(1, _MAX_DRAWS if body.draws else 1):
            rows = np.flatnonzero(_too_near(states["position"], placed["position"], self.separation))
            if not len(rows):
                break
            values = {
                name: {key: array[rows] for key, array in value.items()} if isinstance(value, dict) else value[rows]
                for name, value in draw.values.items()
            }
            again = body(replace(draw, streams=draw.streams[rows], index=attempt, values=values))
            for name, array in again.items():
                states[name][rows] = array
        return states

    def _tested(self, draw: Draw, index: int, placed: Mapping[str, FloatArray]) -> Draw:
        if not self.tests and (self.separation == 0.0 or not placed):
            return draw

        def refusals(states: Mapping[str, FloatArray], rows: IntArray) -> dict[str, BoolArray]:
            before = {name: array[rows] for name, array in placed.items()}
            refused = {}
            if placed and self.separation > 0.0:
                refused["separation"] = _too_near(states["position"], before["position"], self.separation)
            for test in self.tests:
                for name, unsafe in test(states, index, before).items():
                    refused[name] = refused[name] | unsafe if name in refused else unsafe
            return refused

        return replace(draw, test=refusals)

    def _check_apart(self, states: Mapping[str, FloatArray], index: int, placed: Mapping[str, FloatArray]) -> None:
        if not placed or self.separation == 0.0:
            return
        near = _too_near(states["position"], placed["position"], self.separation)
        if near.any():
            names = list(self.deputies)
            raise InitialStateError(
                f"{names[index]} starts closer than {self.separation:g} m to {' or '.join(names[:index])} in "
                f"{int(near.sum())} of {len(near)} environments; give each deputy an initial state of its own"
            )


def _too_near(position: FloatArray, others: FloatArray, separation: float) -> BoolArray:
    """Return the rows in which a position (R, 3) is closer to one of others (R, d, 3) than the separation [m]."""
    x, y, z = (others[:, :, axis] - position[:, None, axis] for axis in range(3))
    return np.asarray((x * x + y * y + z * z < separation * separation).any(axis=1))


def _joined(placed: Mapping[str, FloatArray], states: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    return {
        name: np.concatenate((placed[name], states[name][:, None]), axis=1) if placed else states[name][:, None]
        for name in OWN_STATES
        if name in states
    }
