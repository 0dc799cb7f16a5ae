"""`ship`: writing of a trained policy into the package's data, with a model card, for `ship_policy.py`."""

from __future__ import annotations

import json
import os
import platform
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from importlib import metadata
from pathlib import Path
from typing import Any

import yaml

from safe_inspect.config.experiment import load_experiment
from safe_inspect.errors import CheckpointError, OutputError
from safe_inspect.evaluation.shipped import CARD, CHECKPOINT, CONFIGURATION, RECORD, ShippedPolicy, shipped_policy
from safe_inspect.experiments.export import Exported, export_policy, portable, training_record
from safe_inspect.experiments.modules.checkpoints import (
    MODULES,
    WEIGHTS,
    Checkpoint,
    configuration_of,
    newest_checkpoint,
    policy_folder,
    policy_names,
)
from safe_inspect.experiments.settings.policies import SINGLE
from safe_inspect.outputs import new_folder
from safe_inspect.version import __version__

#: Limits of use that every card contains.
LIMITS = (
    "It was trained and evaluated only in this package's simulation: linear dynamics, a point "
    "mass, exact readings of the sensors, thrust that is constant during a step.",
    "It was trained for one task: the bodies, the distribution of the initial states and the limits of its experiment. "
    "Evaluate it again before using it in another task.",
    "It guarantees nothing. Limits that must not be violated are enforced by the safety filter, if an experiment "
    "enables it.",
)

_PACKAGES = ("ray", "torch", "numpy", "onnx", "onnxruntime")


@dataclass(frozen=True)
class CardData:
    """What the user says on a model card.

    Attributes:
        name: Name of the policy.
        title: What the policy does, in one sentence.
        command: Command of the training.
        machine: The machine on which it was trained; by default it is described as this one.
        evaluations: Contents of the `evaluation.json` of each evaluation, by title.
        seeds: Other seeds of the recipe and their results, one line each.
        limits: Limits of use in addition to those of every policy.
    """

    name: str
    title: str
    command: str
    machine: str = ""
    evaluations: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    seeds: Sequence[str] = ()
    limits: Sequence[str] = ()


def model_card(card: CardData, training: Mapping[str, Any], files: Sequence[Exported]) -> str:
    """Return the card as Markdown.

    Args:
        card: What the user says.
        training: Data about the training, from `training_record`.
        files: The exported files.
    """
    versions = {"safe_inspect": __version__, **{package: metadata.version(package) for package in _PACKAGES}}
    machine = card.machine or f"{platform.system()}, {platform.machine()}, {os.cpu_count()} cores"
    steps, seconds = training.get("steps"), training.get("seconds")
    lines = [f"# {card.name}", "", card.title, "", "## Use", "", "```sh"]
    lines += [f"safe-inspect evaluate --policy {card.name}", "```", "", "## Training", "", "```sh", card.command]
    lines += ["```", ""]
    lines += _table(
        ("", ""),
        [
            ("seed", training.get("seed", "unknown")),
            ("environment steps", "unknown" if steps is None else f"{steps:,}"),
            ("iterations", training.get("iteration", "unknown")),
            ("wall time", "unknown" if seconds is None else f"{seconds / 60:.1f} min"),
            ("machine", machine),
            ("begun", training.get("started", "unknown")),
            ("trained by", f"safe_inspect {training.get('trained_by', 'unknown')}, {_commit(training)}"),
            ("exported", f"{date.today()} by {', '.join(f'{name} {text}' for name, text in versions.items())}"),
        ],
    )
    lines += ["", "`experiment.resolved.yml` next to this card contains the whole experiment.", ""]
    if card.seeds:
        lines += ["Other seeds of the same recipe:", "", *(f"- {line}" for line in card.seeds), ""]
    lines += ["## Evaluation", ""]
    for title, evaluation in card.evaluations.items():
        lines += [*_evaluation(title, evaluation), ""]
    if not card.evaluations:
        lines += ["There is no evaluation.", ""]
    lines += ["## Files", ""]
    lines += _table(
        ("file", "agents", "action", "largest difference from the checkpoint"), [_row(file) for file in files]
    )
    for file in files:
        elements = ", ".join(f"`{element}`" for element in file.info.observation)
        lines += ["", f"`{file.path.name}` reads, in this order: {elements}."]
    lines += ["", "## Limits of use", "", *(f"- {limit}" for limit in (*card.limits, *LIMITS)), ""]
    return "\n".join(lines)


