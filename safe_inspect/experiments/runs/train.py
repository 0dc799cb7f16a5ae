"""Train a policy with RLlib: `train` takes what a command has read and returns what came of it."""

from __future__ import annotations

import errno
import math
import os
import shutil
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO, cast

from safe_inspect import errors
from safe_inspect.config.spec import Policy
from safe_inspect.errors import CheckpointError, ConfigError, OutputError, SafeInspectError
from safe_inspect.experiments.adapters.environment import DEFAULT_MAKER
from safe_inspect.experiments.runs import cluster, run_folder
from safe_inspect.experiments.runs.checkpoints import SEAL, Checkpoint, find_newest
from safe_inspect.experiments.runs.progress import Messages
from safe_inspect.experiments.runs.run_folder import RunFolder
from safe_inspect.experiments.runs.trials import TrialResult, check_trials, read_trials, write_trials
from safe_inspect.experiments.settings.policies import PolicySettings, read_policies
from safe_inspect.experiments.settings.search import Trial, trials_of
from safe_inspect.experiments.settings.translation import Translation, translate_ray, translate_rllib, translate_tune
from safe_inspect.experiments.settings.values import is_searched
from safe_inspect.outputs import is_full


@dataclass(frozen=True)
class TrainingRun:
    """What to train.

    Attributes:
        experiment: The resolved configuration from which the environment is built, as plain data.
        rllib: The mapping `rllib_configs`, merged.
        tune: The mapping `tune_config`, merged.
        ray: The mapping `ray_config`, merged.
        text: The resolved configuration as YAML, for the run folder.
        name: Name of the experiment, with which the run folder begins.
        output: Where run folders are made.
        resume: The folder of an earlier run that is to go on.
        command: The command line, for the record.
        maker: ``module:function`` that builds the environments, see `environment.make_environment`.
        policies: The policies of the agents that act from outside; needed for several agents only.
    """

    experiment: Mapping[str, Any]
    rllib: Mapping[str, Any] = field(default_factory=dict)
    tune: Mapping[str, Any] = field(default_factory=dict)
    ray: Mapping[str, Any] = field(default_factory=dict)
    text: str = ""
    name: str = "training"
    output: Path = Path("output")
    resume: Path | None = None
    command: Sequence[str] = ()
    maker: str = DEFAULT_MAKER
    policies: Sequence[Policy] = ()


@dataclass(frozen=True)
class TrainingResult:
    """What came of a training.

    Attributes:
        folder: The run's folder.
        checkpoint: The newest complete checkpoint; None of a search.
        iteration: Iterations of the run, earlier attempts included; of a search, of its longest trial.
        steps: Environment steps of the run; of a search, of all its trials.
        seconds: Duration of this attempt, Ray's start included [s].
        metrics: The last iteration, as paths such as ``env_runners/episode_return_mean``.
        interrupted: Whether the user ended the training.
        notes: What was translated in the configuration, a sentence each.
        trials: What came of each trial of a search; empty without a search.
    """

    folder: Path
    checkpoint: Path | None
    iteration: int
    steps: int
    seconds: float
    metrics: Mapping[str, float]
    interrupted: bool
    notes: tuple[str, ...]
    trials: tuple[TrialResult, ...] = ()


@dataclass(frozen=True)
class Settings:
    """The three mappings of an experiment that concern the training, translated.

    Attributes:
        rllib: Settings of the algorithm.
        tune: Settings of Tune.
        ray: Settings of Ray.
        policies: The policies by name where there are several agents.
        policy_notes: What was translated in the policies' own keys.
        policy_problems: The mistakes in them.
        trials: What Tune trains, one or several; none where there are mistakes in `rllib`.
        trial_problems: The mistakes of single combinations of values that are searched.
    """

    rllib: Translation
    tune: Translation
    ray: Translation
    policies: Mapping[str, PolicySettings] = field(default_factory=dict)
    policy_notes: tuple[str, ...] = ()
    policy_problems: tuple[errors.Problem, ...] = ()
    trials: tuple[Trial, ...] = ()
    trial_problems: tuple[errors.Problem, ...] = ()

    @property
    def problems(self) -> tuple[errors.Problem, ...]:
        """All mistakes."""
        own = self.rllib.problems + self.trial_problems
        return own + self.policy_problems + self.tune.problems + self.ray.problems

    @property
    def notes(self) -> tuple[str, ...]:
        """All that was translated or dropped."""
        return self.rllib.notes + self.policy_notes + self.tune.notes + self.ray.notes

    @property
    def single(self) -> bool:
        """Whether the run is no search, which has several trials or asks for several values."""
        searched = any(is_searched(value) for value in self.rllib.settings.values())
        return self.tune.settings["num_samples"] == 1 and not searched


def read_settings(
    rllib: Mapping[str, Any], tune: Mapping[str, Any], ray: Mapping[str, Any], policies: Sequence[Policy] = ()
) -> Settings:
    """Translate and check the three mappings and what several policies have of their own, without loading Ray."""
    tuned = translate_tune(tune)
    algorithm = tuned.settings.get("algorithm")
    translated = translate_rllib(rllib, algorithm)
    found, notes, problems = read_policies(policies, translated.settings["algorithm"])
    trials: tuple[Trial, ...] = ()
    wrong: list[errors.Problem] = []
    if not translated.problems and not tuned.problems:
        trials, wrong = trials_of(rllib, translated, algorithm, tuned.settings["num_samples"])
    return Settings(translated, tuned, translate_ray(ray), found, tuple(notes), tuple(problems), trials, tuple(wrong))


