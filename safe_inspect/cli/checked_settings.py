"""`checked_settings`: the training settings of an experiment, for `validate` and `train`."""

from __future__ import annotations

import sys

from safe_inspect.config.experiment import Experiment
from safe_inspect.config.learning import flight_note, learning_problems, placed
from safe_inspect.errors import ConfigError
from safe_inspect.experiments.runs.training_run import Settings, read_settings, unfit_policies, unfit_weights
from safe_inspect.experiments.settings.search import searches_of


def checked_settings(experiment: Experiment) -> Settings:
    """Return the settings of a training, and print notes about them.

    Ray is only loaded if the settings contain paths to objects.

    Raises:
        ConfigError: The settings have mistakes; all are listed.
    """
    task = experiment.config.config.config
    rllib = {"algorithm": experiment.algorithm, **experiment.rllib}
    settings = read_settings(rllib, task.tune_config, task.ray_config, tuple(experiment.policies.values()))
    problems = [*settings.problems, *learning_problems(experiment)]
    if problems:
        raise ConfigError(placed(experiment, problems))
    for note in filter(None, (*settings.notes, flight_note(experiment))):
        print(f"note: {note}", file=sys.stderr)
    problems = [*unfit_policies(experiment, settings), *unfit_weights(experiment, settings)]
    if any(settings.tune.settings.get(key) for key in ("scheduler", "search_alg", "callbacks")):
        try:
            from safe_inspect.experiments.runs.tune_objects import check_objects  # loads Ray

            check_objects(settings.tune.settings, searches_of(settings.rllib.settings))
        except ConfigError as error:
            problems += error.problems
    if problems:
        raise ConfigError(placed(experiment, problems))
    return settings
