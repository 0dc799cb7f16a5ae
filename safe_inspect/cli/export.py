"""The command ``safe-inspect export``."""

from __future__ import annotations

import argparse

from safe_inspect.errors import CheckpointError


def add_export_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the export."""
    parser.add_argument("checkpoint", metavar="CHECKPOINT", help="folder of a checkpoint, or of a run: its newest one")
    parser.add_argument("--policy", metavar="NAME", help="which policy, where the checkpoint holds several")
    parser.add_argument("--output", metavar="FILE", help="the file (default: the policy's name with .onnx, here)")
    parser.add_argument(
        "--cfg", metavar="CFG", help="experiment that it was trained with (default: that of the checkpoint's run)"
    )
    parser.add_argument("overrides", nargs="*", metavar="KEY=VALUE", help="replaces a value of --cfg, by its path")


def run_export(arguments: argparse.Namespace) -> int:
    """Write the file and print how far it is from the checkpoint."""
    from safe_inspect.config.experiment import load_experiment
    from safe_inspect.experiments.export.export import export_policy, newest_checkpoint, policies_in
    from safe_inspect.experiments.runs.checkpoints import SINGLE

    if arguments.overrides and arguments.cfg is None:
        raise CheckpointError("values are replaced in an experiment that is named with --cfg; give it, or no values")
    experiment = None if arguments.cfg is None else load_experiment(arguments.cfg, arguments.overrides)
    checkpoint = newest_checkpoint(arguments.checkpoint)
    names = policies_in(checkpoint)
    policy = arguments.policy
    if policy is None:
        if len(names) > 1:
            raise CheckpointError(
                f"{checkpoint}: the checkpoint has the policies {', '.join(names)}; name one with --policy"
            )
        policy = names[0]
    output = arguments.output or ("policy.onnx" if policy == SINGLE else f"{policy}.onnx")
    done = export_policy(checkpoint, output, policy, experiment)
    info, found = done.info, done.difference
    kind = "means" if info.distribution == "gaussian" else "most likely levels"
    print(f"{done.path}: {info.task}, policy {info.policy}, for {', '.join(info.agents)}")
    print(f"  {len(info.observation)} readings in SI units to {len(info.action)} commands, the {kind} of the policy")
    print(
        f"  largest difference from the checkpoint: {found.action:.1e} of the action's range, over "
        f"{found.rows - done.flown:,} random and {done.flown:,} flown observations"
    )
    if found.undecided:
        print(f"  {found.undecided:,} of them left out, as two levels are equally likely there")
    return 0
