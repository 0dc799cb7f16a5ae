"""The contract of what an episode begins with: parameters, initialisers, simulators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from safe_inspect.config.spec import AgentSpec
from safe_inspect.dones.time_limit import EpisodeLengthDone
from safe_inspect.glues.base import ActionGlue
from safe_inspect.platforms.base import Part, Sensor
from safe_inspect.platforms.state_sensors import PositionSensor, VelocitySensor
from safe_inspect.random.streams import Streams
from safe_inspect.simulators.resets.initializers import Initializer
from safe_inspect.simulators.resets.parameters import Draw, Parameter
from safe_inspect.simulators.simulator import Simulator
from safe_inspect.testing.calls import Call, Inputs, Shape, check_call
from safe_inspect.testing.flights import fly_twice
from safe_inspect.testing.report import Report
from safe_inspect.testing.samples import DEPUTIES, sample_spec, sample_steps
from safe_inspect.testing.values import spread
from safe_inspect.types import AnyArray, FloatArray

_ROWS = 48
#: Where drawn values lie, by their SI unit.
_RANGES = {"m": (50.0, 100.0), "m/s": (0.0, 0.3), "rad": (-1.5, 6.28)}


def check_parameter(plugin: Parameter, parts: Sequence[Part], report: Report) -> None:
    """Check a reset parameter: a number for each row, (R,), or named states."""
    states, slots = _states(), np.arange(_ROWS)

    def make(rows: AnyArray) -> Inputs:
        given = {name: array[rows].copy() for name, array in states.items()}
        streams = Streams(12345, slots[rows] % 7, slots[rows])
        return Inputs((Draw(streams, "sample", values={"init_state": given}),), given)

    check_call(Call("the parameter", plugin, make, _ROWS, Shape(None, "f", "(R,)"), shapes={"": Shape()}), report)


def check_initializer(plugin: Initializer, parts: Sequence[Part], report: Report) -> None:
    """Check an initialiser: named states with R rows, those of `gives` among them."""
    states, slots = _states(), np.arange(_ROWS)
    draw = Draw(Streams(12345, slots, slots), "sample")
    defaults: dict[str, Any] = {name: parameter(draw.child(name)) for name, parameter in plugin.defaults.items()}
    drawn: dict[str, FloatArray | None] = {}
    for index, (name, symbol) in enumerate(plugin.parameters.items()):
        low, high = _RANGES.get(symbol or "", (0.1, 1.0))
        values = spread(np.array([low]), np.array([high]), _ROWS)[:, 0]
        drawn[name] = None if symbol is None else np.roll(values, index)

    def make(rows: AnyArray) -> Inputs:
        taken = {name: array[rows].copy() for name, array in states.items()}
        given = {name: taken if array is None else array[rows].copy() for name, array in drawn.items()}
        given |= {
            name: {key: array[rows] for key, array in value.items()} if isinstance(value, dict) else value[rows]
            for name, value in defaults.items()
        }
        arrays = {name: array for name, array in given.items() if isinstance(array, np.ndarray)}
        return Inputs((given,), {**taken, **arrays})

    shapes = {"position": Shape((3,), "f", "(R, 3)"), "velocity": Shape((3,), "f", "(R, 3)")}
    call = Call("the initialiser", plugin, make, _ROWS, Shape(None, "f", "(R, ...)"), shapes)
    result = check_call(call, report)
    if result is not None:
        for name in plugin.gives:
            report.expect(
                name in result,
                "gives",
                f"`gives` names the state {name!r}, which is not returned",
                "return it, or drop it",
            )


def check_simulator(plugin: Simulator, parts: Sequence[Part], report: Report) -> None:
    """Check a simulator: an environment alone goes the way that it goes in a batch."""
    with report.attempt("the simulator"):
        for deputies in (1, DEPUTIES):
            spec = replace(sample_spec(deputies=deputies), simulator=plugin)
            if not any(component.bodies for component in plugin.compose()[1]):
                spec = replace(spec, agents=tuple(map(_without_task, spec.agents)))
            for together, alone in fly_twice(spec):
                whole, single = together.step.after.state.arrays, alone.step.after.state.arrays
                for name, array in single.items():
                    if array.tobytes() != whole[name].tobytes():
                        report.add(
                            "row-wise",
                            f"after {alone.step.after.step[0]} steps `{name}` differs alone from what it is in a batch",
                            "compute each row from itself",
                        )
                        return


def _without_task(agent: AgentSpec) -> AgentSpec:
    """Return an agent that sees where it is and flies, for simulators without points to inspect."""
    parts = {
        name: part
        for name, part in agent.parts.items()
        if isinstance(part, PositionSensor | VelocitySensor) or not isinstance(part, Sensor)
    }
    glues = tuple(
        glue for glue in agent.glues if isinstance(glue, ActionGlue) or getattr(glue, "sensor", None) in parts
    )
    dones = tuple(named for named in agent.dones if isinstance(named.functor, EpisodeLengthDone))
    return replace(agent, parts=parts, glues=glues, rewards=(), dones=dones)


def _states() -> dict[str, FloatArray]:
    view = sample_steps(None, _ROWS).after
    return {"position": view.position.copy(), "velocity": view.velocity.copy(), "sun_angle": view.sun_angle.copy()}
