"""How an episode begins: reset parameters, the deputies' initialisers, the other bodies and the sun."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from safe_inspect.randomness import Streams
from safe_inspect.simulators.initializers import Initializer
from safe_inspect.simulators.parameters import Draw, Parameter, Value
from safe_inspect.types import FloatArray


@dataclass(frozen=True)
class BodyReset:
    """The initial state of one body: an initialiser and the parameters that it takes."""

    initializer: Initializer
    parameters: Mapping[str, Parameter] = field(default_factory=dict)

    def __call__(self, draw: Draw) -> dict[str, FloatArray]:
        """Return the body's states, each with R rows."""
        return self.initializer({name: drawn(draw.child(name)) for name, drawn in self.parameters.items()})


@dataclass(frozen=True)
class ResetPlan:
    """How every episode begins.

    Attributes:
        parameters: Reset parameters by name, drawn in order.
        deputies: Initial state of each deputy, by platform.
        entities: Initial state of each other body, by name.
        sun_angle: Initial angle of the sun [rad]; None: 0.
    """

    parameters: Mapping[str, Parameter]
    deputies: Mapping[str, BodyReset]
    entities: Mapping[str, BodyReset]
    sun_angle: Parameter | None = None

    def draw(self, streams: Streams) -> tuple[dict[str, dict[str, FloatArray]], FloatArray, dict[str, Value]]:
        """Draw the beginning of R episodes.

        Returns:
            The states of every body by name, the sun's angle (R,), and the reset parameters.
        """
        values: dict[str, Value] = {}
        for name, parameter in self.parameters.items():
            values[name] = parameter(Draw(streams, name, values=values))
        bodies = {
            name: body(Draw(streams, name, values=values)) for name, body in {**self.deputies, **self.entities}.items()
        }
        sun = np.zeros(len(streams)) if self.sun_angle is None else self.sun_angle(Draw(streams, "sun", values=values))
        assert not isinstance(sun, dict), "the environment's check admits scalar parameters only"
        return bodies, sun, values
