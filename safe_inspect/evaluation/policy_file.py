"""Files of policies: the metadata, the seal, and the comparison with a task.

The metadata are stored in the ONNX file as texts or JSON, so that any program that reads ONNX can find them. The last
entry is a hash of all bytes before it, which reveals damage; it can be appended because a Protocol Buffers message may
be extended by appending bytes.

Checkpoints, ONNX files, frozen policies and exports use the one comparison `check_layout`.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter

from safe_inspect.config.elements import (
    CommandedElement,
    ObservedElement,
    commanded_elements,
    difference_of,
    observed_elements,
)
from safe_inspect.config.spec import AgentSpec
from safe_inspect.errors import CheckpointError
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
