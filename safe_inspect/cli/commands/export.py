"""The command ``safe-inspect export``."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from safe_inspect.cli.arguments import add_option, add_overrides
from safe_inspect.cli.streams import print_error
from safe_inspect.config.experiment import load_experiment
from safe_inspect.errors import CheckpointError
from safe_inspect.evaluation.shipped import shipped_policies, shipped_policy
from safe_inspect.experiments.modules.checkpoints import newest_checkpoint, policy_names
from safe_inspect.experiments.settings.policies import SINGLE
from safe_inspect.outputs import check_ending


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``export``."""
    checkpoint = "folder of a checkpoint, or of a training run (its newest checkpoint)"
    add_option(parser, "checkpoint", "CHECKPOINT", checkpoint)
    add_option(parser, "--policy", "NAME", "name of the policy, if the checkpoint contains several")
    add_option(parser, "--output", "FILE", "ONNX file (default: POLICY.onnx in the working directory)", Path)
    add_option(parser, "--cfg", "FILE", "experiment of the training (default: that of the run)")
    add_overrides(parser)


def run(arguments: argparse.Namespace) -> int:
    """Write a trained policy as an ONNX file.

    The file contains the network, the normalizers and the configuration.

    Example:
        safe-inspect export output/RUN --output policy.onnx
    """
    if arguments.output is not None:
        check_ending(arguments.output, [".onnx"], "policy file")
    if arguments.overrides and arguments.cfg is None:
        raise CheckpointError("KEY=VALUE needs an experiment; give one with --cfg, or remove KEY=VALUE")
    experiment = None if arguments.cfg is None else load_experiment(arguments.cfg, arguments.overrides)
    if str(arguments.checkpoint) in shipped_policies() and not os.path.exists(arguments.checkpoint):
        files = ", ".join(sorted({str(path) for path in shipped_policy(str(arguments.checkpoint)).onnx.values()}))
        raise CheckpointError(f"{arguments.checkpoint} is already shipped as ONNX; copy {files}")
    checkpoint = newest_checkpoint(arguments.checkpoint)
    from safe_inspect.experiments.export import export_policy  # loads Ray and Torch

    names = policy_names(checkpoint)
    policy = arguments.policy
    if policy is None:
        if len(names) > 1:
            raise CheckpointError(
                f"{checkpoint}: the checkpoint has the policies {', '.join(names)}; name one with --policy"
            )
        policy = names[0]
    print_error("exporting; takes some ten seconds")
    output = arguments.output or Path("policy.onnx" if policy == SINGLE else f"{policy}.onnx")
    done = export_policy(checkpoint, output, policy, experiment)
    info, found = done.info, done.difference
    kinds = {"gaussian": "means", "categorical": "most likely levels", "greedy": "best levels"}
    kind = kinds.get(info.distribution, "most likely actions")
    print(f"{done.path}: {info.task}, policy {info.policy}, for {', '.join(info.agents)}")
    print(f"  {len(info.observation)} readings in SI units to {len(info.action)} commands, the {kind} of the policy")
    print(
        f"  largest difference from the checkpoint: {found.action:.1e} of the action's range, over "
        f"{found.rows - done.flown:,} random and {done.flown:,} flown observations"
    )
    return 0
