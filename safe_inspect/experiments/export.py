"""`export_policy`: export of a checkpoint's policy to an ONNX file, which is compared with the checkpoint.

Importing this module loads Ray and Torch.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.vector.utils import batch_space
from ray.rllib.core.rl_module.rl_module import RLModule

from safe_inspect.config.elements import element_columns
from safe_inspect.config.experiment import Experiment, load_experiment
from safe_inspect.config.spec import AgentSpec, EnvironmentSpec
from safe_inspect.environments.facades.spaces import box
from safe_inspect.environments.layout import observation_layout
from safe_inspect.errors import CheckpointError, did_you_mean
from safe_inspect.evaluation.onnx_policy import OnnxPolicy, load_onnx
from safe_inspect.evaluation.policies import with_scripted
from safe_inspect.evaluation.policy_file import PolicyInfo, check_layout, seal
from safe_inspect.evaluation.rollouts import rollout
from safe_inspect.experiments.modules.checkpoints import (
    Checkpoint,
    configuration_of,
    known_configuration,
    known_info,
    policy_folder,
)
from safe_inspect.experiments.modules.policy import TrainedPolicy, trained_policy
from safe_inspect.experiments.modules.run_folder import RunFolder
from safe_inspect.experiments.modules.saved_policy import SacPolicy
from safe_inspect.experiments.onnx_graph import RllibNet, build_file, require_onnx
from safe_inspect.experiments.settings.policies import SINGLE, policy_info
from safe_inspect.outputs import new_file
from safe_inspect.random.action_draws import draw_in_rollout
from safe_inspect.types import AnyArray, FloatArray

#: Largest accepted difference, relative to the range of the action or to the outputs of the net.
EXPORT_TOLERANCE = 1e-5

_RANDOM_STEPS, _RANDOM_ROWS = 64, 64
_FLOWN_EPISODES = 16


@dataclass(frozen=True)
class ExportDifference:
    """Difference between the outputs of a file and those of the checkpoint.

    Attributes:
        rows: Number of observations.
        action: Largest difference of the output `thrust`, relative to the range of the element [-].
        inputs: Largest difference of the output `action_dist_inputs`, relative to the largest output of the row, at
            least 1 [-].
    """

    rows: int
    action: float
    inputs: float

    @property
    def passes(self) -> bool:
        """Whether both differences are within `EXPORT_TOLERANCE`; False for NaN."""
        return bool(self.action <= EXPORT_TOLERANCE and self.inputs <= EXPORT_TOLERANCE)


def _compare_readings(policy: OnnxPolicy, module: Any, *readings: AnyArray) -> ExportDifference:
    """Compare a file with the checkpoint's module.

    The module gets the readings as the metadata of the file normalise them. For a recurrent policy the rows are
    episodes that begin at the first step; for other policies all steps are treated as one batch.

    Args:
        policy: The file.
        module: The module.
        *readings: Observations in SI units, each float32, shape (T, R, O) for T steps of R rows.
    """
    net = TrainedPolicy(module).inputs if isinstance(module, RLModule) else partial(_outputs, module)
    centre, width = (element_columns(policy.info.observation, name) for name in ("centre", "width"))
    found, wanted = [], []
    for seen in readings:
        policy.reset()
        for rows in seen if policy.recurrent else (seen.reshape(-1, seen.shape[-1]),):
            found.append(policy.outputs(rows))
            wanted.append(net(np.ascontiguousarray((rows - centre) / width, np.float32)))
    thrust, inputs = (np.concatenate(parts) for parts in zip(*found, strict=True))
    expected = np.concatenate(wanted)
    low, high = (element_columns(policy.info.action, name) for name in ("low", "high"))
    off = np.abs(thrust - _commanded(policy, inputs, expected)) / np.where(np.isfinite(high - low), high - low, 1.0)
    scale = np.maximum(np.abs(expected).max(axis=1, keepdims=True), 1.0)
    return ExportDifference(len(expected), float(off.max()), float((np.abs(inputs - expected) / scale).max()))


def _commanded(policy: OnnxPolicy, inputs: AnyArray, expected: AnyArray) -> FloatArray:
    """Return the commands of the controllers, shape (R, A), for the outputs of the module.

    Choices are those of the file's own outputs, because of equally likely ones each may choose another.

    Args:
        policy: The file.
        inputs: Inputs of the action distribution from the file, shape (R, I).
        expected: The same from the module, shape (R, I).
    """
    elements, gates = policy.info.action, policy.info.distribution == "hurdle"
    means = slice(gates, gates + sum(not element.levels for element in elements))
    mixed, rows = inputs.copy(), np.zeros(len(inputs), dtype=np.int64)
    mixed[:, means] = expected[:, means]
    return policy.commanded(draw_in_rollout(policy.distribution, mixed, False, 0, rows, rows, 0))


def _outputs(net: torch.nn.Module, observation: AnyArray) -> AnyArray:
    with torch.no_grad():
        found = net(torch.from_numpy(observation))
    return np.asarray((found[0] if isinstance(found, tuple) else found).numpy())


def random_readings(agent: AgentSpec, info: PolicyInfo, steps: int, rows: int, seed: int = 0) -> AnyArray:
    """Sample readings for the whole range of the net's inputs, float32, shape (steps, rows, O)."""
    space = batch_space(batch_space(box(observation_layout(agent)), rows), steps)
    space.seed(seed)
    centre, width = (element_columns(info.observation, name) for name in ("centre", "width"))
    return np.asarray(space.sample() * width + centre, dtype=np.float32)


