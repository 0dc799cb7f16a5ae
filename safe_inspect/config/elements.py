"""Elements of an agent's observation and action in SI units, from sensors to a network and on to controllers.

An exported policy contains the normalisers of its glues. The task in which it runs must therefore have none: `raw_task`
switches them off and changes nothing else. Policies are compared by these elements from the policy's point of view:
names and units, how the normalisers transform a reading, what a command means and where it is clipped.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import ConfigDict

from safe_inspect.config.spec import AgentSpec, EnvironmentSpec
from safe_inspect.errors import ConfigError, SafeInspectError, did_you_mean
from safe_inspect.glues.actions import CoastGlue, ControllerGlue, DiscreteControllerGlue
from safe_inspect.glues.base import ActionGlue, Glue, Parts, controller_of, sensor_of
from safe_inspect.glues.normalizers import Affine, Normalization
from safe_inspect.glues.observations import ObserveSensor
from safe_inspect.platforms.controllers import RateController
from safe_inspect.plugins.functor import describe
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.types import AnyArray, FloatArray

#: Unit of the element of an action that gives the number of control steps for which the action is held.
CONTROL_STEPS = "steps"

_OFF = Normalization(enabled=False)

# A number that was converted from another unit differs in its last bits.
_RELATIVE, _ABSOLUTE = 1e-9, 1e-12


@dataclass(frozen=True)
class _Element:
    """Common part of the elements of the observation and of the action."""

    __pydantic_config__ = ConfigDict(extra="forbid")  # a later version may mean something by a key that is unknown here

    name: str
    unit: str

    def __str__(self) -> str:
        return f"{self.name} [{self.unit or '-'}]"


@dataclass(frozen=True)
class ObservedElement(_Element):
    """An element of the observation: the network receives (value - centre) / width.

    Attributes:
        name: Its name, ``sensor.element``.
        unit: SI unit of the value; empty for a pure number.
        centre: The value that the network receives as 0.
        width: The change of the value that the network receives as 1.
        plugins: The configuration, as JSON, of a glue or normaliser that is not part of this package; if several agents
            share a policy, all that occur.
    """

    centre: float = 0.0
    width: float = 1.0
    plugins: tuple[str, ...] = ()


@dataclass(frozen=True)
class CommandedElement(_Element):
    """An element of the action: a controller receives offset + gain * action within [low, high], or one of the levels.

    Attributes:
        name: Its name, which is the controller's.
        unit: SI unit of the value.
        low: Smallest value.
        high: Largest value.
        gain: Factor of the action.
        offset: Value for an action of 0.
        levels: The values among which the policy chooses; empty if any value is allowed.
        axis: Axis of Hill's frame along which the value acts, ``x``, ``y`` or ``z``; empty if it is unknown.
        plugins: The configuration, as JSON, of a glue, normaliser or controller that is not part of this package; if
            several agents share a policy, all that occur.
    """

    low: float
    high: float
    gain: float = 1.0
    offset: float = 0.0
    levels: tuple[float, ...] = ()
    axis: str = ""
    plugins: tuple[str, ...] = ()


def observed_elements(agent: AgentSpec, *, exportable: bool) -> tuple[ObservedElement, ...]:
    """Return the elements of an agent's observation, in order, with the effect of their normalisers.

    The elements of a glue that is not an `ObserveSensor` are taken unchanged.

    Args:
        agent: The agent.
        exportable: Whether to raise an error for a normaliser that is not part of this package; else its configuration
            is put in `ObservedElement.plugins`.

    Raises:
        ConfigError: A normaliser is not part of this package.
    """
    found: list[ObservedElement] = []
    for glue in agent.observation_glues:
        names, symbol = glue.names(agent.parts), ""
        centre, width, plugins = np.zeros(len(names)), np.ones(len(names)), _configuration(glue)
        if isinstance(glue, ObserveSensor):
            sensor = sensor_of(agent.parts, glue.sensor)
            symbol, (scale, _, low, high) = sensor.symbol, glue.prepared(sensor)
            affine = glue.normalization.affine(low, high)
            if exportable or affine is not None:
                gain, offset = _gain_and_offset(agent, glue, affine, low.shape)
                centre, width, plugins = -offset / gain / scale + 0.0, 1.0 / gain / scale, ()
        rows = zip(names, centre.tolist(), width.tolist(), strict=True)
        found += [ObservedElement(name, symbol, at, by, plugins) for name, at, by in rows]
    return tuple(found)


def commanded_elements(agent: AgentSpec, *, exportable: bool) -> tuple[CommandedElement, ...]:
    """Return the elements of an agent's action, in order.

    Args:
        agent: The agent.
        exportable: See `observed_elements`.

    Raises:
        ConfigError: A normaliser is not part of this package, or a glue of another package chooses among levels.
    """
    return tuple(element for glue in agent.action_glues for element in _commanded(agent, glue, exportable))


def _commanded(agent: AgentSpec, glue: Glue, exportable: bool) -> list[CommandedElement]:
    assert isinstance(glue, ActionGlue)
    if isinstance(glue, SafetyGlue):
        return [element for inner in glue.wrapped for element in _commanded(agent, inner, exportable)]
    names = glue.names(agent.parts)
    if isinstance(glue, CoastGlue):
        durations = tuple(float(steps) for steps in glue.durations)
        return [CommandedElement(names[0], CONTROL_STEPS, durations[0], durations[-1], levels=durations)]
    if isinstance(glue, DiscreteControllerGlue):
        unit, axis, plugins, low, high = _controller(agent.parts, glue.controller)
        levels = tuple(float(level) for level in glue.levels)
        limits = float(low[0]), float(high[0])
        return [CommandedElement(names[0], unit, *limits, levels=levels, axis=axis, plugins=plugins)]
    if isinstance(glue, ControllerGlue):
        unit, axis, plugins, low, high = _controller(agent.parts, glue.controller)
        affine = glue.normalization.affine(low, high)
        if exportable or affine is not None:
            gain, offset = _gain_and_offset(agent, glue, affine, low.shape)
            pairs = zip(low.tolist(), high.tolist(), (1.0 / gain).tolist(), (-offset / gain).tolist(), strict=True)
            return [
                CommandedElement(name, unit, least, most, by, at + 0.0, axis=axis, plugins=plugins)
                for name, (least, most, by, at) in zip(names, pairs, strict=True)
            ]
    if exportable and any(glue.choices(agent.parts)):
        raise ConfigError(
            f"{_title(agent, glue)}: the meaning of its choices is unknown outside the glue; use DiscreteControllerGlue"
        )
    low, high = glue.bounds(agent.parts)
    rows = zip(names, low.tolist(), high.tolist(), strict=True)
    return [CommandedElement(name, "", least, most, plugins=_configuration(glue)) for name, least, most in rows]


def _controller(parts: Parts, name: str) -> tuple[str, str, tuple[str, ...], FloatArray, FloatArray]:
    """Return unit, axis, configuration and limits of a controller's values.

    The configuration is empty for controllers of this package.
    """
    controller = controller_of(parts, name)
    if isinstance(controller, RateController):
        return controller.commanded.symbol, "xyz"[controller.axis % 3], (), *controller.limits
    return "", "", _configuration(controller), *controller.limits


def _configuration(plugin: Plugin) -> tuple[str, ...]:
    return (json.dumps(describe(plugin), sort_keys=True),)


def _gain_and_offset(
    agent: AgentSpec, glue: ObserveSensor | ControllerGlue, affine: Affine | None, shape: tuple[int, ...]
) -> tuple[FloatArray, FloatArray]:
    """Return gain and offset of a glue's normaliser, normalised = gain * value + offset, each of shape (k,)."""
    if affine is not None:
        return np.broadcast_to(affine.gain, shape), np.broadcast_to(affine.offset, shape)
    raise ConfigError(
        f"{_title(agent, glue)}: a file cannot contain the normaliser {glue.normalization.normalizer}; train with "
        "StandardNormalNormalizer, LinearNormalizer or `normalization: {enabled: False}` to export the policy"
    )


