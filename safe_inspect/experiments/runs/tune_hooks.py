"""Callback and stopper for Tune, which log iterations, seal checkpoints and stop the training.

Tune pickles them, so they have no state: they use the monitor of the process, which `monitored` sets.
"""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

from ray import tune

from safe_inspect.experiments.files.checkpoints import Checkpoint, seal_checkpoint
from safe_inspect.experiments.files.run_folder import (
    RunFolder,
    copy_attempt,
    parameters_text,
    read_parameters,
    read_run_record,
)
from safe_inspect.experiments.runs.progress import Heartbeat, TrainingProgress, flatten
from safe_inspect.experiments.runs.training_log import TrainingLog
from safe_inspect.experiments.runs.tune_objects import TRIAL_KEY
from safe_inspect.experiments.settings.search import trial_folder_name
from safe_inspect.interrupts import Interrupted, handled

_monitor: Monitor | None = None


class Monitor:
    """Monitor of the trials of a training, in the process that started the training.

    Args:
        folder: The run's folder.
        stop: Limits at which the training ends, by RLlib's names.
        stream: Stream for the progress.
        digest: Hash of the configuration, for the seals.
        start: The checkpoint from which the training continues.
        single: Whether there is only one trial, whose logs are in the run's folder itself.
    """

    def __init__(
        self,
        folder: RunFolder,
        stop: Mapping[str, float],
        stream: TextIO,
        digest: str,
        start: Checkpoint | None = None,
        single: bool = True,
    ) -> None:
        self.folder, self.stop, self.stream, self.digest = folder, dict(stop), stream, digest
        self.start, self.single = start, single
        self.interrupted = False
        self.last: dict[str, float] = {}
        self.best: Path | None = None
        self._logs: dict[str, TrainingLog] = {}
        self._lines: dict[str, TrainingProgress] = {}
        self.heartbeat = Heartbeat(stream, folder.compiling_note)

    def on_start(self, trial: str) -> None:
        """Record and print that a trial of a search starts."""
        if self.single:
            return
        own = RunFolder(self.folder.trials / trial)
        copy_attempt(self.folder, own)
        print(f"{trial}  {parameters_text(read_parameters(own.path))}", file=self.stream, flush=True)

    def on_result(self, trial: str, result: Mapping[str, Any]) -> None:
        """Log and print an iteration of a trial."""
        flat = flatten(result)
        if not self.single:
            flat["seed"] = float(result["config"]["env_config"]["seed"])  # the seed of a resumed algorithm differs
        self.last = flat
        if trial not in self._logs:
            start = self.start or Checkpoint(self.folder.path, 0)
            if self.single:
                self._logs[trial] = TrainingLog(self.folder.path, start.iteration, start.steps)
            else:
                self._logs[trial] = TrainingLog(self.folder.trials / trial, int(flat["training_iteration"]) - 1)
            self._lines[trial] = TrainingProgress(self.stop, self.stream, "" if self.single else trial)
        self._logs[trial].add(flat)
        self.heartbeat.iteration()
        self._lines[trial].show(flat)

    def on_checkpoint(self, path: Path, result: Mapping[str, Any]) -> None:
        """Seal a checkpoint that Tune has written."""
        flat = flatten(result)
        digest = self.digest if self.single else str(read_run_record(RunFolder(path.parent))["digest"])
        seal_checkpoint(
            Checkpoint(
                path,
                int(flat.get("training_iteration", 0)),
                int(flat.get("num_env_steps_sampled_lifetime", 0)),
                flat.get("time_total_s", 0.0),
                digest,
            )
        )

    def reached(self, result: Mapping[str, Any]) -> bool:
        """Return whether a trial has reached a limit, or the user has interrupted the training."""
        flat = flatten(result)
        return self.interrupted or any(flat.get(key, float("-inf")) >= limit for key, limit in self.stop.items())

    def interrupt(self, number: int) -> None:
        """End after this iteration with a checkpoint, or immediately at a second SIGINT or SIGTERM.

        A second signal of another kind, such as that of a closed terminal, is ignored.

        Raises:
            Interrupted: It is the second interruption.
        """
        if self.interrupted:
            if number in (signal.SIGINT, signal.SIGTERM):
                raise Interrupted(number)
            return
        self.interrupted = True
        for line in self._lines.values():
            line.close()
        print(
            "stopping after this iteration, with a checkpoint; interrupt again to stop immediately",
            file=self.stream,
            flush=True,
        )

    def close(self) -> None:
        """Close the logs."""
        for log in self._logs.values():
            log.close()
        for line in self._lines.values():
            line.close()


@contextmanager
def monitored(monitor: Monitor) -> Iterator[None]:
    """Set the monitor that Tune's callback and stopper use, and let it handle signals, within a context."""
    global _monitor
    _monitor = monitor
    try:
        with handled(monitor.interrupt):
            yield
    finally:
        _monitor = None
        monitor.close()


class RunCallback(tune.Callback):
    """Callback that passes Tune's events to the monitor."""

    def on_trial_start(self, iteration: int, trials: list[Any], trial: Any, **_: Any) -> None:
        """Pass the start of a trial to the monitor."""
        if _monitor is not None:
            _monitor.on_start(_trial_name(trial))

    def on_trial_result(self, iteration: int, trials: list[Any], trial: Any, result: dict[str, Any], **_: Any) -> None:
        """Pass the result of an iteration to the monitor."""
        if _monitor is not None:
            _monitor.on_result(_trial_name(trial), result)

    def on_checkpoint(self, iteration: int, trials: list[Any], trial: Any, checkpoint: Any, **_: Any) -> None:
        """Pass a complete checkpoint to the monitor."""
        if _monitor is not None:
            _monitor.on_checkpoint(Path(checkpoint.path), trial.last_result)


class RunStopper(tune.Stopper):
    """Stopper that ends a trial according to the monitor."""

    def __call__(self, trial_id: str, result: dict[str, Any]) -> bool:
        """Return whether the trial must end."""
        return _monitor is not None and _monitor.reached(result)

    def stop_all(self) -> bool:
        """Return False, because each trial ends separately, with a checkpoint."""
        return False


def folder_name(trial: Any) -> str:
    """Return the name of the folder of a new trial, which contains its number in the experiment."""
    number = (trial.config.get("env_config") or {}).get(TRIAL_KEY)
    return f"trial_{str(trial.trial_id).rpartition('_')[2]}" if number is None else trial_folder_name(number)


def _trial_name(trial: Any) -> str:
    """Return the name of a trial; it does not change when a scheduler gives the trial another one's configuration."""
    return trial.storage.trial_dir_name or folder_name(trial)


def read_failure(path: Path) -> dict[str, str]:
    """Return the user's error that an environment has written to a file; empty if there is none."""
    deadline = time.monotonic() + 1.0
    while path.is_file() and time.monotonic() < deadline:
        try:
            found: dict[str, str] = json.loads(path.read_text(encoding="utf-8"))
            return found
        except ValueError:  # the file is still being written
            time.sleep(0.05)
    return {}