def _commit(training: Mapping[str, Any]) -> str:
    commit = str(training.get("git_commit") or "")
    changed = ", with uncommitted changes" if commit.endswith("+") else ""
    return f"commit {commit.rstrip('+')[:12]}{changed}" if commit else "commit unknown"


def _evaluation(title: str, content: Mapping[str, Any]) -> list[str]:
    lines = [f"### {title}", "", f"{content['episodes']:,} episodes, seed {content['seed']}.", ""]
    blocks = {"": content, **content.get("agents", {})}
    for name, block in blocks.items():
        success, figures = block["success"], block["figures"]
        low, high = success["interval"]
        ends = ", ".join(f"{end} {count}" for end, count in success["statuses"].items())
        lines += [
            f"{name + ': s' if name else 'S'}uccess {100 * success['rate']:.1f} % "
            f"(95 % interval {_number(low, 100)} to {_number(high, 100)} %; {ends}).",
            "",
        ]
        rows = [
            (
                figure,
                *(_number(item[key]) for key in ("mean", "standard_deviation", "iqm")),
                " to ".join(_number(end) for end in item["iqm_interval"]),
                item["unit"],
            )
            for figure, item in figures.items()
        ]
        lines += [*_table(("figure", "mean", "std", "IQM", "95 % interval of the IQM", "unit"), rows), ""]
    return lines[:-1]


def _number(value: float | None, factor: float = 1.0) -> str:
    return "-" if value is None else f"{factor * value:.4g}"


def _table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> list[str]:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return lines + ["| " + " | ".join(str(cell).replace("|", "\\|") for cell in row) + " |" for row in rows]


def ship(
    checkpoint: str | os.PathLike[str], root: str | os.PathLike[str], card: CardData, *, replace_old: bool = False
) -> ShippedPolicy:
    """Write the folder of a shipped policy: ONNX files, weights, experiment and model card.

    Args:
        checkpoint: A checkpoint in the folder of its run, or the folder of a run, whose newest checkpoint is used.
        root: Folder in which the policy's folder is created.
        card: What the model card says.
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
    with new_folder(target, "ship", force=replace_old) as work:
        experiment = load_experiment(configuration)
        text = yaml.safe_dump(portable(experiment.resolved), sort_keys=False, width=120)
        (work / CONFIGURATION).write_text(text, encoding="utf-8")
        _copy_weights(source, work / CHECKPOINT)
        flying = {agent.policy for agent in experiment.spec.agents} | {SINGLE}
        done = [
            export_policy(source, work / ("policy.onnx" if policy == SINGLE else f"{policy}.onnx"), policy)
            for policy in policy_names(source)
            if policy in flying
        ]
        agents = {agent: item.path.name for item in done for agent in item.info.agents}
        record = {"name": name, "task": done[0].info.task, "safe_inspect": __version__, "agents": agents}
        (work / RECORD).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
        (work / CARD).write_text(model_card(card, training_record(source), done), encoding="utf-8")
    return shipped_policy(name, Path(root))


def _copy_weights(source: Path, target: Path) -> None:
    """Copy the files of a checkpoint that `trained_policy` reads, and seal the copy."""
    for policy in policy_names(source):
        folder = target / MODULES / policy
        folder.mkdir(parents=True)
        shutil.copy(policy_folder(source, policy) / WEIGHTS, folder)
    replace(Checkpoint.read(source), path=target).seal()


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
        _evaluation("", content)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CheckpointError(
            f"{path}: this is not an evaluation ({error}); give an evaluation.json that `safe-inspect evaluate` wrote"
        ) from None
    return content