def train(run: TrainingRun, stream: TextIO | None = None) -> TrainingResult:
    """Train, or go on with an earlier training.

    Args:
        run: What to train.
        stream: Where progress goes; standard error unless given.

    Raises:
        ConfigError: A key or a value that RLlib, Tune or Ray does not take.
        CheckpointError: The run to resume is of another configuration, or has no complete checkpoint.
        OutputError: The run folder cannot be written.
        SafeInspectError: A user's error in an environment or a plugin.
    """
    stream = cast(TextIO, Messages(stream or sys.stderr))
    settings = read_settings(run.rllib, run.tune, run.ray, run.policies)
    if settings.problems:
        raise ConfigError(settings.problems)
    learning = run_folder.learning_configuration(run.experiment, settings.rllib.settings, settings.policies)
    if run.resume is not None:
        run_folder.check_configuration(run_folder.open_run_folder(run.resume), learning)
    started = time.monotonic()
    cluster.set_environment()
    from safe_inspect.experiments.runs import attempt  # loads Ray and Torch

    attempt.check(run, settings)  # names of keys that only the loaded Ray knows, before anything is written
    with ExitStack() as stack:
        folder, start = _open(run, settings, learning, stack, stream)
        if start is not None and _is_over(start, settings.tune.settings["stop"]):
            print(f"the run has reached its limits at iteration {start.iteration}; raise `stop` to go on", file=stream)
            return TrainingResult(folder.path, start.path, start.iteration, start.steps, 0.0, {}, False, settings.notes)
        try:
            monitor = attempt.run_attempt(run, settings, folder, run_folder.digest(learning), start, stream)
        except ConfigError:
            if run.resume is None:  # nothing has been trained, so nothing is left
                shutil.rmtree(folder.path, ignore_errors=True)
            raise
        except KeyboardInterrupt as stop:
            if _has_checkpoint(folder):
                stop.add_note(f"the checkpoints are whole; go on with --resume {folder.path}")
            elif not folder.progress.exists() and run.resume is None:
                shutil.rmtree(folder.path, ignore_errors=True)
            raise
        except SafeInspectError:
            raise
        except Exception:  # of Ray, Tune and PyArrow, which name a full disk by many errors or by none
            if not is_full(folder.path):
                raise
            hint = f"go on with --resume {folder.path}"
            hint = hint if _has_checkpoint(folder) else "start again, as there is no checkpoint yet"
            what = f"{folder.path}: the disk is full ({os.strerror(errno.ENOSPC)})"
            raise OutputError(f"{what}; free some space and {hint}") from None
    trials = read_trials(folder)
    newest = None if trials else find_newest(folder.path).newest
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
        settings.notes,
        trials,
    )


def _has_checkpoint(folder: RunFolder) -> bool:
    """Return whether a run has a complete checkpoint, of any of its trials."""
    return any(folder.path.glob(f"**/checkpoint_*/{SEAL}"))


def _open(
    run: TrainingRun, settings: Settings, learning: Mapping[str, Any], stack: ExitStack, stream: TextIO
) -> tuple[RunFolder, Checkpoint | None]:
    """Make the run's folder, or find the one to resume and the checkpoint to go on from."""
    if run.resume is None:
        folder = run_folder.create_run_folder(run.output, run.name)
        stack.enter_context(run_folder.locked(folder))
        seed = settings.trials[0].seed or 0
        try:
            run_folder.write_record(folder, text=run.text, seed=seed, configuration=learning)
            if not settings.single:
                write_trials(folder, run, settings)
        except OutputError:
            shutil.rmtree(folder.path, ignore_errors=True)
            raise
        return folder, None
    folder = run_folder.open_run_folder(run.resume)
    stack.enter_context(run_folder.locked(folder))
    if not settings.single:
        check_trials(folder, settings)
        return folder, None
    found = find_newest(folder.path, run_folder.digest(learning))
    for sentence in found.refused:
        print(f"passed over {sentence}", file=stream)
    if found.newest is None:
        if found.refused:
            raise CheckpointError(f"{folder.path}: the run has no complete checkpoint of this configuration")
        print(f"{folder.path}: the run has no checkpoint yet; it starts again", file=stream)
    return folder, found.newest


def _is_over(start: Checkpoint, stop: Mapping[str, float]) -> bool:
    """Return whether a checkpoint is past the limits; else a finished run would grow by one iteration each time."""
    reached = {
        "training_iteration": start.iteration,
        "num_env_steps_sampled_lifetime": start.steps,
        "time_total_s": start.seconds,
    }
    return any(reached[key] >= limit for key, limit in stop.items() if key in reached)


def raise_failure(failure: Mapping[str, str], error: BaseException | None) -> None:
    """Raise the error of a training: the user's own when an environment has left one."""
    kind = getattr(errors, failure.get("error", ""), SafeInspectError)
    if failure:
        raise kind(failure["message"])
    cause = error
    while cause is not None:
        if isinstance(cause, SafeInspectError):
            raise cause
        cause = getattr(cause, "cause", None) or cause.__cause__
    if error is not None:
        raise error
