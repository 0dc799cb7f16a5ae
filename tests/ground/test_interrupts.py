"""Signals that ask a process to stop: one exception for all, once for those that come together."""

from __future__ import annotations

import os
import pty
import signal
import sys
import time

import pytest

from safe_inspect import interrupts
from safe_inspect.interrupts import Interrupted, deferred, handled

NUMBERS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.mark.parametrize("number", NUMBERS)
def test_each_signal_raises_and_the_former_handlers_come_back(number):
    before = [signal.getsignal(each) for each in NUMBERS]
    with pytest.raises(KeyboardInterrupt) as caught, handled():
        signal.raise_signal(number)
    assert caught.value.number == number
    assert [signal.getsignal(each) for each in NUMBERS] == before


def test_signals_within_a_second_are_one_request(monkeypatch):
    now, seen = [100.0], []
    monkeypatch.setattr(interrupts.time, "monotonic", lambda: now[0])
    with handled(seen.append):
        for moment in (100.0, 100.2, 100.9, 101.5, 101.6):
            now[0] = moment
            signal.raise_signal(signal.SIGTERM)
    assert seen == [signal.SIGTERM, signal.SIGTERM]  # at 100.0 and 101.5


def test_a_signal_that_is_ignored_stays_so():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with handled():
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_deferred_signals_come_at_the_end():
    seen = []
    with handled(seen.append):
        with deferred():
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGTERM)
            assert seen == []
        assert seen == [signal.SIGINT]


def test_an_exception_that_is_lost_in_a_destructor_is_raised_again():
    class Swallows:
        def __del__(self):
            signal.raise_signal(signal.SIGTERM)

    with pytest.raises(Interrupted), handled():  # noqa: PT012
        Swallows()  # Python ignores what its destructor raises
        time.sleep(5.0)
        pytest.fail("the signal was lost")


def test_a_closed_terminal_does_not_keep_a_command_from_its_end(tmp_path):
    code = (
        "import signal, sys\n"
        "from pathlib import Path\n"
        "from safe_inspect.interrupts import handled\n"
        "def stop(number):\n"
        "    print('the terminal is gone', file=sys.stderr, flush=True)\n"
        "    Path(sys.argv[1]).write_text(signal.Signals(number).name)\n"
        "    sys.exit(0)\n"
        "with handled(stop):\n"
        "    print('ready', flush=True)\n"
        "    signal.pause()\n"
    )
    process_id, terminal = pty.fork()
    if process_id == 0:
        os.execv(sys.executable, [sys.executable, "-c", code, str(tmp_path / "seen")])
    assert b"ready" in os.read(terminal, 100)
    os.close(terminal)
    _, status = os.waitpid(process_id, 0)
    assert os.waitstatus_to_exitcode(status) == 0
    assert (tmp_path / "seen").read_text() == "SIGHUP"
