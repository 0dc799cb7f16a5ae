"""The folders of the trials of a search, ``trials/NAME`` in the folder of the run, and the results of the trials.

trials/<trial>/
    params.json               the searched values and the seed
    experiment.resolved.yml   the whole configuration of the trial, with which it can be repeated by itself
    run.json, progress.csv, result.json, tensorboard/      as in the folder of a run
    checkpoint_<number>/      the newest checkpoints

`recipes_of` groups training runs, or trials of a search, that differ only in their seed.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from safe_inspect.errors import CheckpointError, OutputError, SafeInspectError
from safe_inspect.experiments.modules.checkpoints import find_newest
from safe_inspect.experiments.modules.run_folder import (
    RunFolder,
    digest,
    learning_configuration,
    parameters_text,
    value_text,
    without,
)
from safe_inspect.experiments.runs.progress import read_progress
from safe_inspect.experiments.runs.training_run import Settings, TrainingRun
from safe_inspect.experiments.settings.search import Trial, experiment_of

_DATE = re.compile(r"_\d{4}-\d{2}-\d{2}_\d{2}-\d{2}-\d{2}(_\d+)?$")
_MOST_KEYS = 3  # largest number of keys in a label


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
        # The folder exists if a run was killed before this suggested trial had started.
        own.path.mkdir(parents=True, exist_ok=True)
        own.write_parameters(trial.values, trial.seed)
    except OSError as error:
        raise OutputError(f"{own.path}: the folder of the trial cannot be written ({error.strerror})") from error
    own.write_record(text="\n".join(lines), seed=trial.seed or 0, configuration=learning)


def check_trials(folder: RunFolder, settings: Settings) -> None:
    """Check that a search to resume has the expected number of trials.

    Raises:
        CheckpointError: The run has another number of trials.
    """
    found = len(folder.trial_folders())
    if found != len(settings.trials) and not (settings.suggested and found < len(settings.trials)):
        raise CheckpointError(
            f"{folder.path}: the search has {found} trials, but this experiment requires {len(settings.trials)}; "
            "resume it with the same `num_samples`, or start a new run"
        )


def read_trials(folder: RunFolder) -> tuple[TrialResult, ...]:
    """Return the results of the trials of a search."""
    return tuple(map(_read, folder.trial_folders()))


def _read(folder: RunFolder) -> TrialResult:
    last = next(reversed(read_progress(folder.progress)), {})
    newest, _ = find_newest(folder.path)
    return TrialResult(
        folder.path,
        folder.read_parameters(),
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
        values = (value_text(trial.parameters.get(name)) for name in names)
        returned = f"{trial.return_mean:.3f}" if math.isfinite(trial.return_mean) else "-"
        success = f"{100 * trial.success_rate:.0f} %" if math.isfinite(trial.success_rate) else "-"
        checkpoint = trial.checkpoint.name if trial.checkpoint else "-"
        rows.append((trial.folder.name, *values, str(trial.iteration), returned, success, checkpoint))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def learning_curves_in(folder: str | os.PathLike[str]) -> list[Path]:
    """Return the ``progress.csv`` of a run, or those of its trials if it is a search; empty if there are none."""
    path = Path(folder).expanduser()
    own = path if path.is_file() else RunFolder(path).progress
    return [own] if own.is_file() else sorted(path.glob("trials/*/progress.csv"))


def _progress_files(folder: str | os.PathLike[str]) -> list[Path]:
    """Return the ``progress.csv`` of a run, or those of its trials if the run is a search.

    Raises:
        SafeInspectError: There is no ``progress.csv``.
    """
    path, found = Path(folder).expanduser(), learning_curves_in(folder)
    if not found:
        what = "there is no such folder" if not path.exists() else "there is no progress.csv in this folder"
        raise SafeInspectError(f"{os.fspath(folder)}: {what}; give the folder of a training run")
    return found


def one_recipe(folder: str | os.PathLike[str]) -> list[Path]:
    """Return the files of the learning curves of a run, or of a search whose trials differ only in their seed.

    Raises:
        SafeInspectError: There is no learning curve, or the trials of the search differ in more than their seed.
    """
    files = _progress_files(folder)
    recipes = {"": files} if len(files) == 1 else recipes_of([folder])
    if len(recipes) > 1:
        raise SafeInspectError(
            f"{os.fspath(folder)}: the trials of this search differ in more than their seed ({'; '.join(recipes)}); "
            "give the folders of single trials, trials/NAME"
        )
    return next(iter(recipes.values()))


def recipes_of(folders: Sequence[str | os.PathLike[str]], labels: Sequence[str] = ()) -> dict[str, list[Path]]:
    """Return the files of the learning curves of runs by recipe; runs that differ only in their seed form one recipe.

    The trials of a search count as runs, each with the values that it used.

    Args:
        folders: The runs' folders.
        labels: A label for each run (equal labels form one recipe), or one for each recipe in the order of their first
            runs. By default a recipe is named by the values in which it differs from the others.

    Raises:
        SafeInspectError: A folder is not that of a run, the number of labels is neither that of the runs nor that of
            the recipes, or one label is given for a search whose trials differ in more than their seed.
    """
    if labels and len(labels) == len(folders):
        files = [one_recipe(folder) for folder in folders]
        return _together((label, path) for label, paths in zip(labels, files, strict=True) for path in paths)
    runs = [path for folder in folders for path in _progress_files(folder)]
    configurations = [_configuration(path) for path in runs]
    keys = [digest(configuration) for configuration in configurations]
    found = _together(zip(keys, runs, strict=True))
    first = [keys.index(key) for key in found]
    if labels and len(labels) != len(found):
        raise SafeInspectError(
            f"{len(labels)} labels are given for {len(folders)} runs of {len(found)} recipes; give a label for each "
            "run or for each recipe"
        )
    names = list(labels) or _names([configurations[index] for index in first], [runs[index] for index in first])
    return dict(zip(names, found.values(), strict=True))


def _together(pairs: Iterable[tuple[str, Path]]) -> dict[str, list[Path]]:
    found: dict[str, list[Path]] = {}
    for key, path in pairs:
        found.setdefault(key, []).append(path)
    return found


def _configuration(progress: Path) -> Mapping[str, Any]:
    """Return the learning configuration of a run without its seed; without a record, the folder's name without date."""
    run = RunFolder(progress.parent)
    if not run.record.is_file():
        return {"name": _stem(progress)}
    configuration: Mapping[str, Any] = without(run.read_record()["configuration"], {"seed"})
    return configuration


