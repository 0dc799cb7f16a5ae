"""Text tables of evaluations, and comparisons of evaluations of the same episodes with paired differences."""

from __future__ import annotations

import math
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from safe_inspect.evaluation.results.results import Block, Evaluation, EvaluationError
from safe_inspect.evaluation.task import differing_keys
from safe_inspect.metrics.statistics import Difference, Estimate, Interval, estimate, paired_difference

Row = Sequence[str]

_HEAD = ("", "mean", "std", "IQM", "95 % interval of the IQM", "min", "max", "unit")

#: Columns that are left out, in this order, when a table is too wide; files contain all columns.
_OPTIONAL = ("max", "min", "std", "higher in", "lower in", "95 % interval of the IQM", "95 % interval")

#: Largest number of episodes that are listed for a cause.
_MOST_NUMBERS = 10


def evaluation_table(evaluation: Evaluation) -> str:
    """Return the table of an evaluation, with a block for each agent if there are several."""
    count, lines = len(evaluation), []
    rows = [
        [_HEAD, *(_row(figure, item, count) for figure, item in figures.items())]
        for figures in evaluation.estimates.values()
    ]
    for (name, block), table in zip(evaluation.blocks.items(), aligned(rows), strict=True):
        if name:
            lines += [f"{name}: {ends(block)}", *table[1:]]
        else:
            lines += [f"{evaluation.label}: {count} episodes, {ends(block)}", *table]
    return "\n".join([*lines, *_causes(evaluation)])


def _causes(evaluation: Evaluation) -> list[str]:
    """Return a line for each cause of a loss, the most frequent first, with the numbers of its first episodes."""
    lines = []
    for cause, times in evaluation.losses:
        lost = np.flatnonzero(np.asarray(evaluation.causes) == cause)
        numbers = ", ".join(str(number) for number in lost[:_MOST_NUMBERS])
        lines.append(f"  {times} lost: {cause} (episodes {numbers}{', ...' if times > _MOST_NUMBERS else ''})")
    return lines


def ends(block: Block) -> str:
    """Return the success rate with Wilson's interval, and how the episodes ended."""
    interval = block.success_interval
    counts = ", ".join(f"{name} {count}" for name, count in block.statuses.items())
    return (
        f"success {100 * block.success_rate:.1f} % "
        f"(95 % interval {100 * interval.low:.1f} to {100 * interval.high:.1f} %; {counts})"
    )


def aligned(blocks: Sequence[Sequence[Row]]) -> list[list[str]]:
    """Return the lines of every block, with the same column widths; the first and the last column are left-aligned.

    If a line would be longer than the terminal, or than the environment variable ``COLUMNS``, columns of `_OPTIONAL`
    are left out, in that order.
    """
    room = shutil.get_terminal_size((sys.maxsize, 0)).columns
    count = len(blocks[0][0])
    widths = [max(len(row[column]) for rows in blocks for row in rows) for column in range(count)]
    if 2 * count + sum(widths) > room:
        left_out = next((name for name in _OPTIONAL if name in blocks[0][0]), None)
        if left_out is not None:
            gone = list(blocks[0][0]).index(left_out)
            return aligned([[[*row[:gone], *row[gone + 1 :]] for row in rows] for rows in blocks])

    def line(row: Row) -> str:
        cells = [cell.rjust(width) for cell, width in zip(row, widths, strict=True)]
        cells[0], cells[-1] = row[0].ljust(widths[0]), row[-1]
        return ("  " + "  ".join(cells)).rstrip()

    return [[line(row) for row in rows] for rows in blocks]


def number(value: float) -> str:
    """Return a number with four decimals, or three significant digits of a small one; ``-`` if it is not finite."""
    if not math.isfinite(value):
        return "-"
    return f"{value:z.4f}" if value == 0.0 or abs(value) >= 0.001 else f"{value:.3g}"


def span(interval: Interval) -> str:
    """Return an interval as text; ``-`` if it is not finite."""
    if not math.isfinite(interval.low):
        return "-"
    return f"{number(interval.low)} to {number(interval.high)}"


def _row(name: str, item: Estimate, episodes: int) -> Row:
    unit = item.unit if item.count == episodes else f"{item.unit} ({item.count} of {episodes})"
    centre = map(number, (item.mean, item.standard_deviation, item.iqm))
    return (name, *centre, span(item.iqm_interval), number(item.minimum), number(item.maximum), unit)


