"""`EpisodeBar`: how many episodes of a rollout have ended, on a terminal."""

from __future__ import annotations

import math
import time
from typing import TextIO

from safe_inspect.experiments.runs.progress import clock_text


class EpisodeBar:
    """A bar on a terminal, as a training has it: how many episodes have ended.

    Args:
        label: Printed before the bar.
        stream: Where it goes; nothing is printed unless it is a terminal.
    """

    def __init__(self, label: str, stream: TextIO) -> None:
        self._label, self._stream = label, stream
        self._terminal = stream.isatty()
        self._begun = time.monotonic()

    def show(self, done: int, wanted: int, width: int = 40) -> None:
        """Draw the bar anew."""
        if not self._terminal:
            return
        share, passed = done / wanted, time.monotonic() - self._begun
        full = round(width * share)
        left = clock_text(passed * (1.0 - share) / share if share else math.inf)
        line = f"[{'#' * full}{'.' * (width - full)}] {100 * share:3.0f} %  left {left}"
        self._stream.write(f"\r{self._label}  {line}\x1b[K")
        self._stream.flush()

    def close(self) -> None:
        """Remove the bar."""
        if self._terminal:
            self._stream.write("\r\x1b[K")
            self._stream.flush()