def _name(progress: Path) -> str:
    """Return the name of a run's folder; for a trial the names of the search's folder and of the trial."""
    folder = progress.resolve().parent
    return f"{folder.parents[1].name} {folder.name}" if folder.parent.name == "trials" else folder.name


def _stem(progress: Path) -> str:
    """Return the name of a run's folder (see `_name`) without the date of the run."""
    run, *trial = _name(progress).split(" trial_")
    return " trial_".join([_DATE.sub("", run), *trial])


def _names(configurations: Sequence[Mapping[str, Any]], files: Sequence[Path]) -> list[str]:
    """Return a name for each recipe: its values of the keys that differ, or the folder's name if too many differ."""
    # The record of an experiment repeats the keys of policies under `rllib_configs` and `policies`.
    flat = [dict(_leaves(without(configuration, {"policy"}))) for configuration in configurations]
    paths = list(dict.fromkeys(path for leaves in flat for path in leaves))
    # The key and the text of each recipe; used as an ordered set, as agents often have the same.
    differing: dict[tuple[str, ...], None] = {}
    for path in paths:
        values = [leaves.get(path) for leaves in flat]
        if any(value != values[0] for value in values):
            texts = (value_text(leaves[path]) if path in leaves else "none" for leaves in flat)
            differing[(path.rpartition(".")[2], *texts)] = None
    names = [", ".join(f"{key} {texts[index]}" for key, *texts in differing) for index in range(len(flat))]
    short = 0 < len(differing) <= _MOST_KEYS and all(len(name) < 60 for name in names)
    if short and len(set(names)) == len(names) and "name" not in paths:
        return names
    for naming in (_stem, _name):
        names = [naming(path) for path in files]
        if len(set(names)) == len(names):
            return names
    return [f"{name} {number}" for number, name in enumerate(names, 1)]


def _leaves(value: Any, path: str = "") -> Iterable[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _leaves(item, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        for index, item in enumerate(value):
            yield from _leaves(item, f"{path}[{index}]")
    else:
        yield path, value
