"""`export_policy`: export of a checkpoint's policy to an ONNX file. Importing this module loads Ray and Torch."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from safe_inspect.config.experiment import Experiment, load_experiment
from safe_inspect.config.spec import AgentSpec, EnvironmentSpec
from safe_inspect.errors import CheckpointError, did_you_mean
from safe_inspect.evaluation.onnx_policy import load_onnx
from safe_inspect.evaluation.policy_file import PolicyInfo, check_layout, seal
from safe_inspect.experiments.export.export_check import (
    ExportDifference,
    compare_readings,
    flown_readings,
    random_readings,
    worst,
)
from safe_inspect.experiments.export.net_layers import NetLayers, layers_of
from safe_inspect.experiments.export.onnx_graph import build_file, require_onnx
from safe_inspect.experiments.files.checkpoints import configuration_of, policy_folder, policy_names, read_checkpoint
from safe_inspect.experiments.files.run_folder import RunFolder
from safe_inspect.experiments.modules.policy import trained_policy
from safe_inspect.experiments.modules.saved_policy import DqnPolicy, SacPolicy
from safe_inspect.experiments.settings.policies import SINGLE
from safe_inspect.experiments.settings.policy_info import policy_info
from safe_inspect.outputs import new_file

_RANDOM_STEPS, _RANDOM_ROWS = 64, 64


@dataclass(frozen=True)
class Exported:
    """An exported file.

    Attributes:
        path: The file.
        info: The description of the policy in the file.
        difference: Difference from the checkpoint, measured on random observations and on observations from rollouts.
        flown: Number of observations from rollouts.
    """

    path: Path
    info: PolicyInfo
    difference: ExportDifference
    flown: int


def export_policy(
    checkpoint: str | os.PathLike[str],
    output: str | os.PathLike[str],
    policy: str | None = None,
    experiment: Experiment | None = None,
) -> Exported:
    """Write a policy as an ONNX file that includes the normalisers and the scaling of the actions.

    The file is written under a temporary name and compared with the checkpoint before it replaces any file `output`.

    Args:
        checkpoint: The checkpoint's folder.
        output: The file to write.
        policy: Name of the policy; needed if the checkpoint contains several.
        experiment: The experiment with which the policy was trained; by default that of the checkpoint's run.

    Returns:
        The written file, and its difference from the checkpoint.

    Raises:
        CheckpointError: The checkpoint is missing, damaged or of another task, the policy cannot be exported, or the
            outputs of the file differ from those of the checkpoint.
        ConfigError: A normaliser is not one of this package's own, or the run's configuration has mistakes.
        OutputError: The file cannot be written.
        SafeInspectError: The package onnx or onnxruntime is not installed.
    """
    require_onnx()
    folder = policy_folder(checkpoint, policy)
    own = configuration_of(checkpoint)
    if experiment is None:
        if own is None:
            raise CheckpointError(
                f"{checkpoint}: the checkpoint is not in the folder of a training run, so its task is unknown; give "
                "the experiment with --cfg"
            )
        experiment = load_experiment(own)
    title = f"{checkpoint}, policy {folder.name}"
    agents = _agents(experiment, folder.name, title)
    loaded = trained_policy(checkpoint, folder.name)
    net = layers_of(loaded.module, title)
    if loaded.info is None:
        raise CheckpointError(
            f"{title}: the checkpoint does not describe the policy's observation and action, so it cannot be exported; "
            "train again"
        )
    for agent in agents:
        check_layout(title, loaded.info, agent)
    info = replace(
        policy_info(experiment, folder.name, agents, exportable=True),
        distribution=loaded.info.distribution,  # `hurdle` is a setting of the net and not of the task
        configuration=portable(experiment.resolved),
        training=training_record(checkpoint),
        state=net.state,
    )
    module = net if isinstance(loaded.module, SacPolicy | DqnPolicy) else loaded.module
    return write_policy(net, module, info, output, experiment.spec, agents[0], title)


def write_policy(
    net: NetLayers,
    module: Any,
    info: PolicyInfo,
    output: str | os.PathLike[str],
    spec: EnvironmentSpec,
    agent: AgentSpec,
    title: str,
) -> Exported:
    """Write layers as an ONNX file, after comparing the file with a module; see `export_policy`.

    Args:
        net: The layers.
        module: RLlib's module with these layers, or the layers themselves.
        info: The description of the policy for the file.
        output: The file to write.
        spec: The task.
        agent: One of the agents that the policy controls.
        title: Name of the policy in messages.

    Raises:
        CheckpointError: A layer cannot be exported, or the outputs of the file differ from those of the module.
        OutputError: The file cannot be written.
    """
    path = Path(output).expanduser()
    with new_file(path, "give another --output") as work:
        work.write_bytes(seal(build_file(net, info, title)))
        written = load_onnx(work)
        flown = flown_readings(written, spec)
        random = random_readings(agent, _RANDOM_STEPS, _RANDOM_ROWS)
        difference = worst(*(compare_readings(written, module, agent, readings) for readings in (random, flown)))
        if not difference.passes:
            raise CheckpointError(
                f"{title}: the exported policy differs from the given one by {difference.action:.1e} of the action's "
                f"range and by {difference.inputs:.1e} of the net's outputs; no file was written. Please report this"
            )
    return Exported(path, info, difference, flown.shape[0] * flown.shape[1])


def portable(configuration: Mapping[str, Any]) -> dict[str, Any]:
    """Return a resolved configuration without absolute paths of this machine."""
    found: dict[str, Any] = json.loads(json.dumps(configuration))
    task = found.get("config", {}).get("config", {}).get("env_config", {})
    if isinstance(task, dict) and Path(str(task.get("output_path") or "")).is_absolute():
        task["output_path"] = "output"
    return found


def policies_in(checkpoint: str | os.PathLike[str]) -> list[str]:
    """Return the names of the policies of a checkpoint.

    Raises:
        CheckpointError: The checkpoint is missing or damaged, or contains no policy.
    """
    names = policy_names(checkpoint)
    if not names:
        raise CheckpointError(f"{checkpoint}: the checkpoint contains no policy")
    return names


def training_record(checkpoint: str | os.PathLike[str]) -> dict[str, Any]:
    """Return data about the training from the checkpoint and the folder of its run, without data about the machine."""
    found = read_checkpoint(checkpoint)
    training: dict[str, Any] = {"iteration": found.iteration, "steps": found.steps, "seconds": round(found.seconds, 1)}
    own = configuration_of(checkpoint)
    if own is None:
        return training
    try:
        record = json.loads(RunFolder(own.parent).record.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return training
    training |= {key: record[key] for key in ("seed", "git_commit", "python") if record.get(key) is not None}
    training |= {"trained_by": record["safe_inspect"]} if "safe_inspect" in record else {}
    if record.get("attempts"):
        training |= {"started": record["attempts"][0].get("started"), "attempts": len(record["attempts"])}
    return training


def _agents(experiment: Experiment, name: str, title: str) -> list[AgentSpec]:
    """Return the agents that a policy controls."""
    outside = [agent for agent in experiment.spec.agents if agent.scripted_policy is None]
    if name == SINGLE and len(outside) == 1:
        return outside
    agents = [agent for agent in outside if agent.policy == name]
    if not agents:
        known = did_you_mean(name, {agent.policy for agent in outside})
        raise CheckpointError(f"{title}: the experiment has no policy of that name; {known}; give the run's own --cfg")
    return agents
