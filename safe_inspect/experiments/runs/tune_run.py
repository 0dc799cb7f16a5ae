"""One attempt of a training: start Ray, run Tune, stop Ray. Importing this module loads Ray and Torch.

`Monitor` is Tune's callback and stopper, which logs iterations, seals checkpoints and stops the training.
"""

from __future__ import annotations

import json
import logging
import math
import os
import signal
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, TextIO

from ray import tune
from ray.exceptions import RayActorError
from ray.rllib.algorithms.algorithm_config import AlgorithmConfig

from safe_inspect import errors
from safe_inspect.errors import CheckpointError, ConfigError, SafeInspectError
from safe_inspect.experiments.learning.algorithm import build_config, claimed_resources, register_environments
from safe_inspect.experiments.modules.checkpoints import Checkpoint, check_frozen
from safe_inspect.experiments.modules.run_folder import RunFolder, parameters_text
from safe_inspect.experiments.runs import cluster, tune_objects
from safe_inspect.experiments.runs.progress import Heartbeat, TrainingLog, TrainingProgress, flatten
from safe_inspect.experiments.runs.training_run import Settings, TrainingRun
from safe_inspect.experiments.runs.trials import write_trial
from safe_inspect.experiments.runs.tune_objects import TRIAL_KEY
from safe_inspect.experiments.sampling import environment
from safe_inspect.experiments.settings.policies import check_layouts, environment_settings
from safe_inspect.experiments.settings.search import Trial, experiment_of, searches_of, trial_folder_name, trial_of
from safe_inspect.interrupts import Interrupted, handled

_monitor: Monitor | None = None


class Monitor(tune.Callback, tune.Stopper):
    """Callback and stopper for Tune, in the process that started the training.

    Tune pickles it with its own state, from which a search is resumed. Its pickle contains only a reference to the
    monitor that `monitored` sets.

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

    def __reduce__(self) -> tuple[Any, tuple[()]]:
        return _present_monitor, ()

    def on_trial_start(self, iteration: int, trials: list[Any], trial: Any, **_: Any) -> None:
        """Record and print that a trial of a search starts."""
        if self.single:
            return
        name = _trial_name(trial)
        own = RunFolder(self.folder.trials / name)
        own.copy_attempt(self.folder)
        print(f"{name}  {parameters_text(own.read_parameters())}", file=self.stream, flush=True)

    def on_trial_result(self, iteration: int, trials: list[Any], trial: Any, result: dict[str, Any], **_: Any) -> None:
        """Log and print an iteration of a trial."""
        flat, name = flatten(result), _trial_name(trial)
        if not self.single:
            flat["seed"] = float(result["config"]["env_config"]["seed"])  # the seed of a resumed algorithm differs
        self.last = flat
        if name not in self._logs:
            start = self.start or Checkpoint(self.folder.path, 0)
            if self.single:
                self._logs[name] = TrainingLog(self.folder.path, start.iteration, start.steps)
            else:
                self._logs[name] = TrainingLog(self.folder.trials / name, int(flat["training_iteration"]) - 1)
            self._lines[name] = TrainingProgress(self.stop, self.stream, "" if self.single else name)
        self._logs[name].add(flat)
        self.heartbeat.iteration()
        self._lines[name].show(flat)

    def on_checkpoint(self, iteration: int, trials: list[Any], trial: Any, checkpoint: Any, **_: Any) -> None:
        """Seal a checkpoint that Tune has written."""
        flat, path = flatten(trial.last_result), Path(checkpoint.path)
        digest = self.digest if self.single else str(RunFolder(path.parent).read_record()["digest"])
        iteration, steps = (int(flat.get(key, 0)) for key in ("training_iteration", "num_env_steps_sampled_lifetime"))
        Checkpoint(path, iteration, steps, flat.get("time_total_s", 0.0), digest).seal()

    def __call__(self, trial_id: str, result: dict[str, Any]) -> bool:
        """Return whether a trial has reached a limit, or the user has interrupted the training."""
        flat = flatten(result)
        return self.interrupted or any(flat.get(key, float("-inf")) >= limit for key, limit in self.stop.items())

    def stop_all(self) -> bool:
        """Return False, because each trial ends separately, with a checkpoint."""
        return False

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
        text = "stopping after this iteration, with a checkpoint; interrupt again to stop immediately"
        print(text, file=self.stream, flush=True)

    def close(self) -> None:
        """Close the logs."""
        for log in self._logs.values():
            log.close()


def _present_monitor() -> Monitor | None:
    return _monitor


@contextmanager
def monitored(monitor: Monitor) -> Iterator[None]:
    """Set the monitor to which its pickles refer, and let it handle signals, within a context."""
    global _monitor
    _monitor = monitor
    try:
        with handled(monitor.interrupt):
            yield
    finally:
        _monitor = None
        monitor.close()


def folder_name(trial: Any) -> str:
    """Return the name of the folder of a new trial, which contains its number in the experiment."""
    number = (trial.config.get("env_config") or {}).get(TRIAL_KEY)
    return f"trial_{str(trial.trial_id).rpartition('_')[2]}" if number is None else trial_folder_name(number)


def _trial_name(trial: Any) -> str:
    """Return the name of a trial; it does not change when a scheduler gives the trial another one's configuration."""
    return trial.storage.trial_dir_name or folder_name(trial)


