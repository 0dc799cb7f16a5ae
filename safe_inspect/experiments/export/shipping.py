"""`ship`: writing of a trained policy into the package's data. Importing this module loads Ray and Torch."""

from __future__ import annotations

import json
import os
import platform
import re
import shutil
from dataclasses import replace
from datetime import date
from importlib import metadata
from pathlib import Path
from typing import Any

from safe_inspect.config.experiment import load_experiment
from safe_inspect.errors import CheckpointError, OutputError
from safe_inspect.evaluation.shipped import CARD, CHECKPOINT, CONFIGURATION, RECORD, ShippedPolicy, shipped_policy
from safe_inspect.experiments.export.export import Exported, export_policy, policies_in, training_record
from safe_inspect.experiments.export.model_card import CardData, model_card
from safe_inspect.experiments.files.checkpoints import (
    MODULES,
    configuration_of,
    newest_checkpoint,
    policy_folder,
    read_checkpoint,
    seal_checkpoint,
    weights_path,
)
from safe_inspect.experiments.settings.policies import SINGLE
from safe_inspect.outputs import new_folder
from safe_inspect.version import __version__

_PACKAGES = ("ray", "torch", "numpy", "onnx", "onnxruntime")


def ship(
    checkpoint: str | os.PathLike[str], root: str | os.PathLike[str], card: CardData, *, replace_old: bool = False
) -> ShippedPolicy:
    """Write the folder of a shipped policy: ONNX files, weights, experiment and model card.

    Args:
        checkpoint: A checkpoint in the folder of its run, or the folder of a run, whose newest checkpoint is used.
        root: Folder in which the policy's folder is created.
        card: Name, title, command, evaluations, seeds and limits of the model card; by default its machine is described
            as this one.
        replace_old: Whether to replace an existing folder of that name, which this function must have written.

    Returns:
        The shipped policy.

    Raises:
        CheckpointError: The checkpoint is missing, damaged or not in a run.
        OutputError: The folder exists already or cannot be written.
    """
    source = newest_checkpoint(checkpoint)
    configuration = configuration_of(source)
    if configuration is None:
        raise CheckpointError(f"{source}: the checkpoint is not in the folder of a training run; give one that is")
    name = card.name
    if not name or Path(name).name != name or name.startswith("."):
        raise OutputError(f"{name!r} is not a name for a policy; give one word, such as translational-inspection")
    target = Path(root) / name
    with new_folder(target, "ship", force=replace_old, hint="give another name") as work:
        _copy_configuration(configuration, work / CONFIGURATION)
        _copy_weights(source, work / CHECKPOINT)
        flying = {agent.policy for agent in load_experiment(configuration).spec.agents} | {SINGLE}
        done = [
            export_policy(source, work / ("policy.onnx" if policy == SINGLE else f"{policy}.onnx"), policy)
            for policy in policies_in(source)
            if policy in flying
        ]
        agents = {agent: item.path.name for item in done for agent in item.info.agents}
        record = {"name": name, "task": done[0].info.task, "safe_inspect": __version__, "agents": agents}
        (work / RECORD).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
        card = replace(
            card,
            training=training_record(source),
            machine=card.machine or f"{platform.system()}, {platform.machine()}, {os.cpu_count()} cores",
            date=date.today().isoformat(),
            versions={"safe_inspect": __version__, **{package: metadata.version(package) for package in _PACKAGES}},
            exported=[_row(item) for item in done],
            observation={item.path.name: [str(element) for element in item.info.observation] for item in done},
        )
        (work / CARD).write_text(_card(card), encoding="utf-8")
    return shipped_policy(name, Path(root))


def _copy_configuration(source: Path, target: Path) -> None:
    """Copy the experiment without data about the machine: comments about its origin, and the folder of its runs."""
    lines = source.read_text(encoding="utf-8").splitlines(keepends=True)
    text = "".join(line for line in lines if not line.startswith("#"))
    target.write_text(re.sub(r"(?m)^(\s+output_path:) .*$", r"\1 output", text), encoding="utf-8")


def _copy_weights(source: Path, target: Path) -> None:
    """Copy the files of a checkpoint that `trained_policy` reads, and seal the copy."""
    for policy in policies_in(source):
        folder = target / MODULES / policy
        folder.mkdir(parents=True)
        shutil.copy(weights_path(policy_folder(source, policy)), folder)
    seal_checkpoint(replace(read_checkpoint(source), path=target))


def _row(done: Exported) -> tuple[str, str, str, str]:
    levels = [len(element.levels) for element in done.info.action if element.levels]
    action = f"most likely of {', '.join(map(str, levels))} levels" if levels else "mean"
    found = f"{done.difference.action:.1e} of the range, {done.difference.rows:,} observations"
    return done.path.name, ", ".join(done.info.agents), action, found


def evaluation_content(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the content of an `evaluation.json`.

    Raises:
        CheckpointError: The file is not an evaluation.
    """
    try:
        content: dict[str, Any] = json.loads(Path(path).read_text(encoding="utf-8"))
        content["episodes"], content["seed"], content["success"]["rate"], content["figures"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CheckpointError(
            f"{path}: this is not an evaluation ({error}); give an evaluation.json that `safe-inspect evaluate` wrote"
        ) from None
    return content


def _card(card: CardData) -> str:
    try:
        return model_card(card)
    except (KeyError, TypeError, ValueError) as error:
        raise CheckpointError(f"an evaluation lacks values for the model card ({error}); evaluate again") from None
