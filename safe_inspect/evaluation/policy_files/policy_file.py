"""What a policy's file says of it, and the seal that shows damage.

It stands in the file's metadata, as texts or JSON, so that any program that reads ONNX finds them. The last entry
of the metadata is a hash of all bytes before it: a message of Protocol Buffers may be continued by appending to it.
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

#: Of the layout of the metadata; a file of a later one is not read. Files of recurrent policies have the second.
POLICY_FORMAT, RECURRENT_FORMAT = 1, 2

#: Before the name of an input of the state stands this in the name of the output that holds it after the step.
NEXT_STATE = "next_"

#: Names of the distributions that `PolicyInfo` may tell of.
DISTRIBUTIONS = ("gaussian", "categorical", "hurdle", "greedy")

# An entry of `ModelProto.metadata_props` (field 14): key "sha256", value 64 hexadecimal digits.
_SEAL = b"\x72\x4a\x0a\x06sha256\x12\x40"
_LENGTH = len(_SEAL) + 64


@dataclass(frozen=True)
class PolicyInfo:
    """What a policy's file says about it.

    Attributes:
        policy: Name of the policy.
        agents: Names of the agents that it flew in training.
        task: Name of the task.
        observation: Elements of the input `observation`.
        action: Elements of the output `thrust`.
        distribution: What the output `action_dist_inputs` holds: means and logarithms of standard deviations; logits
            of the levels of each element, one element behind the other; what `Hurdle` takes; or the values of the
            levels, the largest of which is flown, never another.
        step_size: Length of a step [s].
        configuration: The resolved experiment.
        training: What is known of the training: `steps`, `iteration`, `seconds`, `seed`, `git_commit`, `started`.
        version: The safe_inspect that wrote the file.
        state: Of a recurrent policy, the inputs that hold its state, and the size of each. Zeros begin an episode; the
            outputs of the same names behind `NEXT_STATE` hold the state for the next step.
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
        """Return it as texts."""
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
        """Return what a file's metadata say; KeyError, TypeError or ValueError: they are not there, or wrong."""
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
    """Return a file's bytes with their hash behind them."""
    return content + _SEAL + hashlib.sha256(content).hexdigest().encode()


def read_file(path: str | os.PathLike[str]) -> tuple[bytes, bool]:
    """Return the bytes of a file, and whether they end with their hash.

    Raises:
        CheckpointError: It cannot be read.
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
