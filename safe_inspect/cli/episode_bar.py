"""`EpisodeBar`: the progress of long work, such as episodes, steps or figures."""

from __future__ import annotations

import math
import shutil
import sys
import time
from typing import Any, Self, TextIO

from safe_inspect.compiling import compiling_seconds
from safe_inspect.experiments.runs.progress import clock_text

#: Time between two lines if there is no terminal [s].
_SILENCE = 10.0
#: Largest width of the bar, in characters.
_WIDTH = 40


class EpisodeBar:
    """Progress of long work: a bar on a terminal, as for a training, otherwise lines of text.

    Lines are printed when nothing is done yet and every ten seconds. The estimate of the remaining time excludes
    compilation.

    As a context manager it removes the bar at the end.

    Args:
        label: Text before the bar.
        stream: Output stream; standard error by default.

    Attributes:
        done: Number of finished items at the last update.
    """

    def __init__(self, label: str, stream: TextIO | None = None) -> None:
        self._label, self._stream = label, stream or sys.stderr
        self._terminal = self._stream.isatty()
        self._begun = self._told = time.monotonic()
        self._compiled = compiling_seconds()
        self.done = 0

    def show(self, done: int, wanted: int) -> None:
        """Update the bar."""
        self.done = done
        now = time.monotonic()
        if not self._terminal and done and now - self._told < _SILENCE:
            return
        share, passed = done / wanted, now - self._begun - (compiling_seconds() - self._compiled)
        left = clock_text(passed * (1.0 - share) / share if share else math.inf)
        if not self._terminal:
            self._told = now
            print(f"{self._label}: {done:,} of {wanted:,}, left {left}", file=self._stream, flush=True)
            return
        room = shutil.get_terminal_size().columns - len(self._label) - 28  # a wrapped line cannot be overwritten
        width = max(min(_WIDTH, room), 0)
        full = round(width * share)
        line = f"[{'#' * full}{'.' * (width - full)}] {100 * share:3.0f} %  left {left}"
        self._stream.write(f"\r{self._label}  {line}\x1b[K")
        self._stream.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: Any) -> None:
        if self._terminal:
            self._stream.write("\r\x1b[K")
            self._stream.flush()
