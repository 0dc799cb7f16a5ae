"""`checked_settings`: how an experiment is to be trained, for `validate` and `train`."""

from __future__ import annotations

import sys
from importlib import import_module

from safe_inspect.config.experiment import Experiment
from safe_inspect.config.learning import check_learning, flight_note, placed
from safe_inspect.errors import ConfigError
from safe_inspect.experiments.modules.unfit_weights import unfit_weights
from safe_inspect.experiments.runs.training_run import Settings, read_settings
from safe_inspect.experiments.settings.search import searches_of


def checked_settings(experiment: Experiment) -> Settings:
    """Return the settings of a training, and print the notes on them.

    Ray is loaded only where objects of it are named by their paths.

    Raises:
        ConfigError: With the mistakes in them.
    """
    settings: Settings = check_learning(experiment, read_settings)
    for note in filter(None, (*settings.notes, flight_note(experiment))):
        print(f"note: {note}", file=sys.stderr)
    problems = unfit_weights(experiment, settings)
    if any(settings.tune.settings.get(key) for key in ("scheduler", "search_alg", "callbacks")):
        try:
            objects = import_module("safe_inspect.experiments.adapters.objects")
            objects.check_objects(settings.tune.settings, searches_of(settings.rllib.settings))
        except ConfigError as error:
            problems += error.problems
    if problems:
        raise ConfigError(placed(experiment, problems))
    return settings
