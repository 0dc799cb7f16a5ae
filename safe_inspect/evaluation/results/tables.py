"""Text tables of evaluations: the estimates of every figure, for one or several evaluations."""

from __future__ import annotations

import math
import shutil
import sys
from collections import Counter
from collections.abc import Sequence

import numpy as np

from safe_inspect.evaluation.results.results import Block, Evaluation
from safe_inspect.metrics.statistics import Estimate, Interval, estimate

Row = Sequence[str]

#: Columns that are left out, in this order, when a table is too wide; files contain all columns.
_OPTIONAL = ("max", "min", "std", "higher in", "lower in", "95 % interval of the IQM", "95 % interval")

#: Largest number of episodes that are listed for a cause.
_MOST_NUMBERS = 10


def evaluation_table(evaluation: Evaluation) -> str:
    """Return the table of an evaluation, with a block for each agent if there are several."""
    blocks = evaluation.blocks
    head = ("", "mean", "std", "IQM", "95 % interval of the IQM", "min", "max", "unit")
    rows = {
        name: [
            head,
            *(_row(figure, item, len(evaluation)) for figure, item in evaluation.estimates[name].items()),
        ]
        for name in blocks
    }
    lines = [f"{evaluation.label}: {len(evaluation)} episodes, {ends(evaluation.team)}"]
    tables = iter(aligned(list(rows.values())))
    lines += next(tables)
    for (name, block), table in zip(list(blocks.items())[1:], tables, strict=True):
        lines += [f"{name}: {ends(block)}", *table[1:]]
    return "\n".join([*lines, *_causes(evaluation)])


def _causes(evaluation: Evaluation) -> list[str]:
    """Return a line for each cause of a loss, the most frequent first, with the numbers of its first episodes."""
    causes = np.array([] if evaluation.causes is None else evaluation.causes, dtype=object)
    lines = []
    for cause, times in Counter(causes[causes != ""].tolist()).most_common():
        numbers = ", ".join(str(number) for number in np.flatnonzero(causes == cause)[:_MOST_NUMBERS])
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
    return [
        [
            (
                "  "
                + "  ".join(
                    cell.ljust(width) if column in (0, count - 1) else cell.rjust(width)
                    for column, (cell, width) in enumerate(zip(row, widths, strict=True))
                )
            ).rstrip()
            for row in rows
        ]
        for rows in blocks
    ]


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
    return (
        name,
        number(item.mean),
        number(item.standard_deviation),
        number(item.iqm),
        span(item.iqm_interval),
        number(item.minimum),
        number(item.maximum),
        unit,
    )


def pooled_table(evaluations: Sequence[Evaluation]) -> str:
    """Return the table of several sources combined, such as those of several training seeds.

    The intervals come from a bootstrap that resamples the episodes of each source separately.
    """
    head = ("", "mean", "std", "IQM", "95 % interval of the IQM", "min", "max", "unit")
    rows: list[Row] = [head]
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
