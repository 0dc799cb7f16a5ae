"""`compare`: compares evaluations of the same episodes, with paired differences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from safe_inspect.evaluation.results.results import Evaluation, EvaluationError
from safe_inspect.evaluation.results.tables import Row, aligned, ends, number, span
from safe_inspect.evaluation.task import differing_keys
from safe_inspect.metrics.statistics import Difference, Estimate, paired_difference

#: The figure that is 1 for a won episode and 0 otherwise.
SUCCESS = "success"


@dataclass(frozen=True)
class Comparison:
    """Evaluations of the same episodes, compared.

    Attributes:
        evaluations: The evaluations; the others are compared with the first.
        estimates: Estimates of every figure for each evaluation that has it, by label.
        differences: Differences of every figure for each further evaluation that has it, that evaluation minus the
            first, by label.
        notes: What is left out, and why.
    """

    evaluations: Sequence[Evaluation]
    estimates: Mapping[str, Mapping[str, Estimate]]
    differences: Mapping[str, Mapping[str, Difference]]
    notes: Sequence[str] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return plain dictionaries and numbers for JSON."""
        first = self.evaluations[0]
        return {
            "seed": first.record["seed"],
            "episodes": len(first),
            "compared_with": first.label,
            "evaluations": {item.label: item.as_dict() for item in self.evaluations},
            "differences": {
                name: {label: difference.as_dict() for label, difference in each.items()}
                for name, each in self.differences.items()
            },
            "notes": list(self.notes),
        }

    def __str__(self) -> str:
        first, *others = self.evaluations
        lines = [f"{len(first)} episodes of seed {first.record['seed']}, the same for all"]
        lines += [f"  {item.label}: {ends(item.team)}" for item in self.evaluations]
        head = ("IQM", *(item.label for item in self.evaluations), "unit")
        rows: list[Row] = [head]
        for name, each in self.estimates.items():
            cells = [number(each[item.label].iqm) if item.label in each else "-" for item in self.evaluations]
            rows.append((name, *cells, next(iter(each.values())).unit))
        (table,) = aligned([rows])
        lines += ["", *table]
        for item in others:
            head = ("", "mean", "95 % interval", "IQM", "lower in", "higher in", "unit")
            rows = [head]
            for name, found in self.differences.items():
                if item.label in found:
                    rows.append(_row(name, found[item.label]))
            (table,) = aligned([rows])
            lines += ["", f"{item.label} less {first.label}, episode by episode:", *table]
        lines += ["", "* the interval of the mean does not contain 0"]
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])


def compare(evaluations: Sequence[Evaluation]) -> Comparison:
    """Compare evaluations of the same episodes.

    Raises:
        EvaluationError: There are fewer than two, or their seeds, numbers of episodes, tasks or initial states differ.
    """
    if len(evaluations) < 2:
        raise EvaluationError(f"a comparison needs at least two evaluations, got {len(evaluations)}; give another")
    first, *others = evaluations
    if len({item.label for item in evaluations}) < len(evaluations):
        raise EvaluationError("two evaluations have the same label; give each a different label")
    for other in others:
        _check_same_episodes(first, other)
    notes = []
    priced = {item.record.get("price") for item in evaluations}
    if len(priced) > 1:
        notes.append("the rewards differ, so returns and reward terms are left out")
    figures = {item.label: {SUCCESS: _success(item), **item.team.figures} for item in evaluations}
    names = list(dict.fromkeys(name for each in figures.values() for name in each))
    if len(priced) > 1:
        names = [name for name in names if name != "return" and not name.startswith("reward/")]
    units = {name: unit for item in reversed(evaluations) for name, unit in item.units.items()}
    estimates = {item.label: item.estimates[""] for item in evaluations}
    return Comparison(
        evaluations,
        {
            name: {label: estimates[label][name] for label in figures if name in estimates[label]}
            for name in names
            if name != SUCCESS
        },
        {
            name: {
                other.label: paired_difference(
                    figures[other.label][name], figures[first.label][name], units.get(name, "-")
                )
                for other in others
                if name in figures[other.label] and name in figures[first.label]
            }
            for name in names
        },
        notes,
    )


def _success(evaluation: Evaluation) -> Any:
    return (evaluation.team.status == "win").astype(np.float64)


def _check_same_episodes(first: Evaluation, other: Evaluation) -> None:
    who = f"{first.label} and {other.label} cannot be compared"
    remedy = "evaluate both with the same --seed, --episodes and --cfg"
    for what, mine, theirs in (
        ("seed", first.record["seed"], other.record["seed"]),
        ("number of episodes", len(first), len(other)),
    ):
        if mine != theirs:
            raise EvaluationError(f"{who}: the {what} is {mine} in one and {theirs} in the other; {remedy}")
    apart = list(differing_keys(first.record["task"], other.record["task"]))
    if apart:
        shown = ", ".join(apart[:3]) + (", ..." if len(apart) > 3 else "")
        raise EvaluationError(f"{who}: their tasks differ in {shown}; {remedy}")
    if first.initial_states.keys() != other.initial_states.keys():
        raise EvaluationError(f"{who}: their deputies differ; {remedy}")
    same = np.ones(len(first), dtype=np.bool_)
    for name, values in first.initial_states.items():
        same &= values == other.initial_states[name]
    if not same.all():
        raise EvaluationError(
            f"{who}: {int((~same).sum())} of their {len(same)} episodes have different initial states (the first is "
            f"episode {int(np.argmin(same))}), as the initial states of the configurations differ or an enabled filter "
            f"refuses different ones; {remedy}"
        )


def _row(name: str, item: Difference) -> Row:
    star = " *" if item.verdict else ""
    share = ("-", "-") if not item.count else (f"{100 * item.smaller:.0f} %", f"{100 * item.larger:.0f} %")
    return (name, number(item.mean) + star, span(item.interval), number(item.iqm), *share, item.unit)