def _title(agent: AgentSpec, glue: Glue) -> str:
    return f"{agent.name}, glue {glue.registered_name} ({', '.join(glue.names(agent.parts))})"


def raw_task(spec: EnvironmentSpec, agents: Iterable[str] | None) -> EnvironmentSpec:
    """Return the task with observations and actions in SI units; episodes, seeds and physics stay the same.

    Args:
        spec: The task.
        agents: Names of the agents; None for all agents without a scripted policy.

    Raises:
        SafeInspectError: There is no such agent.
    """
    outside = [agent.name for agent in spec.controlled]
    chosen = outside if agents is None else list(agents)
    for name in chosen:
        if name not in outside:
            raise SafeInspectError(f"no controlled agent is named {name!r}; {did_you_mean(name, outside)}")
    return replace(
        spec,
        agents=tuple(
            replace(agent, glues=tuple(_raw(glue) for glue in agent.glues)) if agent.name in chosen else agent
            for agent in spec.agents
        ),
    )


def _raw(glue: Glue) -> Glue:
    if isinstance(glue, ObserveSensor):
        return ObserveSensor(sensor=glue.sensor, normalization=_OFF)
    if isinstance(glue, (ControllerGlue, DiscreteControllerGlue)):
        return ControllerGlue(controller=glue.controller, normalization=_OFF)
    if isinstance(glue, SafetyGlue):  # a new object, as a copy would keep the glue's cached results
        fields = {name: getattr(glue, name) for name in type(glue).model_fields}
        return type(glue)(**{**fields, "wrapped": tuple(_raw(inner) for inner in glue.wrapped)})
    return glue


