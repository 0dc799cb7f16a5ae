"""The folder of a training run: its configuration, the version of the code, and its results.

<output>/<name>_<date>_<time>/
    experiment.resolved.yml   the whole configuration
    run.json                  version, commit, seed, command, attempts
    progress.csv              one row for each iteration
    result.json               one line for each iteration, with all values
    tensorboard/              the same values for TensorBoard
    tune/<attempt>/           Tune's own state and the checkpoints
    trials/                   only for a search, instead of the logs and `tune`: a folder for each trial, see `trials`
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Collection, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from safe_inspect.config.keys.rllib_keys import PLACE_KEYS
from safe_inspect.config.spec import PolicySpec
from safe_inspect.errors import CheckpointError, OutputError
from safe_inspect.evaluation.task import differences
from safe_inspect.outputs import new_file
from safe_inspect.version import __version__

_MISSING = "nothing"

#: Keys of an experiment that do not affect what is learnt, or that are compared separately.
_APART = frozenset({"rllib_configs", "tune_config", "ray_config", "output_path", "TrialName"})

_HINT = "give another folder with --output"
PARAMETERS = "params.json"


def learning_configuration(
    experiment: Mapping[str, Any], rllib: Mapping[str, Any], policies: Mapping[str, PolicySpec] | None = None
) -> dict[str, Any]:
    """Return the configuration that decides the result of a training.

    It contains the experiment, the settings of the algorithm and the policies. Keys that only affect where, how fast
    and how long the run computes are omitted, so that a resumed run may change them. The experiment's own
    `rllib_configs` are omitted too, because `rllib` contains their translation.

    Args:
        experiment: The resolved experiment.
        rllib: The translated settings of the algorithm.
        policies: The policies by name if there are several agents.
    """
    settings = {key: value for key, value in rllib.items() if key not in PLACE_KEYS}
    learning = {"experiment": without(experiment, _APART), "rllib_configs": settings}
    if policies:
        learning["policies"] = {
            name: {
                "name": name,
                "agents": policy.agents,
                "settings": policy.config,
                "checkpoint": policy.checkpoint,
                "source_policy": policy.source_policy,
            }
            for name, policy in policies.items()
        }
    plain: dict[str, Any] = json.loads(json.dumps(learning, default=str))
    return plain


def digest(configuration: Mapping[str, Any]) -> str:
    """Return a short hash of a configuration that does not depend on the order of its keys."""
    text = json.dumps(configuration, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def without(value: Any, names: Collection[str]) -> Any:
    """Return a configuration without the keys of the given names, at any depth."""
    if isinstance(value, Mapping):
        return {key: without(item, names) for key, item in value.items() if key not in names}
    return [without(item, names) for item in value] if isinstance(value, list) else value


def _short_text(value: Any) -> str:
    """Return a value as text of at most 60 characters."""
    text = value if value == _MISSING else json.dumps(value, default=str)
    return text if len(text) <= 60 else f"{text[:57]}..."


class RunFolder:
    """The folder of a run, or of a trial of a search.

    Attributes:
        path: The folder.
        configuration: The resolved configuration.
        record: The record of the run: version, commit, seed, attempts.
        parameters: The searched values of a trial and its seed; runs have no such file.
        progress: The learning curve.
        tune: Tune's folder, which contains one folder for each attempt.
        trials: Tune's folder of a search, which contains one folder for each trial.
        failure: The file to which an environment writes a user's error.
        compiling_note: The file that exists while a process of the run compiles.
        ray_note: The file with the path of the temporary folder of the run's Ray.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.configuration, self.record = path / "experiment.resolved.yml", path / "run.json"
        self.parameters = path / PARAMETERS
        self.progress, self.failure = path / "progress.csv", path / "failure.json"
        self.tune, self.trials = path / "tune", path / "trials"
        self.compiling_note, self.ray_note = path / ".compiling", path / ".ray"

    @classmethod
    def create(cls, output: str | os.PathLike[str], name: str) -> RunFolder:
        """Create a new folder in `output`, named after the experiment and the time.

        Raises:
            OutputError: The folder cannot be created or written.
        """
        parent = Path(output).expanduser().absolute()
        stem = f"{_file_name(name)}_{datetime.now():%Y-%m-%d_%H-%M-%S}"
        try:
            parent.mkdir(parents=True, exist_ok=True)
            for number in range(1, 1000):
                path = parent / (stem if number == 1 else f"{stem}_{number}")
                try:
                    path.mkdir()
                except FileExistsError:
                    continue
                return cls(path)
        except OSError as error:
            reason = error.strerror or str(error)
            raise OutputError(
                f"{parent}: the output folder cannot be written ({reason}); give another with --output"
            ) from error
        raise OutputError(
            f"{parent}: there are already a thousand runs named {stem}; give another folder with --output"
        )

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> RunFolder:
        """Return the folder of an earlier run.

        Raises:
            CheckpointError: It is not the folder of a run, or its record is damaged.
        """
        folder = cls(Path(path).expanduser().absolute())
        if not folder.record.is_file():
            hint = "give the folder that contains run.json and experiment.resolved.yml"
            raise CheckpointError(f"{path}: this is not the folder of a training run; {hint}")
        folder.read_record()
        return folder

    def write_record(self, *, text: str, seed: int, configuration: Mapping[str, Any]) -> None:
        """Write the resolved configuration and `run.json` of a new run.

        Args:
            text: The resolved configuration, as YAML.
            seed: The seed of the run.
            configuration: The configuration that a resumed run must have too, from `learning_configuration`.
        """
        with new_file(self.configuration, _HINT) as work:
            work.write_text(text, encoding="utf-8")
        self._update(
            {
                "safe_inspect": __version__,
                "git_commit": git_commit(),
                "python": platform.python_version(),
                "seed": seed,
                "digest": digest(configuration),
                "attempts": [],
                "configuration": configuration,
            }
        )

    def read_record(self) -> dict[str, Any]:
        """Return the content of `run.json`.

        Raises:
            CheckpointError: The file is damaged.
        """
        try:
            record: dict[str, Any] = json.loads(self.record.read_text(encoding="utf-8"))
            record["digest"], record["attempts"], record["configuration"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise CheckpointError(f"{self.record}: the record of the run is damaged ({error})") from error
        return record

    def _update(self, record: Mapping[str, Any]) -> None:
        with new_file(self.record, _HINT) as work:
            work.write_text(json.dumps(record, indent=2, default=str) + "\n", encoding="utf-8")

    def add_attempt(self, command: Sequence[str], continued_from: str = "", iteration: int = 0) -> int:
        """Record in `run.json` that a training starts, and return the number of the attempt, from 0.

        Args:
            command: The command line; by default that of this process.
            continued_from: Path of the checkpoint from which the training continues; empty without one.
            iteration: The iteration of that checkpoint.
        """
        record = self.read_record()
        record["attempts"].append(
            {
                "started": datetime.now().astimezone().isoformat(timespec="seconds"),
                "command": shlex.join(command or sys.argv),
                "host": platform.node(),
                "continued_from": continued_from,
                "iteration": iteration,
            }
        )
        self._update(record)
        return len(record["attempts"]) - 1

    def copy_attempt(self, search: RunFolder) -> None:
        """Copy the newest attempt of a search into the `run.json` of this trial, which starts."""
        record = self.read_record()
        record["attempts"].append(search.read_record()["attempts"][-1])
        self._update(record)

    def check_configuration(self, configuration: Mapping[str, Any]) -> None:
        """Check that a run to resume has the given configuration.

        Raises:
            CheckpointError: The configuration differs; the message lists the differences.
        """
        record = self.read_record()
        if record["digest"] == digest(configuration):
            return
        found = [
            f"  {path}: {_short_text(old)} in the run, {_short_text(new)} now"
            for path, old, new in differences(record["configuration"], configuration, missing=_MISSING)
        ]
        shown = "\n".join(found[:8]) + ("\n  ..." if len(found) > 8 else "")
        raise CheckpointError(
            f"{self.path}: the run has another configuration, so it cannot be resumed with this one:\n{shown}\n"
            "resume it without --cfg and overrides, or start a new run"
        )

    def write_parameters(self, values: Mapping[str, Any], seed: int | None) -> None:
        """Write the searched values of a trial and its seed."""
        self.parameters.write_text(json.dumps({**values, "seed": seed}, indent=2) + "\n", encoding="utf-8")

    def read_parameters(self) -> dict[str, Any]:
        """Return the searched values of a trial and its seed.

        Raises:
            CheckpointError: The values cannot be read.
        """
        try:
            return dict(json.loads(self.parameters.read_text(encoding="utf-8")))
        except (OSError, ValueError, TypeError) as error:
            raise CheckpointError(f"{self.parameters}: the values of the trial cannot be read ({error})") from error

    def trial_folders(self) -> list[RunFolder]:
        """Return the folders of the trials of a search; empty for a run without a search."""
        return [RunFolder(path.parent) for path in sorted(self.trials.glob(f"*/{PARAMETERS}"))]


def git_commit() -> str | None:
    """Return the commit of this package's source, with ``+`` for uncommitted changes; None outside a repository."""
    here = Path(__file__).parent

    def git(*arguments: str) -> str | None:
        try:
            run = subprocess.run(["git", *arguments], cwd=here, capture_output=True, text=True, timeout=5, check=True)
        except (OSError, subprocess.SubprocessError):
            return None
        return run.stdout.strip()

    if git("ls-files", "--error-unmatch", Path(__file__).name) is None:  # installed inside another project's repository
        return None
    commit = git("rev-parse", "HEAD")
    return f"{commit}+" if commit and git("status", "--porcelain", "--untracked-files=no", "--", "..") else commit


def _file_name(name: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-_." else "-" for letter in name).strip(".-") or "run"


def parameters_text(parameters: Mapping[str, Any]) -> str:
    """Return values as one line, such as ``lr 0.0001, seed 3``."""
    return ", ".join(f"{key} {value_text(value)}" for key, value in parameters.items())


def value_text(value: Any) -> str:
    """Return a value as short text; for a schedule only its values, such as ``0.001 to 0.0001``."""
    if isinstance(value, list) and value and all(isinstance(pair, list) and len(pair) == 2 for pair in value):
        return " to ".join(value_text(late) for _, late in value)
    if isinstance(value, float):
        return f"{value:.6g}"
    return (value if isinstance(value, str) else json.dumps(value, default=str)).replace('"', "")
