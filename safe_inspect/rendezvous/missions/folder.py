"""The folder of a campaign: each mission's summary is written as it ends, so that a campaign goes on after a stop."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from safe_inspect.errors import OutputError
from safe_inspect.outputs import LOCK, cannot_write, exclusive, new_file
from safe_inspect.rendezvous.experiment import Rendezvous
from safe_inspect.rendezvous.missions.log import CONFIG, SUMMARY

#: What each mission of a campaign is known by: the first key of its summary.
MISSION_NUMBER = "mission"
_MISSIONS = "missions.jsonl"


@dataclass(frozen=True)
class CampaignFolder:
    """A folder with the experiment, and a line of JSON for each mission that has ended, in the order of their ends.

    Attributes:
        path: The folder.
    """

    path: Path

    @classmethod
    @contextmanager
    def opened(cls, path: Path, experiment: Rendezvous) -> Iterator[CampaignFolder]:
        """Give the folder of an experiment's campaign, a new one or one that was begun, to this process alone.

        Args:
            path: The folder; it is made if it is missing.
            experiment: The experiment.

        Raises:
            OutputError: The folder holds another experiment's missions or something else, cannot be written, or another
                process flies missions into it.
        """
        folder = cls(path.expanduser())
        with ExitStack() as stack:
            try:
                folder._check(experiment)
                folder.path.mkdir(parents=True, exist_ok=True)
                stack.enter_context(exclusive(folder.path, "flying missions into"))
                if not folder._check(experiment):
                    with new_file(folder.path / CONFIG) as work:
                        work.write_text(experiment.text, encoding="utf-8")
                missions = folder.path / _MISSIONS
                complete = _complete_lines(missions)
                if missions.exists() and len(complete) < missions.stat().st_size:
                    with new_file(missions) as work:
                        work.write_bytes(complete)
            except OutputError:
                raise
            except OSError as error:
                raise cannot_write(path, error, "give another with --output", "folder") from None
            yield folder

    def _check(self, experiment: Rendezvous) -> bool:
        """Return whether the folder holds missions of an experiment already.

        Raises:
            OutputError: It holds those of another one, or something else.
        """
        config = self.path / CONFIG
        if config.is_file() and not (self.path / SUMMARY).exists():
            try:
                other = yaml.safe_load(config.read_text(encoding="utf-8"))
            except (yaml.YAMLError, UnicodeDecodeError):
                raise OutputError(f"{config}: the file is damaged; give another folder with --output") from None
            difference = _difference(other, experiment.resolved)
            if difference:
                raise OutputError(
                    f"{self.path}: holds missions of another experiment ({difference}); give another folder"
                )
            return True
        if self.path.is_dir() and any(item.name != LOCK for item in self.path.iterdir()):
            raise OutputError(f"{self.path}: holds something else than a campaign; give another folder with --output")
        return False

    def summaries(self) -> dict[int, dict[str, Any]]:
        """Return the summaries of the missions that have ended, by their numbers.

        A line that is not complete, as a killed process leaves it, does not count.

        Raises:
            OutputError: A complete line is damaged.
        """
        found = {}
        for number, line in enumerate(_complete_lines(self.path / _MISSIONS).splitlines(), start=1):
            try:
                summary = json.loads(line)
                found[summary[MISSION_NUMBER]] = summary
            except (ValueError, KeyError, TypeError):
                raise OutputError(
                    f"{self.path / _MISSIONS}:{number}: the line is damaged; remove it, and its mission is flown again"
                ) from None
        return found

    def add(self, summary: dict[str, Any]) -> None:
        """Add a mission that has ended; its line is on the disk when this returns.

        Raises:
            OutputError: It cannot be written.
        """
        file = self.path / _MISSIONS
        try:
            with file.open("ab") as lines:
                lines.write((json.dumps(summary, allow_nan=False) + "\n").encode())
                lines.flush()
                os.fsync(lines.fileno())
        except OSError as error:
            raise cannot_write(file, error, "give another folder with --output") from None


def _complete_lines(file: Path) -> bytes:
    """Return a file up to the end of its last complete line; nothing where there is no file."""
    text = file.read_bytes() if file.exists() else b""
    return text[: text.rfind(b"\n") + 1]


def _difference(old: Any, new: Any, path: str = "") -> str:
    """Return the first value in which two configurations differ; empty where they are the same."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in (*old, *(key for key in new if key not in old)):
            found = _difference(old.get(key), new.get(key), f"{path}.{key}" if path else str(key))
            if found:
                return found
        return ""
    if isinstance(old, (list, tuple)) and isinstance(new, (list, tuple)):
        old, new = list(old), list(new)
    return "" if old == new else f"{path}: {old} there, {new} here"