def element_columns(elements: Iterable[ObservedElement | CommandedElement], field: str) -> AnyArray:
    """Return one field of all elements, float64, shape (size,)."""
    return np.array([getattr(element, field) for element in elements], dtype=np.float64)


_TrainedElement = ObservedElement | CommandedElement


def difference_of(trained: Sequence[_TrainedElement], task: Sequence[_TrainedElement]) -> str:
    """Return the first difference between the elements of training and those of a task; empty if there is none."""
    for index, (old, new) in enumerate(zip(trained, task, strict=False)):
        # "" and "-" both mean that there is no unit.
        if (old.name, old.unit.strip("-")) != (new.name, new.unit.strip("-")):
            return f"element {index} is {old} in training and {new} in the task"
    if len(trained) != len(task):
        return f"there are {len(trained)} elements in training and {len(task)} in the task"
    for old, new in zip(trained, task, strict=True):
        axis, other = (getattr(element, "axis", "") for element in (old, new))
        if axis and axis != other:  # files of early versions name no axis
            return f"{old.name} acts along {axis} in training and along {other or 'no axis'} in the task"
        mine, theirs = _numbers(old), _numbers(new)
        alike = len(mine) == len(theirs) and np.allclose(mine, theirs, rtol=_RELATIVE, atol=_ABSOLUTE)
        if bool(getattr(old, "levels", ())) != bool(getattr(new, "levels", ())) or not alike:
            return f"{old.name} {_meaning(old)} in training and {_meaning(new)} in the task"
        if bool(old.plugins) != bool(new.plugins) or not set(new.plugins) <= set(old.plugins):
            return f"{old.name} comes from {_short(old)} in training and from {_short(new)} in the task"
    return ""


def _numbers(element: _TrainedElement) -> tuple[float, ...]:
    if isinstance(element, ObservedElement):
        return element.centre, element.width
    return element.levels or (element.low, element.high, element.gain, element.offset)


def _meaning(element: _TrainedElement) -> str:
    if isinstance(element, ObservedElement):
        return f"is seen as (value - {element.centre:.10g}) / {element.width:.10g}"
    if element.levels:
        return f"has the levels [{', '.join(f'{level:.10g}' for level in element.levels)}] {element.unit}"
    limits = f"[{element.low:.10g}, {element.high:.10g}] {element.unit or '-'}"
    return f"commands {element.offset:.10g} + {element.gain:.10g} a within {limits}"


def _short(element: _TrainedElement) -> str:
    text = " or ".join(element.plugins) or "this package's plugins"
    return text if len(text) <= 200 else f"{text[:197]}..."
