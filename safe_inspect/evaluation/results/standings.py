"""`Standing`: the figures of one row of a leaderboard; `leaderboard_page`: all rows in Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from safe_inspect.evaluation.results.leaderboard import FlownRow, Leaderboard, PublishedRow
from safe_inspect.evaluation.results.results import Evaluation
from safe_inspect.metrics.statistics import Interval, wilson
from safe_inspect.planning.record import Record
from safe_inspect.types import FloatArray

_HEAD = ("", "success", "points", "delta-v [m/s]", "time [s]", "decisions", "violations", "training steps", "wall time")
_LEGEND = (
    "Success with Wilson's 95 % interval. Points, delta-v of a deputy, time to the end and decisions are means; the",
    "decisions of a plan are its burns. Violations: share of the episodes in which a constraint of the task's safety",
    "filter was violated at a step, whether the filter is on or off. [evaluation.md](evaluation.md#leaderboard) says",
    "how to add a row.",
)


@dataclass(frozen=True)
class Standing:
    """Figures of a row; None if a figure is unknown.

    Attributes:
        name: Name in the table, in Markdown.
        success: Share of the episodes that were won [-].
        interval: Wilson's 95 % interval of `success`; None if it was published without.
        points: Mean number of inspected points.
        delta_v: Mean velocity change of a deputy [m/s].
        time: Mean time to the end [s].
        decisions: Mean number of decisions of a deputy.
        violations: Share of the episodes in which a safety constraint was violated [-].
        training_steps: Environment steps of the training.
        wall_time: How long the training took.
    """

    name: str
    success: float | None = None
    interval: Interval | None = None
    points: float | None = None
    delta_v: float | None = None
    time: float | None = None
    decisions: float | None = None
    violations: float | None = None
    training_steps: int | None = None
    wall_time: str | None = None

    @classmethod
    def of_evaluation(cls, row: FlownRow, found: Evaluation, training: Mapping[str, str]) -> Standing:
        """Return the standing of a policy that was evaluated.

        Args:
            row: Its row.
            found: Its evaluation. Violations are taken from the figures ``phi NAME``; the number of decisions is the
                figure ``decisions`` if there is one, else the number of steps.
            training: Entries of its model card, empty without one.
        """
        figures = found.team.figures
        spent = figures.get("delta-v per deputy", figures.get("delta-v"))
        phi = [values for name, values in figures.items() if name.startswith("phi ")]
        violated: FloatArray | None = np.asarray(np.stack(phi).min(axis=0) < 0.0, np.float64) if phi else None
        steps = training.get("environment steps", "").replace(",", "")
        return cls(
            _name(row),
            found.team.success_rate,
            found.team.success_interval,
            _mean(figures.get("inspected points")),
            _mean(spent),
            float(np.mean(figures["length"])) * float(found.record["task"]["step_size"]),
            _mean(figures.get("decisions", figures["length"])),
            _mean(violated),
            row.training_steps if row.training_steps is not None or not steps.isdecimal() else int(steps),
            row.wall_time or training.get("wall time"),
        )

    @classmethod
    def of_plans(cls, row: FlownRow, record: Record, step_size: float) -> Standing:
        """Return the standing of open-loop plans; their decisions are burns."""
        entries = record.entries
        won = sum(entry.success for entry in entries)
        means = np.mean([(e.inspected, e.delta_v, e.steps * step_size, e.burns) for e in entries], axis=0)
        points, spent, time, burns = (float(mean) for mean in means)
        return cls(_name(row), won / len(entries), wilson(won, len(entries)), points, spent, time, burns)

    @classmethod
    def of_published(cls, row: PublishedRow) -> Standing:
        """Return the standing of published figures."""
        name = f"*{_plain(row.name)}* ({_plain(row.reference)}{f'; {_plain(row.note)}' if row.note else ''})"
        given = row.model_dump(exclude={"name", "reference", "note"})
        return cls(name, **given)

    @property
    def cells(self) -> tuple[str, ...]:
        """The cells of its row in the table."""
        return (
            self.name,
            _success(self.success, self.interval),
            _text(self.points, "{:.2f}"),
            _text(self.delta_v, "{:.3f}"),
            _text(self.time, "{:,.0f}"),
            _text(self.decisions, "{:,.1f}"),
            _text(self.violations, "{:.1%}").replace("%", " %"),
            _text(self.training_steps, "{:,}"),
            self.wall_time or "-",
        )


def leaderboard_page(leaderboard: Leaderboard, standings: Sequence[Sequence[Standing]], command: str) -> str:
    """Return the page in Markdown: a section with a table per board, the best row first, published figures last.

    Args:
        leaderboard: The boards.
        standings: The standings of each board, in the order of its rows.
        command: The command that made the page.
    """
    lines = [
        "# Leaderboard",
        "",
        f"Every row is of the same {leaderboard.episodes:,} episodes of seed {leaderboard.seed}; those in italics are "
        "published figures of other episodes.",
        "",
        f"    {command}",
        "",
        *_LEGEND,
    ]
    for board, flown in zip(leaderboard.boards, standings, strict=True):
        lines += ["", f"## {board.title}", ""]
        if board.about:
            lines += [board.about.strip(), ""]
        changed = f", with {', '.join(f'`{override}`' for override in board.overrides)}" if board.overrides else ""
        lines += [f"Task: `{board.task}`{changed}.", ""]
        lines += _table([*sorted(flown, key=_rank), *(Standing.of_published(row) for row in board.published)])
    return "\n".join(lines) + "\n"


def _table(rows: Sequence[Standing]) -> list[str]:
    cells = [_HEAD, ("---", *["---:"] * (len(_HEAD) - 1)), *(row.cells for row in rows)]
    return [f"| {' | '.join(line)} |" for line in cells]


def _rank(standing: Standing) -> tuple[float, float]:
    """Return the sort key of a row: the share of won episodes, then delta-v."""
    return -(standing.success or 0.0), standing.delta_v or 0.0


def _success(share: float | None, interval: Interval | None) -> str:
    if share is None:
        return "-"
    text = f"{100.0 * share:.1f} %"
    return text if interval is None else f"{text} ({100.0 * interval.low:.1f} to {100.0 * interval.high:.1f})"


def _mean(values: FloatArray | None) -> float | None:
    return None if values is None or not len(values) else float(np.nanmean(values))


def _text(value: float | None, form: str) -> str:
    return "-" if value is None else form.format(value)


def _name(row: FlownRow) -> str:
    return f"`{row.title}`{f' ({_plain(row.note)})' if row.note else ''}"


def _plain(text: str) -> str:
    return text.replace("|", "\\|")
