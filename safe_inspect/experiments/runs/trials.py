"""The folders of the trials of a search, ``trials/NAME`` in the folder of the run, and the results of the trials.

trials/<trial>/
    params.json               the searched values and the seed
    experiment.resolved.yml   the whole configuration of the trial, with which it can be repeated by itself
    run.json, progress.csv, result.json, tensorboard/      as in the folder of a run
    checkpoint_<number>/      the newest checkpoints
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from safe_inspect.errors import CheckpointError, OutputError
from safe_inspect.experiments.files import run_folder
from safe_inspect.experiments.files.checkpoints import find_newest
from safe_inspect.experiments.files.learning_configuration import learning_configuration
from safe_inspect.experiments.files.run_folder import (
    RunFolder,
    parameters_text,
    read_parameters,
    trial_folders,
    value_text,
    write_parameters,
)
from safe_inspect.experiments.runs.training_log import read_progress
from safe_inspect.experiments.settings.search import Trial, experiment_of

if TYPE_CHECKING:
    from safe_inspect.experiments.runs.training_run import Settings, TrainingRun


@dataclass(frozen=True)
class TrialResult:
    """Result of a trial of a search.

    Attributes:
        folder: Its folder, which `evaluate`, `export` and `curves` accept like the folder of a run.
        parameters: The searched values and the seed.
        iteration: Its last iteration; 0 before the first.
        steps: Number of environment steps.
        return_mean: Mean return of the last iteration; NaN if no episode has ended.
        success_rate: Fraction of successful episodes in the last iteration; NaN if no episode has ended.
        checkpoint: The newest complete checkpoint; None if there is none.
    """

    folder: Path
    parameters: Mapping[str, Any]
    iteration: int
    steps: int
    return_mean: float
    success_rate: float
    checkpoint: Path | None


def write_trial(folder: RunFolder, run: TrainingRun, settings: Settings, trial: Trial) -> None:
    """Write the values, the configuration and the record of a trial before it trains.

    Raises:
        OutputError: The folder of the trial cannot be written.
    """
    head = run.text.partition("\n")[0]
    own = RunFolder(folder.trials / trial.name)
    experiment = experiment_of(run.experiment, trial)
    lines = [
        *([head] if head.startswith("#") else []),
        f"# {trial.name} of a search: {parameters_text({**trial.values, 'seed': trial.seed})}",
        yaml.safe_dump(experiment, sort_keys=False, width=120),
    ]
    learning = learning_configuration(experiment, trial.rllib.settings, settings.policies)
    try:
        own.path.mkdir(
            parents=True, exist_ok=True
        )  # it exists if a run was killed before this suggested trial had started
        write_parameters(own.path, trial.values, trial.seed)
    except OSError as error:
        raise OutputError(f"{own.path}: the folder of the trial cannot be written ({error.strerror})") from error
    run_folder.write_run_record(own, text="\n".join(lines), seed=trial.seed or 0, configuration=learning)


def check_trials(folder: RunFolder, settings: Settings) -> None:
    """Check that a search to resume has the expected number of trials.

    Raises:
        CheckpointError: The run has another number of trials.
    """
    found = len(trial_folders(folder.path))
    if found != len(settings.trials) and not (settings.suggested and found < len(settings.trials)):
        raise CheckpointError(
            f"{folder.path}: the search has {found} trials, but this experiment requires {len(settings.trials)}; "
            "resume it with the same `num_samples`, or start a new run"
        )


def read_trials(folder: RunFolder) -> tuple[TrialResult, ...]:
    """Return the results of the trials of a search."""
    return tuple(_read(path) for path in trial_folders(folder.path))


def _read(folder: Path) -> TrialResult:
    last = next(reversed(read_progress(RunFolder(folder).progress)), {})
    newest = find_newest(folder).newest
    return TrialResult(
        folder,
        read_parameters(folder),
        int(last.get("iteration", 0)),
        int(last.get("steps", 0)),
        last.get("return_mean", math.nan),
        last.get("success_rate", math.nan),
        newest.path if newest else None,
    )


def trial_table(trials: Sequence[TrialResult]) -> list[str]:
    """Return the lines of a table with the values, the seed and the result of each trial."""
    names = list(dict.fromkeys(name for trial in trials for name in trial.parameters))
    rows = [("trial", *names, "iterations", "return", "success", "checkpoint")]
    for trial in trials:
        success = f"{100 * trial.success_rate:.0f} %" if math.isfinite(trial.success_rate) else "-"
        rows.append(
            (
                trial.folder.name,
                *(value_text(trial.parameters.get(name)) for name in names),
                str(trial.iteration),
                f"{trial.return_mean:.3f}" if math.isfinite(trial.return_mean) else "-",
                success,
                trial.checkpoint.name if trial.checkpoint else "-",
            )
        )
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
