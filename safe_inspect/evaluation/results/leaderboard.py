"""`Leaderboard`: the policies to run in each task and published figures, from YAML files; and its page in Markdown."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from safe_inspect.config.loading.loader import load
from safe_inspect.config.loading.located import LocatedDict, locate
from safe_inspect.config.report import validated
from safe_inspect.errors import ConfigError, Problem, SafeInspectError
from safe_inspect.evaluation.results.results import Evaluation
from safe_inspect.metrics.statistics import Interval, wilson
from safe_inspect.policies.plan_record import Record
from safe_inspect.types import FloatArray

#: Columns of the tables and the formats of their figures.
_COLUMNS = {
    "success": "{:.1%}",
    "points": "{:.2f}",
    "delta-v [m/s]": "{:.3f}",
    "time [s]": "{:,.0f}",
    "decisions": "{:,.1f}",
    "violations": "{:.1%}",
    "training steps": "{:,}",
    "wall time": "{}",
}
_LEGEND = (
    "Success has Wilson's 95 % interval. Points (inspected points), delta-v of a deputy, time to the end of an episode",
    "and decisions are means; the decisions of a plan are its burns. Violations are the share of the episodes in which",
    "a constraint of the task's safety filter was violated at a step, also if the filter is not enabled.",
    "[evaluation.md](evaluation.md#leaderboard) describes how to add a row.",
)


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class FlownRow(_Model):
    """A policy that is run on the board's episodes.

    Attributes:
        source: An argument of ``safe-inspect evaluate``: the name of a baseline, of a scripted or of a shipped policy,
            an ONNX file, or the folder of a checkpoint or run; or ``optimiser`` for the open-loop plans.
        name: Name in the table; `source` by default.
        note: A short note after the name.
        task: Experiment file that defines the policy's observations and actions; the board's task by default.
        overrides: ``KEY=VALUE`` overrides in addition to the board's.
        training_steps: Environment steps of its training; for a shipped policy, by default those of its model card.
        wall_time: How long the training took, such as ``19 min``; the default is that of `training_steps`.
    """

    source: str = Field(min_length=1)
    name: str = ""
    note: str = ""
    task: str | None = None
    overrides: tuple[str, ...] = ()
    training_steps: int | None = Field(default=None, ge=0)
    wall_time: str | None = None

    @property
    def title(self) -> str:
        """Name in the table."""
        return self.name or self.source


class _PublishedRow(_Model):
    """Figures that come from elsewhere: published ones, or those of another program; None if a figure is unknown.

    Attributes:
        name: Name in the table.
        reference: Where they come from.
        note: How their episodes differ from the board's.
        success: Share of the episodes that were won [-].
        points: Inspected points.
        delta_v: Velocity change of a deputy [m/s].
        time: Time to the end of an episode [s].
    """

    name: str = Field(min_length=1)
    reference: str = Field(min_length=1)
    note: str = ""
    success: float | None = Field(default=None, ge=0.0, le=1.0)
    points: float | None = Field(default=None, ge=0.0)
    delta_v: float | None = Field(default=None, ge=0.0)
    time: float | None = Field(default=None, ge=0.0)


class Board(_Model):
    """One table: a task, the policies that are run in it, and published figures.

    Attributes:
        title: Its heading; boards of several files with the same title are merged.
        task: Experiment file, or id of a task; needed once for each title.
        about: Text above the table.
        overrides: ``KEY=VALUE`` for each value of the task that is replaced.
        rows: The policies to run.
        published: Published figures.
    """

    title: str = Field(min_length=1)
    task: str | None = None
    about: str = ""
    overrides: tuple[str, ...] = ()
    rows: tuple[FlownRow, ...] = ()
    published: tuple[_PublishedRow, ...] = ()


class Leaderboard(_Model):
    """All boards.

    Attributes:
        episodes: Number of episodes of every row.
        seed: Seed of the episodes.
        boards: The tables.
    """

    episodes: int = Field(default=1000, ge=1)
    seed: int = Field(default=1000, ge=0)
    boards: tuple[Board, ...]


def read_leaderboard(paths: Iterable[str | os.PathLike[str]]) -> Leaderboard:
    """Return the leaderboard of one or several files; boards with the same title are merged, with the rows of all.

    Args:
        paths: The files; the number of episodes and the seed are those of the first.

    Raises:
        ConfigError: A file has mistakes; all are listed, each with its line.
        SafeInspectError: A board has no task, or a row occurs twice.
    """
    found = [_read(path) for path in paths]
    boards: dict[str, Board] = {}
    for board in (board for one in found for board in one.boards):
        known = boards.get(board.title, Board(title=board.title))
        merged = {key: getattr(board, key) or getattr(known, key) for key in ("task", "about", "overrides")}
        merged |= {key: (*getattr(known, key), *getattr(board, key)) for key in ("rows", "published")}
        boards[board.title] = known.model_copy(update=merged)
    for title, board in boards.items():
        if board.task is None:
            raise SafeInspectError(f"leaderboard: the board {title!r} has no `task` in any file; add one")
        names = [slug(row.title) for row in board.rows]
        for index, row in enumerate(board.rows):
            if names[index] in names[:index]:
                raise SafeInspectError(
                    f"leaderboard: two rows are named {row.title!r}; give one of them another `name`"
                )
    return found[0].model_copy(update={"boards": tuple(boards.values())})


def _read(path: str | os.PathLike[str]) -> Leaderboard:
    tree = load(path)
    if not isinstance(tree, LocatedDict):
        where = locate(tree, ()) if isinstance(tree, list) else None
        raise ConfigError(Problem(f"{path}: a leaderboard must be a mapping with the key `boards`", location=where))
    return validated(Leaderboard, tree)


def slug(text: str) -> str:
    """Return a text in the form of a file or folder name."""
    return re.sub(r"[^\w.-]+", "-", text).strip(".-").lower() or "row"


@dataclass(frozen=True)
class Standing:
    """Figures of a row.

    Attributes:
        name: Name in the table, in Markdown.
        figures: The figures by column; unknown ones are missing or None.
        interval: Wilson's 95 % interval of the success rate; None if it was published without.
    """

    name: str
    figures: Mapping[str, float | str | None]
    interval: Interval | None = None

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
        phi = [values for name, values in figures.items() if name.startswith("phi ")]
        steps = training.get("environment steps", "").replace(",", "")
        return cls(
            _title(row),
            {
                "success": found.team.success_rate,
                "points": _mean(figures.get("inspected points")),
                "delta-v [m/s]": _mean(figures.get("delta-v per deputy", figures.get("delta-v"))),
                "time [s]": float(np.mean(figures["length"])) * float(found.record["task"]["step_size"]),
                "decisions": _mean(figures.get("decisions", figures["length"])),
                "violations": float(np.mean(np.stack(phi).min(axis=0) < 0.0)) if phi else None,
                "training steps": int(steps) if row.training_steps is None and steps else row.training_steps,
                "wall time": row.wall_time or training.get("wall time"),
            },
            found.team.success_interval,
        )

    @classmethod
    def of_plans(cls, row: FlownRow, record: Record, step_size: float) -> Standing:
        """Return the standing of open-loop plans; their decisions are burns."""
        entries = record.entries
        rows = [(e.success, e.inspected, e.delta_v, e.steps * step_size, e.burns) for e in entries]
        means = dict(zip(_COLUMNS, np.mean(rows, axis=0).tolist(), strict=False))
        return cls(_title(row), means, wilson(sum(entry.success for entry in entries), len(entries)))

    @classmethod
    def of_published(cls, row: _PublishedRow) -> Standing:
        """Return the standing of published figures."""
        name = f"*{_plain(row.name)}* ({_plain(row.reference)}{f'; {_plain(row.note)}' if row.note else ''})"
        known = (row.success, row.points, row.delta_v, row.time)
        return cls(name, dict(zip(_COLUMNS, known, strict=False)))

    @property
    def rank(self) -> tuple[float, float]:
        """Key by which the best row comes first."""
        success, delta_v = self.figures.get("success"), self.figures.get("delta-v [m/s]")
        return -float(success or 0.0), float(delta_v or 0.0)

    @property
    def cells(self) -> tuple[str, ...]:
        """The cells of its row in the table."""
        texts = dict.fromkeys(_COLUMNS, "-")
        for column, value in self.figures.items():
            texts[column] = "-" if value is None else _COLUMNS[column].format(value).replace("%", " %")
        if self.interval is not None:
            texts["success"] += f" ({100.0 * self.interval.low:.1f} to {100.0 * self.interval.high:.1f})"
        return (self.name, *texts.values())


def leaderboard_page(leaderboard: Leaderboard, standings: Sequence[Sequence[Standing]], command: str) -> str:
    """Return the page in Markdown: a section with a table per board, the best row first, published figures last.

    Args:
        leaderboard: The boards.
        standings: The standings of each board, in the order of its rows.
        command: The command that made the page.
    """
    lines = [
        "# Leaderboard\n",
        f"All rows are evaluated on the same {leaderboard.episodes:,} episodes of seed {leaderboard.seed}; rows in "
        "italics are figures from elsewhere.\n",
        f"    {command}\n",
        *_LEGEND,
    ]
    for board, flown in zip(leaderboard.boards, standings, strict=True):
        lines += ["", f"## {board.title}", ""]
        if board.about:
            lines += [board.about.strip(), ""]
        changed = f", with {', '.join(f'`{override}`' for override in board.overrides)}" if board.overrides else ""
        lines += [f"Task: `{board.task}`{changed}.", ""]
        rows = [*sorted(flown, key=lambda row: row.rank), *map(Standing.of_published, board.published)]
        table = [("", *_COLUMNS), ("---", *["---:"] * len(_COLUMNS)), *(row.cells for row in rows)]
        lines += [f"| {' | '.join(line)} |" for line in table]
    return "\n".join(lines) + "\n"


def _mean(values: FloatArray | None) -> float | None:
    return None if values is None else float(np.nanmean(values))


def _title(row: FlownRow) -> str:
    return f"`{row.title}`{f' ({_plain(row.note)})' if row.note else ''}"


def _plain(text: str) -> str:
    return text.replace("|", "\\|")
