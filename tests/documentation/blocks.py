"""The fenced blocks of a Markdown page, and running them as a reader does."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from safe_inspect import train_rl
from safe_inspect.cli.main import main

_FENCE = re.compile(r"^```(\w*) *([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Block:
    """A block: its language, what follows the language, and its text."""

    language: str
    info: str
    text: str

    @property
    def title(self) -> str:
        """The name of the file that the block shows; empty where it shows none."""
        found = re.search(r'title="([^"]+)"', self.info)
        return found[1] if found else ""

    def commands(self) -> list[list[str]]:
        """Return the commands of the package, word by word."""
        lines = [shlex.split(line, comments=True) for line in self.text.replace("\\\n", " ").splitlines()]
        return [words for words in lines if words and (words[0] == "safe-inspect" or words[:2] == ["python", "-m"])]


def blocks_of(page: Path) -> list[Block]:
    """Return the blocks of a page in order."""
    return [Block(*found) for found in _FENCE.findall(page.read_text(encoding="utf-8"))]


def run_command(words: list[str]) -> int:
    """Run a command of the package in this process; return its exit code."""
    if words[0] == "safe-inspect":
        return main(words[1:])
    assert words[:3] == ["python", "-m", "safe_inspect.train_rl"], words
    return train_rl.main(words[3:])


def run_page(page: Path, replace: dict[str, str], output: Callable[[], str], change: Callable[..., list[str]]) -> None:
    """Run a page's blocks in order, in the working directory.

    Args:
        page: The page.
        replace: Replacements of values that would take minutes to run; each must occur.
        output: Returns what has been printed since its last call.
        change: Gives the words of a command that take a test seconds.
    """
    names: dict[str, Any] = {"__name__": "__main__"}
    used: set[str] = set()
    shown = ""
    for block in blocks_of(page):
        text = block.text
        for old, new in replace.items():
            used |= {old} if old in text else set()
            text = text.replace(old, new)
        if block.title:
            Path(block.title).write_text(text, encoding="utf-8")
        elif block.language == "python":
            exec(compile(text, str(page), "exec"), names)
        elif block.language == "bash":
            output()
            for words in Block("bash", "", text).commands():
                code = run_command(change(words))
                assert code == 0 if "fails" not in block.info else code in (1, 2), words
            shown = output()
        elif block.language == "text":
            expected = ".*".join(
                r"\s+".join(map(re.escape, line.split())) for line in re.split(r"\.\.\.\n?", text.strip())
            )
            assert re.search(expected, shown, re.DOTALL), f"{page.name} shows\n{text}\nand the command shows\n{shown}"
    assert used == set(replace), "a replacement of the test is no longer needed"
