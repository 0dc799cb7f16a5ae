"""Tune's schedulers, searchers and callbacks that an experiment names by dotted paths. Importing this loads Ray."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any, cast

from ray import tune
from ray.tune.schedulers import TrialScheduler
from ray.tune.search import Searcher

from safe_inspect.experiments.runs.search_space import Suggestions
from safe_inspect.experiments.settings.objects import built, mistake

#: The default metric by which trials are ranked.
METRIC = "env_runners/episode_return_mean"


def scheduler_of(settings: Mapping[str, Any]) -> TrialScheduler | None:
    """Return the scheduler of the trials of a search; None selects Tune's default, which trains each trial to its end.

    Args:
        settings: From `translate_tune`.

    Raises:
        ConfigError: There is no such class, it rejects its `config`, or it is not a scheduler.
    """
    entry = settings.get("scheduler")
    if entry is None:
        return None
    made = built(entry, "tune_config.scheduler")
    if not isinstance(made, TrialScheduler):
        raise mistake(
            f"{entry['functor']!r} is not a scheduler of ray.tune; name a TrialScheduler", "tune_config.scheduler"
        )
    return made


def suggestions_of(settings: Mapping[str, Any], searched: Mapping[str, Any]) -> Suggestions | None:
    """Return the searcher that suggests the values of trials; None without a `search_alg`.

    Args:
        settings: From `translate_tune`.
        searched: See `searches_of`.

    Raises:
        ConfigError: There is no such class, it rejects its `config`, or it is not a searcher.
    """
    entry = settings.get("search_alg")
    if entry is None:
        return None
    where = "tune_config.search_alg"
    made = built(entry, where)
    if not isinstance(made, Searcher):
        raise mistake(f"{entry['functor']!r} is not a searcher of ray.tune; name a Searcher", where)
    own = entry["config"]
    logging.getLogger("optuna").setLevel(logging.WARNING)  # optuna logs a line for each study
    try:
        return Suggestions(
            made, searched, own.get("metric") or figure_of(settings), own.get("mode") or mode_of(settings)
        )
    except Exception as error:  # a searcher may raise any kind of error
        raise mistake(f"{entry['functor']} cannot search: {error}", where) from error


def figure_of(settings: Mapping[str, Any]) -> str:
    """Return the metric by which trials are ranked."""
    return str(settings.get("metric") or METRIC)


def mode_of(settings: Mapping[str, Any]) -> str:
    """Return ``max`` if the best trial has the largest metric, and ``min`` if it has the smallest."""
    return str(settings.get("mode") or "max")


def ranking(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return Tune's arguments for the metric of a scheduler; empty without one, or if its own `config` gives them."""
    entry = settings.get("scheduler")
    if entry is None or "metric" in entry["config"]:
        return {}
    return {"metric": figure_of(settings), "mode": mode_of(settings)}


def callbacks_of(settings: Mapping[str, Any]) -> list[tune.Callback]:
    """Return Tune's callbacks, such as the loggers of Weights & Biases and of MLflow.

    Raises:
        ConfigError: There is no such class, it rejects its `config`, or it is not a callback of Tune.
    """
    found = []
    for index, entry in enumerate(settings.get("callbacks") or ()):
        where = f"tune_config.callbacks[{index}]"
        made = built(entry, where)
        if not isinstance(made, tune.Callback):
            raise mistake(f"{entry['functor']!r} is not a ray.tune.Callback; give RLlib's among the RLlib keys", where)
        cast(Any, made).setup = _Setup(made.setup, str(entry["functor"]), where)
        found.append(made)
    return found


def check_objects(settings: Mapping[str, Any], searched: Mapping[str, Any]) -> None:
    """Check the objects that a `tune_config` names by dotted paths; see `suggestions_of` for the arguments.

    Raises:
        ConfigError: See `scheduler_of`, `suggestions_of` and `callbacks_of`.
    """
    scheduler_of(settings)
    suggestions_of(settings, searched)
    callbacks_of(settings)


class _Setup:
    """The `setup` of a callback, which Tune calls at the start of a training; errors name the callback."""

    def __init__(self, setup: Callable[..., None], functor: str, where: str) -> None:
        self._setup, self._functor, self._where = setup, functor, where

    def __call__(self, *args: Any, **keywords: Any) -> None:
        """Call the `setup`.

        Raises:
            ConfigError: It fails, for example because a package or a key is missing, or a path cannot be written.
        """
        try:
            self._setup(*args, **keywords)
        except Exception as error:  # a logger may raise any kind of error
            raise mistake(f"{self._functor} cannot start: {error}", self._where) from error
