"""`export_perceptron`: export of a policy of any learner to an ONNX file. Importing this module loads Ray and Torch."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import torch

from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments.layout import action_layout
from safe_inspect.errors import CheckpointError
from safe_inspect.experiments.export import Exported, portable, write_policy
from safe_inspect.experiments.modules.saved_policy import BestChoices
from safe_inspect.experiments.onnx_graph import NO_SPREAD, Spread, require_onnx
from safe_inspect.experiments.settings.policies import SINGLE, policy_info


def export_perceptron(
    layers: Iterable[torch.nn.Module],
    cfg: str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    log_std: Sequence[float] | torch.Tensor | None = None,
    combined: bool = False,
    overrides: Iterable[str] = (),
    training: Mapping[str, Any] | None = None,
) -> Exported:
    """Write a policy of another learner as an ONNX file, for `safe-inspect evaluate` and other commands.

    The file is compared with the layers before it replaces any file `output`, as in `export_policy`.

    Args:
        layers: Linear layers and activations, from the task's observation to the means of its action, or to the logits
            of the levels of each element, one element after the other.
        cfg: Experiment file or id of the task; the task must have one agent.
        output: The file to write.
        log_std: Logarithms of the standard deviations, for a stochastic policy; by default the policy is deterministic.
        combined: Whether the layers give a value for each combination of levels, as those of DQN on
            `FlatDiscreteActions` do; the policy then takes the combination with the largest value.
        overrides: ``path.of.keys=value`` for each value of the file to override.
        training: Data about the training, such as `steps` and `seed`.

    Returns:
        The written file, and its difference from the layers.

    Raises:
        CheckpointError: The layers do not match the task, or are of an unsupported kind.
        ConfigError: The file has mistakes.
        OutputError: The file cannot be written.
        SafeInspectError: The package onnx or onnxruntime is not installed.
    """
    require_onnx()
    experiment = load_experiment(cfg, overrides)
    agents = experiment.spec.controlled
    if len(agents) != 1:
        raise CheckpointError(
            f"{cfg}: the task has {len(agents)} agents, but a net controls only one; give a task with one agent"
        )
    info = replace(
        policy_info(experiment, SINGLE, agents, exportable=True),
        configuration=portable(experiment.resolved),
        training=dict(training or {}),
    )
    net = torch.nn.Sequential(*layers).to("cpu", torch.float32).eval()
    choices = action_layout(agents[0]).choices
    outputs = math.prod(choices) if combined else sum(choices)
    sizes = len(info.observation), outputs if choices else len(info.action)
    linear = [layer for layer in net if isinstance(layer, torch.nn.Linear)]
    found = (linear[0].in_features, linear[-1].out_features) if linear else (0, 0)
    if found != sizes:
        raise CheckpointError(
            f"{cfg}: the net has {found[0]} inputs and {found[1]} outputs, but the task needs {sizes[0]} and "
            f"{sizes[1]}; give the task in which it was trained"
        )
    if combined and choices:
        info, net = replace(info, distribution="greedy"), net.append(BestChoices(choices)).eval()
    if not choices:
        net.append(Spread(torch.full((sizes[1],), NO_SPREAD) if log_std is None else torch.as_tensor(log_std).cpu()))
    return write_policy(net, net, info, output, experiment.spec, agents[0], str(output))
