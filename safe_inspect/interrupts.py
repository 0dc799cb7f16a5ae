"""Handling of Ctrl-C, SIGTERM and SIGHUP: all raise KeyboardInterrupt, so that no incomplete files are left."""

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

#: Signals that stop a process: Ctrl-C; `kill`, `timeout`, batch schedulers and systemd; a closed terminal.
STOPPING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)  # Windows has no SIGHUP
_HANGUP = getattr(signal, "SIGHUP", None)
#: Time within which further signals belong to the same request [s]: `timeout` and a closed terminal send two.
_AGAIN = 1.0
#: Time after which a signal is sent again if its exception was lost [s].
_RETRY = 0.05


class Interrupted(KeyboardInterrupt):
    """A signal requested that the command stop; its notes describe the state in which it stops.

    Attributes:
        number: Number of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


def stop_quietly_until_handled() -> None:
    """Let Ctrl-C end a command without a traceback during imports, before `handled` is entered.

    It has no effect in a program that imports the package.
    """
    words = getattr(sys, "orig_argv", [])
    module = words[words.index("-m") + 1 :][:1] if "-m" in words else []
    first = os.path.basename(sys.argv[0]) if sys.argv else ""
    started = first.removesuffix(".exe") == "safe-inspect" or (
        first == "-m" and module and module[0].partition(".")[0] == "safe_inspect"
    )
    if started and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def _interrupt(number: int) -> NoReturn:
    """Stop the running code.

    Raises:
        Interrupted: Always.
    """
    raise Interrupted(number)


@contextmanager
def handled(handler: Callable[[int], None] = _interrupt) -> Iterator[None]:
    """Call a function when a signal requests that the process stop, once for all signals within a second.

    A signal that is ignored, as SIGHUP is under `nohup`, stays ignored. Outside the main thread this has no effect.

    Args:
        handler: Function of the number of the signal. Default: it raises `Interrupted`.
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

    sys.unraisablehook = retake  # destructors and callbacks, such as LLVM's, do not propagate exceptions
    try:
        with _handlers(take):
            yield
    finally:
        sys.unraisablehook = unraisable


@contextmanager
def deferred() -> Iterator[None]:
    """Delay signals that request that the process stop until the block has ended."""
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
    """Discard output to a terminal that is closed, because writing to it would fail."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (1, 2):
        try:
            if stat.S_ISCHR(os.fstat(descriptor).st_mode):
                os.dup2(nowhere, descriptor)
        except OSError:  # the stream is not open
            continue
    os.close(nowhere)
