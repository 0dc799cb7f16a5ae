"""Standard output and error of commands, which continue if a stream is closed or its reader leaves."""

from __future__ import annotations

import io
import os
import re
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from safe_inspect.errors import Problem


class _Lasting:
    """A stream that discards what is printed after its reader has left, as in ``command | head``."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        try:
            self._stream.write(text)
        except BrokenPipeError:
            discard_output()
        return len(text)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except BrokenPipeError:
            discard_output()


@contextmanager
def lasting_streams() -> Iterator[None]:
    """Let a command complete, and write its files, although nobody reads what it prints."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed; no other file may get its descriptor
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper):  # an ASCII terminal cannot print a name with an umlaut
            stream.reconfigure(errors="backslashreplace")
    before = sys.stdout
    sys.stdout = _Lasting(before)  # type: ignore[assignment]
    try:
        yield
        sys.stdout.flush()
    finally:
        sys.stdout = before


def print_error(text: str) -> None:
    """Print a message to standard error, if it can be written."""
    with suppress(OSError):  # the reader may be gone
        print(without_long_words(text), file=sys.stderr)


def print_loading() -> None:
    """Print to standard error that a command with missions needs some time before it starts."""
    print_error("loading; the first run on a machine compiles for a minute")


def print_doubts(doubts: Iterable[Problem]) -> None:
    """Print permitted settings that may be mistakes to standard error, one per line."""
    for doubt in doubts:
        print_error(f"warning: {doubt}")


def without_long_words(text: str) -> str:
    """Return a message without words of a thousand letters or more, such as the digits of a number."""
    return re.sub(r"\S{1000,}", lambda word: f"{word[0][:57]}...", text)


def discard_output() -> None:
    """Discard buffered output, because Python would write it at exit and report an error."""
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
