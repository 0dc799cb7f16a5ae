"""The inputs of a training: `TrainingRun`, and its translated `Settings`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from safe_inspect import errors
from safe_inspect.config.experiment import Experiment
from safe_inspect.config.spec import PolicySpec
from safe_inspect.experiments.modules.checkpoints import INFO, check_frozen, starting_weights
from safe_inspect.experiments.settings.key_tables import TranslatedSettings
from safe_inspect.experiments.settings.policies import DEFAULT_MAKER, check_layouts, policy_info, read_policies
from safe_inspect.experiments.settings.search import Trial, search_problems, searches_of, trials_of
from safe_inspect.experiments.settings.translation import translate_ray, translate_rllib, translate_tune


@dataclass(frozen=True)
class TrainingRun:
    """Description of a training.

    Attributes:
        experiment: The resolved configuration from which the environment is built, as plain data.
        rllib: The merged mapping `rllib_configs`.
        tune: The merged mapping `tune_config`.
        ray: The merged mapping `ray_config`.
        text: The resolved configuration as YAML, for the run folder.
        name: Name of the experiment, with which the name of the run folder begins.
        output: Folder in which run folders are created.
        resume: The folder of an earlier run to resume.
        command: The command line, for the record.
        maker: ``module:function`` that builds the environments, see `EnvironmentMaker`; by default the package's own.
        policies: The policies of the controlled agents; needed only for several agents.
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
    policies: Sequence[PolicySpec] = ()


@dataclass(frozen=True)
class Settings:
    """Translated settings of a training, from three mappings of an experiment.

    Attributes:
        rllib: Settings of the algorithm.
        tune: Settings of Tune.
        ray: Settings of Ray.
        policies: The policies by name if there are several agents.
        trials: The trials that Tune trains, one or several; empty if there are problems in `rllib` or `tune`.
        notes: All notes on translated or dropped keys.
        problems: All problems, including those of single combinations of searched values.
    """

    rllib: TranslatedSettings
    tune: TranslatedSettings
    ray: TranslatedSettings
    policies: Mapping[str, PolicySpec] = field(default_factory=dict)
    trials: tuple[Trial, ...] = ()
    notes: tuple[str, ...] = ()
    problems: tuple[errors.Problem, ...] = ()

    @property
    def single(self) -> bool:
        """Whether the run is not a search, that is, has one sample and no searched values."""
        return self.tune.settings["num_samples"] == 1 and not searches_of(self.rllib.settings)

    @property
    def suggested(self) -> bool:
        """Whether a `search_alg` suggests the values of the trials while they train."""
        return self.tune.settings.get("search_alg") is not None


def read_settings(
    rllib: Mapping[str, Any], tune: Mapping[str, Any], ray: Mapping[str, Any], policies: Sequence[PolicySpec] = ()
) -> Settings:
    """Translate and check the three mappings and the policies' own keys, without loading Ray.

    Args:
        rllib: The merged mapping `rllib_configs`.
        tune: The merged mapping `tune_config`.
        ray: The merged mapping `ray_config`.
        policies: The policies of the controlled agents; needed only for several agents.
    """
    tuned = translate_tune(tune)
    algorithm = tuned.settings.get("algorithm")
    translated = translate_rllib(rllib, algorithm)
    found, notes, problems = read_policies(policies, translated.settings["algorithm"])
    trials: tuple[Trial, ...] = ()
    wrong: list[errors.Problem] = []
    if not translated.problems and not tuned.problems:
        problems += search_problems(searches_of(translated.settings), tuned.settings.get("search_alg") is not None)
        trials, wrong = trials_of(rllib, translated, algorithm, tuned.settings["num_samples"])
    joined = translate_ray(ray)
    return Settings(
        translated,
        tuned,
        joined,
        found,
        trials,
        (*translated.notes, *notes, *tuned.notes, *joined.notes),
        (*translated.problems, *wrong, *problems, *tuned.problems, *joined.problems),
    )


def unfit_policies(experiment: Experiment, settings: Settings) -> list[errors.Problem]:
    """Return a problem for each policy that cannot control all its agents, or whose checkpoint cannot be read.

    Args:
        experiment: The experiment.
        settings: From `read_settings`, without problems.
    """
    agents = {agent.name: agent for agent in experiment.spec.controlled}
    problems = check_layouts(settings.policies, agents)
    for name, policy in settings.policies.items():
        try:
            check_frozen(policy, agents)
        except errors.CheckpointError as error:
            problems.append(errors.Problem(str(error), f"policies.{name}.checkpoint"))
    return problems


def unfit_weights(experiment: Experiment, settings: Settings) -> list[errors.Problem]:
    """Return a problem for each policy whose initial weights cannot be read or do not match the experiment.

    Args:
        experiment: The experiment.
        settings: From `read_settings`, without problems.
    """
    common, problems = settings.trials[0].rllib.settings.get("model_config", {}), []
    for name, policy in experiment.policies.items():
        own = settings.policies[name].config.get("model_config", {}) if name in settings.policies else {}
        source = {**common, **own}.get("initial_weights")
        if source is None or not policy.trains:
            continue
        agents = [agent for agent in experiment.spec.controlled if agent.name in policy.agents]
        info = policy_info(experiment, name, agents)
        try:
            starting_weights(source, {INFO: info.metadata()})
        except errors.CheckpointError as error:
            where = f"policies.{name}" if name in settings.policies else "rllib_configs"
            problems.append(errors.Problem(str(error), f"{where}.model_config.initial_weights"))
    return problems
