"""`train`: training of policies with RLlib."""

from __future__ import annotations

import errno
import math
import os
import shutil
import sys
import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO, cast

from safe_inspect.errors import CheckpointError, ConfigError, OutputError, SafeInspectError
from safe_inspect.experiments.modules.checkpoints import SEAL, Checkpoint, find_newest
from safe_inspect.experiments.modules.run_folder import RunFolder, digest, learning_configuration
from safe_inspect.experiments.runs import cluster
from safe_inspect.experiments.runs.progress import Messages
from safe_inspect.experiments.runs.training_run import Settings, TrainingRun, read_settings
from safe_inspect.experiments.runs.trials import TrialResult, check_trials, read_trials, write_trial
from safe_inspect.outputs import check_parent, exclusive, is_full


@dataclass(frozen=True)
class TrainingResult:
    """Result of a training.

    Attributes:
        folder: The run's folder.
        checkpoint: The newest complete checkpoint; None for a search.
        iteration: Number of iterations of the run, including earlier attempts; for a search, of its longest trial.
        steps: Number of environment steps of the run; for a search, of all its trials.
        seconds: Duration of this attempt, including the start of Ray [s].
        metrics: Values of the last iteration, by paths such as ``env_runners/episode_return_mean``.
        interrupted: Whether the user ended the training.
        trials: Results of the trials of a search; empty without a search.
        best: The checkpoint of this attempt with the best `checkpoint_score_attribute`, or None if that is not set; for
            a search, the folder of the best trial by the metric that ranks trials.
    """

    folder: Path
    checkpoint: Path | None
    iteration: int
    steps: int
    seconds: float
    metrics: Mapping[str, float]
    interrupted: bool
    trials: tuple[TrialResult, ...] = ()
    best: Path | None = None


def train(run: TrainingRun, stream: TextIO | None = None) -> TrainingResult:
    """Train, or resume an earlier training.

    Args:
        run: What to train.
        stream: Stream for the progress; standard error by default.

    Returns:
        The result of the training.

    Raises:
        ConfigError: RLlib, Tune or Ray does not accept a key or a value.
        CheckpointError: The run to resume has another configuration, or has no complete checkpoint.
        OutputError: The run folder cannot be written.
        SafeInspectError: An environment or a plugin reported an error of the user.
    """
    stream = cast(TextIO, Messages(stream or sys.stderr))
    settings = read_settings(run.rllib, run.tune, run.ray, run.policies)
    if settings.problems:
        raise ConfigError(settings.problems)
    learning = learning_configuration(run.experiment, settings.rllib.settings, settings.policies)
    if run.resume is not None:
        RunFolder.open(run.resume).check_configuration(learning)
    else:
        check_parent(Path(run.output))
    started = time.monotonic()
    cluster.set_environment()
    from safe_inspect.experiments.runs import tune_run  # loads Ray and Torch

    # Keys that only the loaded Ray knows are checked before anything is written.
    claim = tune_run.check(run, settings)
    with ExitStack() as stack:
        folder, start = _open(run, settings, learning, stack, stream)
        reached = [] if start is None else _reached(start, settings.tune.settings["stop"])
        if start is not None and reached:
            more = " ".join(f"{key}={2 * value:.16g}" for key, value in reached)
            text = f"the run has reached its limits at iteration {start.iteration}; raise `stop` to continue"
            print(f"{text}, as in {more}", file=stream)
            return TrainingResult(folder.path, start.path, start.iteration, start.steps, 0.0, {}, False)
        try:
            monitor = tune_run.run_tune(run, settings, folder, digest(learning), start, stream, claim)
        except ConfigError:
            if run.resume is None:  # nothing has been trained, so the folder is removed
                shutil.rmtree(folder.path, ignore_errors=True)
            raise
        except KeyboardInterrupt as stop:
            if _has_checkpoint(folder):
                stop.add_note(f"the checkpoints are complete; continue with --resume {folder.path}")
            elif not folder.progress.exists() and run.resume is None:
                shutil.rmtree(folder.path, ignore_errors=True)
            raise
        except SafeInspectError:
            raise
        except Exception as error:  # Ray, Tune and PyArrow report a full disk by many different errors or not at all
            hint = f"continue with --resume {folder.path}"
            hint = hint if _has_checkpoint(folder) else "start again, because there is no checkpoint yet"
            if not is_full(folder.path):
                if tune_run.process_died(error):
                    what = f"{folder.path}: a process of the training was killed, or the machine ran out of memory"
                    raise SafeInspectError(f"{what}; {hint}") from None
                if _has_checkpoint(folder):
                    error.add_note(f"the checkpoints are complete; {hint}")
                raise
            what = f"{folder.path}: the disk is full ({os.strerror(errno.ENOSPC)})"
            raise OutputError(f"{what}; free some space and {hint}") from None
    trials = read_trials(folder)
    newest = None if trials else find_newest(folder.path)[0]
    iteration = int(monitor.last.get("training_iteration", start.iteration if start else 0))
    steps = int(monitor.last.get("num_env_steps_sampled_lifetime", start.steps if start else 0))
    return TrainingResult(
        folder.path,
        newest.path if newest else None,
        max((trial.iteration for trial in trials), default=iteration),
        sum(trial.steps for trial in trials) if trials else steps,
        time.monotonic() - started,
        {key: value for key, value in monitor.last.items() if math.isfinite(value)},
        monitor.interrupted,
        trials,
        monitor.best,
    )


def _has_checkpoint(folder: RunFolder) -> bool:
    """Return whether a run has a complete checkpoint of any of its trials."""
    return any(folder.path.glob(f"**/checkpoint_*/{SEAL}"))


def _open(
    run: TrainingRun, settings: Settings, learning: Mapping[str, Any], stack: ExitStack, stream: TextIO
) -> tuple[RunFolder, Checkpoint | None]:
    """Create and lock the run's folder; for a resumed run, open it and find the checkpoint to continue from."""
    if run.resume is None:
        folder = RunFolder.create(run.output, run.name)
        stack.enter_context(exclusive(folder.path, "training in"))
        seed = settings.trials[0].seed or 0
        try:
            folder.write_record(text=run.text, seed=seed, configuration=learning)
            for trial in () if settings.single or settings.suggested else settings.trials:
                write_trial(folder, run, settings, trial)
        except OutputError:
            shutil.rmtree(folder.path, ignore_errors=True)
            raise
        return folder, None
    folder = RunFolder.open(run.resume)
    stack.enter_context(exclusive(folder.path, "training in"))
    if not settings.single:
        check_trials(folder, settings)
        return folder, None
    newest, refused = find_newest(folder.path, digest(learning))
    for sentence in refused:
        print(f"skipped {sentence}", file=stream)
    if newest is None:
        if refused:
            raise CheckpointError(
                f"{folder.path}: the run has no complete checkpoint of this configuration; start a new run"
            )
        print(f"{folder.path}: the run has no checkpoint yet; it starts again", file=stream)
    return folder, newest


def _reached(start: Checkpoint, stop: Mapping[str, float]) -> list[tuple[str, float]]:
    """Return each limit that a checkpoint has reached, with its value there; resuming would add an iteration to it."""
    values = {
        "training_iteration": start.iteration,
        "num_env_steps_sampled_lifetime": start.steps,
        "time_total_s": start.seconds,
    }
    return [(key, values[key]) for key, limit in stop.items() if key in values and values[key] >= limit]
