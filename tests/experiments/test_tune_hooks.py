"""The monitor of a training: what a first and a second signal do."""

from __future__ import annotations

import io
import signal

import pytest

from safe_inspect.interrupts import Interrupted

pytestmark = pytest.mark.ray


def test_the_first_signal_asks_for_a_checkpoint_and_the_second_stops_at_once(tmp_path):
    from safe_inspect.experiments.modules.run_folder import RunFolder
    from safe_inspect.experiments.runs.tune_run import Monitor

    stream = io.StringIO()
    monitor = Monitor(RunFolder(tmp_path), {"training_iteration": 9}, stream, "")
    assert not monitor("trial", {"training_iteration": 1})
    monitor.interrupt(signal.SIGTERM)
    assert monitor("trial", {"training_iteration": 1})
    assert (
        stream.getvalue() == "stopping after this iteration, with a checkpoint; interrupt again to stop immediately\n"
    )
    monitor.interrupt(signal.SIGHUP)  # the terminal is closed: nobody asks again
    with pytest.raises(Interrupted) as caught:
        monitor.interrupt(signal.SIGINT)
    assert caught.value.number == signal.SIGINT
