"""Metadata of a policy's file, and the seal that reveals damage.

The metadata are stored in the ONNX file as texts or JSON, so that any program that reads ONNX can find them. The last
entry is a hash of all bytes before it; it can be appended because a Protocol Buffers message may be extended by
appending bytes.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from safe_inspect.errors import CheckpointError
from safe_inspect.evaluation.policy_files.raw_values import CommandedElement, ObservedElement, plain_elements
from safe_inspect.version import __version__

#: Versions of the layout of the metadata; the second is that of recurrent policies. Later versions are not read.
POLICY_FORMAT, RECURRENT_FORMAT = 1, 2

#: Prefix of the name of a state input that gives the name of the output with that state after the step.
NEXT_STATE = "next_"

#: Names of the distributions that `PolicyInfo.distribution` may have.
DISTRIBUTIONS = ("gaussian", "categorical", "hurdle", "greedy")

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
            "observation": json.dumps(plain_elements(self.observation)),
            "action": json.dumps(plain_elements(self.action)),
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
            TypeError: An entry has a wrong type.
            ValueError: An entry has a wrong value.
        """
        if metadata["distribution"] not in DISTRIBUTIONS:
            raise ValueError(f"unknown distribution {metadata['distribution']!r}")
        observation: list[dict[str, Any]]
        action: list[dict[str, Any]]
        observation, action = (
            [{key: tuple(value) if isinstance(value, list) else value for key, value in item.items()} for item in items]
            for items in (json.loads(metadata["observation"]), json.loads(metadata["action"]))
        )
        return cls(
            policy=metadata["policy"],
            agents=tuple(json.loads(metadata["agents"])),
            task=metadata["task"],
            observation=tuple(ObservedElement(**item) for item in observation),
            action=tuple(CommandedElement(**item) for item in action),
            distribution=metadata["distribution"],  # type: ignore[arg-type]
            step_size=float(metadata["step_size"]),
            configuration=json.loads(metadata["configuration"]),
            training=json.loads(metadata["training"]),
            version=metadata["safe_inspect"],
            state={name: int(size) for name, size in json.loads(metadata.get("state", "{}")).items()},
        )


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