def check(run: TrainingRun, settings: Settings) -> cluster.Claim:
    """Check what can only be checked once RLlib is loaded: keys of other algorithms than PPO, and value combinations.

    With several agents, also check that the policies match their agents.

    Returns:
        What the largest trial needs.

    Raises:
        ConfigError: RLlib does not accept a key or a value, or a policy does not match its agents.
        CheckpointError: A policy's checkpoint cannot be read or does not match its agents.
    """
    _quiet()
    environments = environment_settings(run.experiment, settings.trials[0].rllib.settings, maker=run.maker)
    if settings.policies:
        groups = environment.build_team(environments, 1, 0, False).groups
        agents = {name: group.agent for group in groups for name in group.agents}
        problems = check_layouts(settings.policies, agents)
        if problems:
            raise ConfigError(problems)
        for policy in settings.policies.values():
            check_frozen(policy, agents)
    configs = [build_config(trial.rllib, environments, settings.policies) for trial in settings.trials]
    claim = cluster.largest_claim([claimed_resources(config) for config in configs])
    tune_objects.check_objects(settings.tune.settings, searches_of(settings.rllib.settings))
    cluster.check_given(claim, settings.ray.settings)
    return claim


def run_tune(
    run: TrainingRun,
    settings: Settings,
    folder: RunFolder,
    digest: str,
    start: Checkpoint | None,
    stream: TextIO,
    claim: cluster.Claim,
) -> Monitor:
    """Train until a limit is reached, and return the monitor, which contains the last iteration.

    Args:
        run: What to train.
        settings: The translated settings of `run`.
        folder: The run's folder.
        digest: Hash of the learning configuration.
        start: The checkpoint from which the training continues; None for a new training or a search.
        stream: Stream for the progress.
        claim: What the largest trial needs, from `check`.

    Raises:
        ConfigError: A key or a value is not accepted.
        CheckpointError: The training cannot continue from its checkpoint or from Tune's state.
        SafeInspectError: A suggested trial cannot train, or an environment reported an error of the user.
    """
    number = folder.add_attempt(run.command, str(start.path) if start else "", start.iteration if start else 0)
    made = partial(_config, run, settings, folder, number, start)

    def suggested(index: int, values: Mapping[str, Any]) -> dict[str, Any]:
        trial = trial_of(
            run.rllib, settings.tune.settings.get("algorithm"), index, values, index, settings.trials[0].seed
        )
        try:
            if trial.rllib.problems:
                raise ConfigError(trial.rllib.problems)
            write_trial(folder, run, settings, trial)
            return dict(made(trial).to_dict())
        except ConfigError as error:
            raise SafeInspectError(f"{trial.name} with {parameters_text(values)} cannot train: {error}") from None

    tune_objects.Suggestions.make = suggested
    configs = [] if settings.suggested else [made(trial) for trial in settings.trials]
    monitor = Monitor(folder, settings.tune.settings["stop"], stream, digest, start, settings.single)
    folder.failure.unlink(missing_ok=True)
    early = "all episodes start again, so the first rows contain those that end early, such as crashes"
    where = f"continues after iteration {start.iteration}; {early}" if start else "starts"
    if run.resume is not None and not settings.single:
        where = "continues with the trials that have not ended"
    compiles = "code that is not compiled yet on this installation is compiled first, which can take some minutes"
    text = f"{folder.path}: the training {where}; {compiles}; Ray takes some seconds to start"
    print(text, file=stream, flush=True)
    with monitor.heartbeat, cluster.ray_cluster(settings.ray.settings, claim, folder), monitored(monitor):
        _quiet()  # starting Ray resets its log levels
        register_environments(run.maker)
        tuner = _tuner(configs, settings, monitor, number, run.resume is not None)
        results = tuner.fit()
        failed = next(iter(results.errors), None)
        if failed is not None:
            _raise_failure(folder.failure, failed)
    monitor.best = (_best if settings.single else _best_trial)(results, settings.tune.settings)
    if start is not None and monitor.last and monitor.last["training_iteration"] <= start.iteration:
        raise CheckpointError(f"{start.path}: the training did not continue from the checkpoint")
    return monitor


def _config(
    run: TrainingRun, settings: Settings, folder: RunFolder, number: int, start: Checkpoint | None, trial: Trial
) -> AlgorithmConfig:
    experiment = run.experiment
    if not settings.single:
        experiment = experiment_of(experiment, trial)
        number = len(RunFolder(folder.trials / trial.name).read_record()["attempts"])
    more: dict[str, Any] = {"attempt": number, "maker": run.maker, "failure_file": str(folder.failure)}
    if start is not None:
        more["continue_from"] = {"path": str(start.path), "iteration": start.iteration, "seconds": start.seconds}
    environments = environment_settings(experiment, trial.rllib.settings, **more)
    config = build_config(trial.rllib, environments, settings.policies)
    if number and isinstance(config.seed, int):
        config.seed += 10_000 * number  # the noise of the actions must not repeat either
    return config


