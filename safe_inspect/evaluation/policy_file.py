"""Files of policies: the elements of observation and action in SI units, the metadata, and the seal.

The elements map sensor readings to the network, and the network to the controllers. An exported policy contains the
normalisers of its glues. The task in which it runs must therefore have none: `raw_task` switches them off and changes
nothing else.

The metadata are stored in the ONNX file as texts or JSON, so that any program that reads ONNX can find them. The last
entry is a hash of all bytes before it, which reveals damage; it can be appended because a Protocol Buffers message may
be extended by appending bytes.

Checkpoints, ONNX files, frozen policies and exports use the one comparison `check_layout`. It compares the elements
from the policy's point of view: names and units, how the normalisers transform a reading, what a command means and
where it is clipped.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import ConfigDict, TypeAdapter

from safe_inspect.config.spec import AgentSpec, EnvironmentSpec
from safe_inspect.errors import CheckpointError, ConfigError, SafeInspectError, did_you_mean
from safe_inspect.glues.actions import CoastGlue, ControllerGlue, DiscreteControllerGlue
from safe_inspect.glues.base import ActionGlue, Glue, Parts, controller_of, sensor_of
from safe_inspect.glues.normalizers import Affine, Normalization
from safe_inspect.glues.observations import ObserveSensor
from safe_inspect.platforms.controllers import RateController
from safe_inspect.plugins.functor import describe
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.types import AnyArray, FloatArray
from safe_inspect.version import __version__

#: Unit of the element of an action that gives the number of control steps for which the action is held.
CONTROL_STEPS = "steps"

_OFF = Normalization(enabled=False)


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


def observed_elements(agent: AgentSpec, *, exportable: bool = True) -> tuple[ObservedElement, ...]:
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


def commanded_elements(agent: AgentSpec, *, exportable: bool = True) -> tuple[CommandedElement, ...]:
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


def raw_task(spec: EnvironmentSpec, agents: Iterable[str] | None = None) -> EnvironmentSpec:
    """Return the task with observations and actions in SI units; episodes, seeds and physics stay the same.

    Args:
        spec: The task.
        agents: Names of the agents; by default all agents without a scripted policy.

    Raises:
        SafeInspectError: There is no such agent.
    """
    outside = [agent.name for agent in spec.agents if agent.scripted_policy is None]
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


#: Versions of the layout of the metadata; the second is that of recurrent policies. Later versions are not read.
POLICY_FORMAT, RECURRENT_FORMAT = 1, 2

#: Prefix of the name of a state input that gives the name of the output with that state after the step.
NEXT_STATE = "next_"


# An entry of `ModelProto.metadata_props` (field 14): key "sha256", value 64 hexadecimal digits.
_SEAL = b"\x72\x4a\x0a\x06sha256\x12\x40"
_LENGTH = len(_SEAL) + 64


@dataclass(frozen=True)
class PolicyInfo:
    """Metadata of a policy's file.

    Attributes:
        policy: Name of the policy.
        agents: Names of the agents that it controlled in training.
        task: Name of the task.
        observation: Elements of the input `observation`.
        action: Elements of the output `thrust`.
        distribution: Content of the output `action_dist_inputs`. gaussian: means and logarithms of standard deviations;
            categorical: logits of the levels of each element, one element after the other; hurdle: the inputs of
            `Hurdle`; greedy: the values of the levels, of which the largest is always chosen.
        step_size: Length of a step [s].
        configuration: The resolved experiment.
        training: Known facts about the training: `steps`, `iteration`, `seconds`, `seed`, `git_commit`, `started`.
        version: Version of safe_inspect that wrote the file.
        state: Name and size of each state input of a recurrent policy. An episode starts with zeros; the outputs with
            the same names, prefixed with `NEXT_STATE`, contain the state for the next step.
    """

    policy: str
    agents: tuple[str, ...]
    task: str
    observation: tuple[ObservedElement, ...]
    action: tuple[CommandedElement, ...]
    distribution: Literal["gaussian", "categorical", "hurdle", "greedy"]
    step_size: float
    configuration: Mapping[str, Any]
    training: Mapping[str, Any] = field(default_factory=dict)
    version: str = __version__
    state: Mapping[str, int] = field(default_factory=dict)

    def metadata(self) -> dict[str, str]:
        """Return the metadata as texts."""
        texts = {"safe_inspect": self.version, "format": str(RECURRENT_FORMAT if self.state else POLICY_FORMAT)}
        for name in _ENTRIES if self.state else _ENTRIES[:-1]:
            value = getattr(self, name)
            texts[name] = value if name in _TEXTS else json.dumps(value, default=asdict)
        return texts

    @classmethod
    def of(cls, metadata: Mapping[str, str]) -> PolicyInfo:
        """Return the metadata of a file, parsed from its texts.

        Raises:
            KeyError: An entry is missing.
            ValueError: An entry has a wrong type or value.
        """
        texts = {"state": "{}", **metadata}
        content = {name: texts[name] if name in _TEXTS else json.loads(texts[name]) for name in _ENTRIES}
        return _INFO.validate_python({**content, "version": metadata["safe_inspect"]})


#: Entries of the metadata, in the order of the file, and those whose text is not JSON.
_TEXTS = ("task", "policy", "distribution")
_ENTRIES = (
    "task", "policy", "agents", "observation", "action", "distribution", "step_size", "training", "configuration",
    "state",
)  # fmt: skip
_INFO = TypeAdapter(PolicyInfo)


def seal(content: bytes) -> bytes:
    """Return the bytes of a file with their hash appended."""
    return content + _SEAL + hashlib.sha256(content).hexdigest().encode()


def read_file(path: str | os.PathLike[str]) -> tuple[bytes, bool]:
    """Return the bytes of a file, and whether they end with their hash.

    Raises:
        CheckpointError: The file cannot be read.
    """
    path = Path(path)
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise CheckpointError(f"{path}: there is no such file; write one with `safe-inspect export`") from None
    except OSError as error:
        raise CheckpointError(f"{path}: the file cannot be read ({error.strerror})") from None
    body, end = content[:-_LENGTH], content[-_LENGTH:]
    return content, end == _SEAL + hashlib.sha256(body).hexdigest().encode()


_TrainedElement = ObservedElement | CommandedElement

# A number that was converted from another unit differs in its last bits.
_RELATIVE, _ABSOLUTE = 1e-9, 1e-12


def check_layout(title: str, trained: PolicyInfo, agent: AgentSpec) -> None:
    """Raise an error for an agent whose observation or action differs from that of the policy's training.

    Args:
        title: Where the policy is stored, for the message.
        trained: The metadata of the policy.
        agent: The agent that the policy is to control.

    Raises:
        CheckpointError: They differ; the message names the first difference.
    """
    for what, theirs, mine in (
        ("observation", trained.observation, observed_elements(agent, exportable=False)),
        ("action", trained.action, commanded_elements(agent, exportable=False)),
    ):
        difference = difference_of(theirs, mine)
        if difference:
            raise CheckpointError(
                f"{title}: the policy is of another task ({trained.task}): in the {what} of {agent.name}, "
                f"{difference}; use the glues and controllers of its training (without --cfg and overrides a policy "
                "flies the task of its training), or train a policy for this task"
            )


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
