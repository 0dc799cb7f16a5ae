"""The model card of a trained policy, with data about its training and its evaluations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

#: Limits of use that every card contains.
LIMITS = (
    "It was trained and evaluated only in this package's simulation: linear dynamics, a point "
    "mass, exact readings of the sensors, thrust that is constant during a step.",
    "It was trained for one task: the bodies, the distribution of the initial states and the limits of its experiment. "
    "Evaluate it again before using it in another task.",
    "It guarantees nothing. Limits that must not be violated are enforced by the safety filter, if an experiment "
    "enables it.",
)


@dataclass(frozen=True)
class CardData:
    """Content of a model card; `ship` adds what it can find out by itself.

    Attributes:
        name: Name of the policy.
        title: What the policy does, in one sentence.
        command: Command of the training.
        training: Data about the training, from `safe_inspect.experiments.export.export.training_record`.
        machine: The machine on which it was trained.
        date: Date of the card.
        versions: Versions of the packages that exported it.
        exported: For each ONNX file its name, agents, kind of actions and largest difference from the checkpoint.
        observation: Name and unit of each element of the observation, for each file.
        evaluations: Contents of the `evaluation.json` of each evaluation, by title.
        seeds: Other seeds of the recipe and their results, one line each.
        limits: Limits of use in addition to those of every policy.
    """

    name: str
    title: str
    command: str
    training: Mapping[str, Any] = field(default_factory=dict)
    machine: str = ""
    date: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    exported: Sequence[Sequence[str]] = ()
    observation: Mapping[str, Sequence[str]] = field(default_factory=dict)
    evaluations: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    seeds: Sequence[str] = ()
    limits: Sequence[str] = ()


def model_card(card: CardData) -> str:
    """Return the card as Markdown.

    Raises:
        KeyError: An evaluation was not written by `safe-inspect evaluate`.
    """
    training = card.training
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
            ("machine", card.machine),
            ("begun", training.get("started", "unknown")),
            ("trained by", f"safe_inspect {training.get('trained_by', 'unknown')}, {_commit(training)}"),
            ("exported", f"{card.date} by {', '.join(f'{name} {text}' for name, text in card.versions.items())}"),
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
    lines += _table(("file", "agents", "action", "largest difference from the checkpoint"), card.exported)
    for file, elements in card.observation.items():
        lines += ["", f"`{file}` reads, in this order: {', '.join(f'`{element}`' for element in elements)}."]
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
