"""The policies of a checkpoint, for the agents of a task. Ray and Torch are loaded only with a policy."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from safe_inspect.config.spec import AgentSpec, EnvironmentSpec
from safe_inspect.errors import CheckpointError
from safe_inspect.evaluation.policies import Policy
from safe_inspect.evaluation.policy_file import PolicyInfo, check_layout
from safe_inspect.experiments.files.checkpoints import SEAL, policy_folder
from safe_inspect.experiments.files.weights import read_weights


def checkpoint_policies(path: Path, spec: EnvironmentSpec, sampled: bool | None, seed: int) -> dict[str, Policy]:
    """Return the policy of each controlled agent; agents with the same policy share one object.

    Args:
        path: The checkpoint's folder.
        spec: The task.
        sampled: Whether actions are sampled, see `TrainedPolicy`.
        seed: Seed of the sampled actions.

    Raises:
        CheckpointError: The checkpoint is damaged, of another task, or has no policy for an agent.
    """
    chosen = {agent.name: _chosen(path, agent) for agent in spec.agents if agent.scripted_policy is None}
    for agent in spec.agents:  # checked before Ray and Torch are loaded
        if agent.name in chosen:
            check_layout(str(path), _info(path, chosen[agent.name]), agent)
    loaded = {name: _load(path, name, sampled, seed) for name in dict.fromkeys(chosen.values())}
    return {agent: loaded[name] for agent, name in chosen.items()}


def checkpoint_hash(checkpoint: Path) -> str:
    """Return the hash of a checkpoint's files, by name and content, without its seal."""
    found = hashlib.sha256()
    for path in sorted(checkpoint.rglob("*")):
        if path.is_file() and not path.name.startswith(SEAL):
            found.update(path.relative_to(checkpoint).as_posix().encode())
            found.update(path.read_bytes())
    return found.hexdigest()


def _chosen(path: Path, agent: AgentSpec) -> str:
    """Return the name of the checkpoint's policy for an agent: the agent's own policy, or the only one."""
    try:
        return policy_folder(path, usual=agent.policy).name
    except CheckpointError as error:
        known = str(error).partition("; ")[0]
        raise CheckpointError(
            f"{known}, but none is {agent.policy!r}, the policy of the agent {agent.name!r}; "
            "give the experiment with which it was trained"
        ) from None


def _load(path: Path, name: str, sampled: bool | None, seed: int) -> Any:
    from safe_inspect.experiments.modules.policy import trained_policy  # loads Ray and Torch

    return trained_policy(path, name, sampled=sampled, seed=seed)


def _info(path: Path, name: str) -> PolicyInfo:
    info = read_weights(policy_folder(path, name)).info
    if info is None:
        raise CheckpointError(
            f"{path}: the checkpoint does not describe its policy's observation and action, so it cannot be used; "
            "train again"
        )
    return info
