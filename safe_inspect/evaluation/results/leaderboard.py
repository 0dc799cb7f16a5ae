"""`Leaderboard`: the policies to run in each task and published figures, from YAML files; and its page in Markdown."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from safe_inspect.config.loading.loader import load
from safe_inspect.config.loading.located import LocatedDict, locate
from safe_inspect.config.messages.report import validated
from safe_inspect.errors import ConfigError, Problem, SafeInspectError
from safe_inspect.evaluation.results.results import Evaluation
from safe_inspect.metrics.statistics import Interval, wilson
from safe_inspect.planning.record import Record
from safe_inspect.types import FloatArray

_HEAD = ("", "success", "points", "delta-v [m/s]", "time [s]", "decisions", "violations", "training steps", "wall time")
_RULE = ("---", *["---:"] * (len(_HEAD) - 1))
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


class PublishedRow(_Model):
    """Figures that others have published for their own episodes; None if a figure is unknown.

    Attributes:
        name: Name in the table.
        reference: Where they are published.
        note: How their episodes differ from the board's.
        success: Share of the episodes that were won [-].
        points: Inspected points.
        delta_v: Velocity change of a deputy [m/s].
    """

    name: str = Field(min_length=1)
    reference: str = Field(min_length=1)
    note: str = ""
    success: float | None = Field(default=None, ge=0.0, le=1.0)
    points: float | None = Field(default=None, ge=0.0)
    delta_v: float | None = Field(default=None, ge=0.0)


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
    published: tuple[PublishedRow, ...] = ()

    @model_validator(mode="after")
    def _names_differ(self) -> Board:
        names = [slug(row.title) for row in self.rows]
        for index, row in enumerate(self.rows):
            if names[index] in names[:index]:
                raise ValueError(f"two rows are named {row.title!r}; give one of them another `name`")
        return self


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
    boards: dict[str, dict[str, Any]] = {}
    for one in found:
        for board in one.boards:
            whole = boards.setdefault(board.title, {"title": board.title})
            whole |= {key: getattr(board, key) for key in ("task", "about", "overrides") if getattr(board, key)}
            for key in ("rows", "published"):
                whole[key] = (*whole.get(key, ()), *getattr(board, key))
    for title, whole in boards.items():
        if "task" not in whole:
            raise SafeInspectError(f"leaderboard: the board {title!r} has no `task` in any file; add one")
    try:
        return Leaderboard(
            episodes=found[0].episodes, seed=found[0].seed, boards=tuple(Board(**whole) for whole in boards.values())
        )
    except ValidationError as error:
        raise SafeInspectError(f"leaderboard: {error.errors()[0]['msg'].removeprefix('Value error, ')}") from None


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
        phi = [values for name, values in figures.items() if name.startswith("phi ")]
        steps = training.get("environment steps", "").replace(",", "")
        return cls(
            _title(row),
            found.team.success_rate,
            found.team.success_interval,
            _mean(figures.get("inspected points")),
            _mean(figures.get("delta-v per deputy", figures.get("delta-v"))),
            float(np.mean(figures["length"])) * float(found.record["task"]["step_size"]),
            _mean(figures.get("decisions", figures["length"])),
            float(np.mean(np.stack(phi).min(axis=0) < 0.0)) if phi else None,
            row.training_steps if row.training_steps is not None or not steps.isdecimal() else int(steps),
            row.wall_time or training.get("wall time"),
        )

    @classmethod
    def of_plans(cls, row: FlownRow, record: Record, step_size: float) -> Standing:
        """Return the standing of open-loop plans; their decisions are burns."""
        entries = record.entries
        won = sum(entry.success for entry in entries)
        means = np.mean([(e.inspected, e.delta_v, e.steps * step_size, e.burns) for e in entries], axis=0)
        points, spent, time, burns = means.tolist()
        return cls(_title(row), won / len(entries), wilson(won, len(entries)), points, spent, time, burns)

    @classmethod
    def of_published(cls, row: PublishedRow) -> Standing:
        """Return the standing of published figures."""
        name = f"*{_plain(row.name)}* ({_plain(row.reference)}{f'; {_plain(row.note)}' if row.note else ''})"
        return cls(name, success=row.success, points=row.points, delta_v=row.delta_v)

    @property
    def cells(self) -> tuple[str, ...]:
        """The cells of its row in the table."""
        interval = self.interval
        between = "" if interval is None else f" ({100.0 * interval.low:.1f} to {100.0 * interval.high:.1f})"
        return (
            self.name,
            _text(self.success, "{:.1%}").replace("%", " %") + between,
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
        "# Leaderboard\n",
        f"All rows are evaluated on the same {leaderboard.episodes:,} episodes of seed {leaderboard.seed}; rows in "
        "italics are published figures of other episodes.\n",
        f"    {command}\n",
        *_LEGEND,
    ]
    for board, flown in zip(leaderboard.boards, standings, strict=True):
        lines += ["", f"## {board.title}", ""]
        if board.about:
            lines += [board.about.strip(), ""]
        changed = f", with {', '.join(f'`{override}`' for override in board.overrides)}" if board.overrides else ""
        lines += [f"Task: `{board.task}`{changed}.", ""]
        rows = sorted(flown, key=lambda row: (-(row.success or 0.0), row.delta_v or 0.0))
        cells = (row.cells for row in (*rows, *map(Standing.of_published, board.published)))
        lines += [f"| {' | '.join(line)} |" for line in (_HEAD, _RULE, *cells)]
    return "\n".join(lines) + "\n"


def _mean(values: FloatArray | None) -> float | None:
    return None if values is None else float(np.nanmean(values))


def _text(value: float | None, form: str) -> str:
    return "-" if value is None else form.format(value)


def _title(row: FlownRow) -> str:
    return f"`{row.title}`{f' ({_plain(row.note)})' if row.note else ''}"


def _plain(text: str) -> str:
    return text.replace("|", "\\|")