def pooled_table(evaluations: Sequence[Evaluation]) -> str:
    """Return the table of several sources combined, such as those of several training seeds.

    The intervals come from a bootstrap that resamples the episodes of each source separately.
    """
    rows: list[Row] = [_HEAD]
    wins = estimate([np.asarray(item.team.status == "win", dtype=np.float64) for item in evaluations])
    episodes = sum(map(len, evaluations))
    for name in evaluations[0].team.figures:
        unit = evaluations[0].units.get(name, "-")
        rows.append(_row(name, estimate([item.team.figures[name] for item in evaluations], unit), episodes))
    (table,) = aligned([rows])
    rates = ", ".join(f"{100 * item.team.success_rate:.1f}" for item in evaluations)
    interval = wins.mean_interval
    line = f"{len(evaluations)} sources together: {episodes} episodes, success {100 * wins.mean:.1f} % "
    line += f"(95 % interval {100 * interval.low:.1f} to {100 * interval.high:.1f} %; each: {rates})"
    return "\n".join([line, *table])


@dataclass(frozen=True)
class _Comparison:
    """Evaluations of the same episodes, compared.

    Attributes:
        evaluations: The evaluations; the others are compared with the first.
        differences: Differences of every figure for each further evaluation that has it, that evaluation minus the
            first, by label.
        notes: What is left out, and why.
    """

    evaluations: Sequence[Evaluation]
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
        for name in self.differences:
            found = [item.estimates[""].get(name) for item in self.evaluations]
            cells = ["-" if each is None else number(each.iqm) for each in found]
            units = [each.unit for each in found if each is not None]
            if units:  # the success rate has no estimate
                rows.append((name, *cells, units[0]))
        (table,) = aligned([rows])
        lines += ["", *table]
        for item in others:
            head = ("", "mean", "95 % interval", "IQM", "lower in", "higher in", "unit")
            known = ((name, found[item.label]) for name, found in self.differences.items() if item.label in found)
            (table,) = aligned([[head, *(_difference_row(name, found) for name, found in known)]])
            lines += ["", f"{item.label} less {first.label}, episode by episode:", *table]
        lines += ["", "* the interval of the mean does not contain 0"]
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])


def compare(evaluations: Sequence[Evaluation]) -> _Comparison:
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
    figures = {
        item.label: {"success": (item.team.status == "win").astype(np.float64), **item.team.figures}
        for item in evaluations
    }
    names = list(dict.fromkeys(name for each in figures.values() for name in each))
    notes = []
    if len({item.record.get("price") for item in evaluations}) > 1:
        notes.append("the rewards differ, so returns and reward terms are left out")
        names = [name for name in names if name != "return" and not name.startswith("reward/")]
    units = {name: unit for item in reversed(evaluations) for name, unit in item.units.items()}
    return _Comparison(
        evaluations,
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


def _check_same_episodes(first: Evaluation, other: Evaluation) -> None:
    who = f"{first.label} and {other.label} cannot be compared"
    remedy = "evaluate both with the same --seed, --episodes and --cfg; if only one needs overrides for that, "
    remedy += "evaluate each with --output and compare the folders"
    for what, one, another in (
        ("seed", first.record["seed"], other.record["seed"]),
        ("number of episodes", len(first), len(other)),
    ):
        if one != another:
            raise EvaluationError(f"{who}: the {what} is {one} in one and {another} in the other; {remedy}")
    apart = differing_keys(first.record["task"], other.record["task"])
    if apart:
        shown = ", ".join(apart[:3]) + (", ..." if len(apart) > 3 else "")
        what = f"their tasks differ in {shown}"
        remedy = "evaluate both in one task with --cfg, which takes policies with the observations and actions of that "
        remedy += "task; those of other tasks have no episodes in common, so read the tables of `safe-inspect evaluate`"
        raise EvaluationError(f"{who}: {what}; {remedy}")
    mine, theirs = first.initial_states, other.initial_states
    if {name: mine[name].shape for name in mine} != {name: theirs[name].shape for name in theirs}:
        raise EvaluationError(f"{who}: their deputies differ; {remedy}")
    same = np.all([(mine[name] == theirs[name]).reshape(len(first), -1).all(axis=1) for name in mine], axis=0)
    if not same.all():
        raise EvaluationError(
            f"{who}: {int((~same).sum())} of their {len(same)} episodes have different initial states (the first is "
            f"episode {int(np.argmin(same))}), as the initial states of the configurations differ or an enabled filter "
            f"refuses different ones; {remedy}"
        )


def _difference_row(name: str, item: Difference) -> Row:
    star = " *" if item.verdict else ""
    share = ("-", "-") if not item.count else (f"{100 * item.smaller:.0f} %", f"{100 * item.larger:.0f} %")
    return (name, number(item.mean) + star, span(item.interval), number(item.iqm), *share, item.unit)
