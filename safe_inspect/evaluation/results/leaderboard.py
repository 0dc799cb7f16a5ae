"""`Leaderboard`: the policies to run in each task and the published figures of each task, read from YAML files."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from safe_inspect.config.loading.loader import load
from safe_inspect.config.loading.located import LocatedDict, locate
from safe_inspect.config.messages.report import problems_of
from safe_inspect.errors import ConfigError, Problem, SafeInspectError


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
        wall_time: How long the training took, such as ``19 min``; for a shipped policy, by default that of its model
            card.
        effort: Extent of the optimiser's search.
    """

    source: str = Field(min_length=1)
    name: str = ""
    note: str = ""
    task: str | None = None
    overrides: tuple[str, ...] = ()
    training_steps: int | None = Field(default=None, ge=0)
    wall_time: str | None = None
    effort: str = Field(default="quick", pattern="^(quick|normal|thorough)$")

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
        time: Time to the end of an episode [s].
        decisions: Decisions of a deputy in an episode.
        violations: Share of the episodes in which a safety constraint was violated [-].
        training_steps: Environment steps of the training.
        wall_time: How long the training took.
    """

    name: str = Field(min_length=1)
    reference: str = Field(min_length=1)
    note: str = ""
    success: float | None = Field(default=None, ge=0.0, le=1.0)
    points: float | None = Field(default=None, ge=0.0)
    delta_v: float | None = Field(default=None, ge=0.0)
    time: float | None = Field(default=None, ge=0.0)
    decisions: float | None = Field(default=None, ge=0.0)
    violations: float | None = Field(default=None, ge=0.0, le=1.0)
    training_steps: int | None = Field(default=None, ge=0)
    wall_time: str | None = None


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
        seen: set[str] = set()
        for row in self.rows:
            name = slug(row.title)
            if name in seen:
                raise ValueError(f"two rows are named {row.title!r}; give one of them another `name`")
            seen.add(name)
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
    try:
        return Leaderboard.model_validate(tree)
    except ValidationError as error:
        raise ConfigError(problems_of(error, tree, model=Leaderboard)) from None


def slug(text: str) -> str:
    """Return a text in the form of a file or folder name."""
    return re.sub(r"[^\w.-]+", "-", text).strip(".-").lower() or "row"
