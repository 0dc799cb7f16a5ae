"""Ctrl-C, SIGTERM and SIGHUP stop a command alike: by KeyboardInterrupt, so that nothing half-written is left."""

from __future__ import annotations

import math
import os
import signal
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

#: What asks a process to stop: Ctrl-C; `kill`, `timeout`, batch schedulers and systemd; a terminal that is closed.
STOPPING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)  # Windows has no SIGHUP
_HANGUP = getattr(signal, "SIGHUP", None)
#: Signals that come so soon after another mean the same request: `timeout` and a closed terminal send two [s].
_AGAIN = 1.0
#: When the signal is sent again whose exception was lost [s].
_RETRY = 0.05


class Interrupted(KeyboardInterrupt):
    """A signal has asked the command to stop; its notes say what that leaves.

    Attributes:
        number: The signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


def stop_quietly_until_handled() -> None:
    """Let Ctrl-C end a command without a traceback while Python still imports, before `handled` is entered.

    It changes nothing in a program that imports the package.
    """
    words = getattr(sys, "orig_argv", [])
    module = words[words.index("-m") + 1 :][:1] if "-m" in words else []
    first = os.path.basename(sys.argv[0]) if sys.argv else ""
    started = first.removesuffix(".exe") == "safe-inspect" or (
        first == "-m" and module and module[0].partition(".")[0] == "safe_inspect"
    )
    if started and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def interrupt(number: int) -> NoReturn:
    """Stop what runs.

    Raises:
        Interrupted: Always.
    """
    raise Interrupted(number)


@contextmanager
def handled(handler: Callable[[int], None] = interrupt) -> Iterator[None]:
    """Call a function when a signal asks the process to stop, once for signals within a second.

    A signal that is ignored, as `nohup` ignores SIGHUP, stays so. Outside the main thread nothing changes.

    Args:
        handler: Takes the number of the signal; raises `Interrupted` unless given.
    """
    last, unraisable = -math.inf, sys.unraisablehook

    def take(number: int, _: object) -> None:
        nonlocal last
        if number == _HANGUP:
            _leave_terminal()
        now = time.monotonic()
        if now - last >= _AGAIN:
            last = now
            handler(number)

    def retake(found: Any) -> None:
        nonlocal last
        if isinstance(found.exc_value, Interrupted):
            last = -math.inf
            again = threading.Timer(_RETRY, os.kill, (os.getpid(), found.exc_value.number))
            again.daemon = True
            again.start()
        else:
            unraisable(found)

    sys.unraisablehook = retake  # destructors, and callbacks such as those of LLVM, pass no exception on
    try:
        with _handlers(take):
            yield
    finally:
        sys.unraisablehook = unraisable


@contextmanager
def deferred() -> Iterator[None]:
    """Let signals that ask the process to stop wait until the block has ended."""
    waiting: list[int] = []
    try:
        with _handlers(lambda number, _: waiting.append(number)):
            yield
    finally:
        for number in waiting[:1]:
            signal.raise_signal(number)


@contextmanager
def _handlers(handler: Callable[[int, object], None]) -> Iterator[None]:
    before = {}
    if threading.current_thread() is threading.main_thread():
        for number in STOPPING:
            if signal.getsignal(number) != signal.SIG_IGN:
                before[number] = signal.signal(number, handler)
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous or signal.SIG_DFL)


def _leave_terminal() -> None:
    """Write to nowhere what would go to a terminal: it is closed, and writing to it fails."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (1, 2):
        try:
            if stat.S_ISCHR(os.fstat(descriptor).st_mode):
                os.dup2(nowhere, descriptor)
        except OSError:  # it is not open
            continue
    os.close(nowhere)