def _flown_readings(policy: OnnxPolicy, spec: EnvironmentSpec) -> AnyArray:
    """Return the observations of rollouts of the file in SI units, float32, shape (T, R, O); other agents coast."""
    names = [agent.name for agent in spec.controlled]
    mine = [name for name in names if name in policy.info.agents]
    others = [name for name in names if name not in mine]
    raw = policy.prepare(spec, mine)
    seen: list[AnyArray] = []

    def fly(observation: AnyArray) -> FloatArray:
        seen.append(observation)
        return policy(observation)

    task = with_scripted(raw, "zero-thrust", others) if others else raw
    rollout(task, fly, episodes=_FLOWN_EPISODES, seed=0, num_envs=_FLOWN_EPISODES)
    return np.stack(seen)


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
    if experiment is None:
        experiment = load_experiment(known_configuration(checkpoint))
    title = f"{checkpoint}, policy {folder.name}"
    agents = _agents(experiment, folder.name, title)
    loaded = trained_policy(checkpoint, folder.name)
    net = RllibNet(loaded.module, title)
    trained = known_info(loaded.module.model_config, title)
    for agent in agents:
        check_layout(title, trained, agent)
    info = replace(
        policy_info(experiment, folder.name, agents, exportable=True),
        distribution=trained.distribution,  # `hurdle` is a setting of the net and not of the task
        configuration=portable(experiment.resolved),
        training=training_record(checkpoint),
        state=net.state,
    )
    module = net if isinstance(loaded.module, SacPolicy) else loaded.module
    return write_policy(net, module, info, output, experiment.spec, agents[0], title)


def write_policy(
    net: torch.nn.Module,
    module: Any,
    info: PolicyInfo,
    output: str | os.PathLike[str],
    spec: EnvironmentSpec,
    agent: AgentSpec,
    title: str,
) -> Exported:
    """Write a net as an ONNX file, after comparing the file with a module; see `export_policy`.

    Args:
        net: The net.
        module: RLlib's module with this net, or the net itself.
        info: The description of the policy for the file.
        output: The file to write.
        spec: The task.
        agent: One of the agents that the policy controls.
        title: Name of the policy in messages.

    Raises:
        CheckpointError: The net cannot be exported, or the outputs of the file differ from those of the module.
        OutputError: The file cannot be written.
    """
    path = Path(output).expanduser()
    with new_file(path, "give another --output") as work:
        work.write_bytes(seal(build_file(net, info, title)))
        written = load_onnx(work)
        flown = _flown_readings(written, spec)
        random = random_readings(agent, info, _RANDOM_STEPS, _RANDOM_ROWS)
        difference = _compare_readings(written, module, random, flown)
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


def training_record(checkpoint: str | os.PathLike[str]) -> dict[str, Any]:
    """Return data about the training from the checkpoint and the folder of its run, without data about the machine."""
    found = Checkpoint.read(checkpoint)
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
    outside = experiment.spec.controlled
    if name == SINGLE and len(outside) == 1:
        return outside
    agents = [agent for agent in outside if agent.policy == name]
    if not agents:
        known = did_you_mean(name, {agent.policy for agent in outside})
        raise CheckpointError(f"{title}: the experiment has no policy of that name; {known}; give the run's own --cfg")
    return agents
