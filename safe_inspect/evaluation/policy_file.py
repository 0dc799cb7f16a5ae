"""Metadata of a policy's file, the seal that reveals damage, and the comparison of its layout with that of a task.

The metadata are stored in the ONNX file as texts or JSON, so that any program that reads ONNX can find them. The last
entry is a hash of all bytes before it; it can be appended because a Protocol Buffers message may be extended by
appending bytes.

Checkpoints, ONNX files, frozen policies and exports use the one comparison `check_layout`. It compares the elements
from the policy's point of view: names and units, how the normalisers transform a reading, what a command means and
where it is clipped.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import TypeAdapter

from safe_inspect.config.spec import AgentSpec
from safe_inspect.errors import CheckpointError
from safe_inspect.evaluation.raw_values import (
    CommandedElement,
    ObservedElement,
    commanded_elements,
    observed_elements,
)
from safe_inspect.version import __version__

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
        told = {
            "safe_inspect": self.version,
            "format": str(RECURRENT_FORMAT if self.state else POLICY_FORMAT),
            "task": self.task,
            "policy": self.policy,
            "agents": json.dumps(self.agents),
            "observation": json.dumps([asdict(element) for element in self.observation]),
            "action": json.dumps([asdict(element) for element in self.action]),
            "distribution": self.distribution,
            "step_size": repr(float(self.step_size)),
            "training": json.dumps(self.training),
            "configuration": json.dumps(self.configuration),
        }
        return {**told, "state": json.dumps(self.state)} if self.state else told

    @classmethod
    def of(cls, metadata: Mapping[str, str]) -> PolicyInfo:
        """Return the metadata of a file, parsed from its texts.

        Raises:
            KeyError: An entry is missing.
            ValueError: An entry has a wrong type or value.
        """
        content: dict[str, Any] = {name: metadata[name] for name in ("task", "policy", "distribution")}
        content |= {name: json.loads(metadata[name]) for name in _JSON}
        content |= {"version": metadata["safe_inspect"], "state": json.loads(metadata.get("state", "{}"))}
        return _INFO.validate_python(content)


#: Entries of the metadata whose text is JSON.
_JSON = ("agents", "observation", "action", "step_size", "training", "configuration")
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
        if _axis(old) and _axis(old) != _axis(new):  # files of early versions name no axis
            return f"{old.name} acts along {_axis(old)} in training and along {_axis(new) or 'no axis'} in the task"
        mine, theirs = _numbers(old), _numbers(new)
        alike = len(mine) == len(theirs) and np.allclose(mine, theirs, rtol=_RELATIVE, atol=_ABSOLUTE)
        if _chooses(old) != _chooses(new) or not alike:
            return f"{old.name} {_meaning(old)} in training and {_meaning(new)} in the task"
        if bool(old.plugins) != bool(new.plugins) or not set(new.plugins) <= set(old.plugins):
            return f"{old.name} comes from {_short(old)} in training and from {_short(new)} in the task"
    return ""


def _axis(element: _TrainedElement) -> str:
    return element.axis if isinstance(element, CommandedElement) else ""


def _chooses(element: _TrainedElement) -> bool:
    return isinstance(element, CommandedElement) and bool(element.levels)


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