def _tuner(
    configs: list[AlgorithmConfig], settings: Settings, monitor: Monitor, number: int, resumed: bool
) -> tune.Tuner:
    """Return a new Tuner; for a resumed search over several trials, return the restored Tuner instead.

    Tune's restored state may name a checkpoint that no longer exists, while a new Tuner only needs the checkpoint that
    was found to be complete. Only a search over several trials needs Tune's state.

    Raises:
        CheckpointError: A search is resumed and Tune's state is missing.
    """
    os.environ["TUNE_DISABLE_STRICT_METRIC_CHECKING"] = "1"  # there is no mean return before the first episode ends
    chosen, folder = settings.tune.settings, monitor.folder
    suggestions = tune_objects.suggestions_of(chosen, searches_of(settings.rllib.settings))
    space: Any = {} if suggestions else configs[0] if settings.single else tune_objects.search_space(configs)
    algorithm = settings.rllib.settings["algorithm"]
    if resumed and not settings.single:
        if not (folder.trials / "tuner.pkl").is_file():
            raise CheckpointError(
                f"{folder.path}: there is no state of Tune to resume {len(configs)} trials; start a new run"
            )
        return tune.Tuner.restore(
            str(folder.trials), trainable=algorithm, resume_unfinished=True, resume_errored=True, param_space=space
        )
    if not settings.single:
        os.environ.setdefault("TUNE_GLOBAL_CHECKPOINT_S", "0.2")  # otherwise its state may name deleted checkpoints
    return tune.Tuner(
        algorithm,
        param_space=space,
        tune_config=tune.TuneConfig(
            max_concurrent_trials=chosen.get("max_concurrent_trials"),
            time_budget_s=chosen.get("time_budget_s"),
            scheduler=tune_objects.scheduler_of(chosen),
            search_alg=suggestions,
            num_samples=chosen["num_samples"] if suggestions else 1,
            **tune_objects.ranking(chosen),
            reuse_actors=False,  # reuse saves a second between trials, but carries state from one trial to the next
            trial_dirname_creator=folder_name,
        ),
        run_config=tune.RunConfig(
            name=f"{number:03d}" if settings.single else folder.trials.name,
            storage_path=str(folder.tune if settings.single else folder.path),
            stop=monitor,
            verbose=0,
            callbacks=[monitor, *tune_objects.callbacks_of(chosen)],
            failure_config=tune.FailureConfig(max_failures=chosen["max_failures"]),
            checkpoint_config=tune.CheckpointConfig(
                num_to_keep=chosen["num_to_keep"],
                checkpoint_frequency=chosen["checkpoint_frequency"],
                checkpoint_at_end=chosen["checkpoint_at_end"],
                checkpoint_score_attribute=chosen.get("checkpoint_score_attribute"),
                checkpoint_score_order=chosen.get("checkpoint_score_order", "max"),
            ),
        ),
    )


def _best_trial(results: Any, chosen: Mapping[str, Any]) -> Path | None:
    """Return the folder of the best trial of a search; None if no trial has the metric that ranks trials."""
    try:
        return Path(results.get_best_result(chosen["metric"], chosen["mode"]).path)
    except RuntimeError:
        return None


def _best(results: Any, chosen: Mapping[str, Any]) -> Path | None:
    """Return the kept checkpoint with the best score; None if no checkpoint has a score."""
    score = str(chosen.get("checkpoint_score_attribute"))
    kept = [(flatten(metrics).get(score), checkpoint.path) for checkpoint, metrics in results[0].best_checkpoints or ()]
    scored = [(value, path) for value, path in kept if value is not None and math.isfinite(value)]
    if not scored:
        return None
    pick = min if chosen.get("checkpoint_score_order", "max") == "min" else max
    return Path(pick(scored)[1])


def process_died(error: BaseException | None) -> bool:
    """Return whether a training failed because one of Ray's processes died (was killed, or memory ran out)."""
    return any(isinstance(cause, RayActorError) and not cause.actor_init_failed for cause in _causes(error))


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    """Yield an error and its causes, which Ray gives as `cause`."""
    while error is not None:
        yield error
        error = getattr(error, "cause", None) or error.__cause__


def _quiet() -> None:
    import warnings

    for name in ("ray", "ray.rllib", "ray.train", "ray.air"):
        logging.getLogger(name).setLevel(logging.ERROR)
    logging.getLogger("ray.tune").setLevel(logging.CRITICAL)  # it would print the error that is raised again here
    warnings.filterwarnings("ignore", module=r"(ray|gymnasium|tensorboardX)\b")


def _raise_failure(file: Path, error: BaseException) -> None:
    """Raise the error of a training: the user's error if an environment has written one to a file."""
    if file.is_file():
        failure = json.loads(file.read_text(encoding="utf-8"))
        raise getattr(errors, failure["error"], SafeInspectError)(failure["message"])
    raise next((cause for cause in _causes(error) if isinstance(cause, SafeInspectError)), error)
