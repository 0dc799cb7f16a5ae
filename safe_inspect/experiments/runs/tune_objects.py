"""Objects for Tune: the trials of a search, and the schedulers, searchers and callbacks that an experiment names.

Importing this module loads Ray. Tune pickles its searcher, so `Suggestions` contains only the searcher and a count. The
function that makes a trial from suggested values is an attribute of the class, which `run_tune` sets.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import isfinite
from typing import Any, ClassVar, cast

from ray import tune
from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
from ray.tune.schedulers import TrialScheduler
from ray.tune.search import Searcher

from safe_inspect.errors import ConfigError, Problem
from safe_inspect.experiments.settings.key_tables import DRAWN, GRID
from safe_inspect.experiments.settings.objects import built_as

#: Key of the environment's configuration for the number of the trial.
TRIAL_KEY = "trial"


def scheduler_of(settings: Mapping[str, Any]) -> TrialScheduler | None:
    """Return the scheduler of the trials of a search; None selects Tune's default, which trains each trial to its end.

    Args:
        settings: From `translate_tune`.

    Raises:
        ConfigError: There is no such class, it rejects its `config`, or it is not a scheduler.
    """
    entry, what = settings.get("scheduler"), "a scheduler of ray.tune; name a TrialScheduler"
    return None if entry is None else built_as(TrialScheduler, what, entry, "tune_config.scheduler")


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
    made = built_as(Searcher, "a searcher of ray.tune; name a Searcher", entry, where)
    own = entry["config"]
    logging.getLogger("optuna").setLevel(logging.WARNING)  # optuna logs a line for each study
    try:
        return Suggestions(made, searched, own.get("metric") or settings["metric"], own.get("mode") or settings["mode"])
    except Exception as error:  # a searcher may raise any kind of error
        raise ConfigError(Problem(f"{entry['functor']} cannot search: {error}", where)) from error


def ranking(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return Tune's arguments for the metric of a scheduler; empty without one, or if its own `config` gives them."""
    entry = settings.get("scheduler")
    if entry is None or "metric" in entry["config"]:
        return {}
    return {"metric": settings["metric"], "mode": settings["mode"]}


def callbacks_of(settings: Mapping[str, Any]) -> list[tune.Callback]:
    """Return Tune's callbacks, such as the loggers of Weights & Biases and of MLflow.

    Raises:
        ConfigError: There is no such class, it rejects its `config`, or it is not a callback of Tune.
    """
    found = []
    for index, entry in enumerate(settings.get("callbacks") or ()):
        where, what = f"tune_config.callbacks[{index}]", "a ray.tune.Callback; give RLlib's among the RLlib keys"
        made = built_as(tune.Callback, what, entry, where)
        cast(Any, made).setup = partial(_set_up, made.setup, str(entry["functor"]), where)
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


def _set_up(setup: Callable[..., None], functor: str, where: str, *args: Any, **keywords: Any) -> None:
    """Call the `setup` of a callback, which Tune does at the start of a training.

    Raises:
        ConfigError: It fails, for example because a package or a key is missing, or a path cannot be written.
    """
    try:
        setup(*args, **keywords)
    except Exception as error:  # a logger may raise any kind of error
        raise ConfigError(Problem(f"{functor} cannot start: {error}", where)) from error


def _value_of_trial(values: Sequence[Any], config: Mapping[str, Any]) -> Any:
    """Return the value of a trial for Tune, given the values of all trials and the trial's configuration."""
    return values[config["env_config"][TRIAL_KEY]]


def search_space(configs: Sequence[AlgorithmConfig]) -> dict[str, Any]:
    """Return a search space from which Tune takes each configuration once, in the given order.

    Tune searches only the number of the trial; every other value is a function of this number.
    """
    trees = [config.to_dict() for config in configs]
    environments = [tree.pop("env_config") for tree in trees]
    space = _functions(trees)
    space["env_config"] = {**_functions(environments), TRIAL_KEY: {GRID: list(range(len(configs)))}}
    return space


def _functions(trees: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {key: tune.sample_from(partial(_value_of_trial, [tree[key] for tree in trees])) for key in trees[0]}


class Suggestions(Searcher):
    """Searcher for Tune that makes a trial from the values that another searcher suggests.

    Args:
        searcher: The searcher that suggests values.
        searched: The keys that it searches, such as ``{"lr": {"loguniform": [1e-5, 1e-3]}}``.
        metric: The metric that is reported to it for each trial.
        mode: ``max`` or ``min``.

    Attributes:
        make: Function of the process that returns the configuration of a trial, given its number and values.

    Raises:
        ValueError: The searcher accepts no search space, for example because it already has one.
    """

    make: ClassVar[Callable[[int, Mapping[str, Any]], dict[str, Any]]]

    def __init__(self, searcher: Searcher, searched: Mapping[str, Any], metric: str, mode: str) -> None:
        super().__init__(metric=metric, mode=mode)
        self.searcher = searcher  # the attribute by which Tune finds the searcher to save and to restore
        self._count = 0
        if not searcher.set_search_properties(metric, mode, tune_space(searched)):
            raise ValueError(
                "it accepts no search space; remove its own, because the ranges of `rllib_configs` are searched"
            )

    def set_search_properties(self, metric: str | None, mode: str | None, config: Any, **spec: Any) -> bool:
        """Return True; the properties of the search were set on construction."""
        return True

    def set_max_concurrency(self, max_concurrent: int) -> bool:
        """Return whether the searcher itself limits how many trials train at the same time."""
        return bool(self.searcher.set_max_concurrency(max_concurrent))

    def suggest(self, trial_id: str) -> Any:
        """Return the configuration of a new trial; None or `Searcher.FINISHED` if the searcher suggests none."""
        values: Any = self.searcher.suggest(trial_id)
        if values is None or values == Searcher.FINISHED:
            return values
        number = self._count
        self._count += 1
        made = type(self).make(number, values)
        return {**made, "env_config": {**made["env_config"], TRIAL_KEY: number}}

    def on_trial_result(self, trial_id: str, result: dict[str, Any]) -> None:
        """Report an iteration to the searcher, unless the metric is missing, as it is before the first episode ends."""
        if isfinite(result.get(self.metric, float("nan"))):
            self.searcher.on_trial_result(trial_id, result)

    def on_trial_complete(self, trial_id: str, result: dict[str, Any] | None = None, error: bool = False) -> None:
        """Report the result of a trial to the searcher."""
        known = result is not None and isfinite(result.get(self.metric, float("nan")))
        self.searcher.on_trial_complete(trial_id, result=result if known else None, error=error)

    def get_state(self) -> dict[str, Any]:
        """Return the state that Tune saves for a resumed run."""
        return {"count": self._count}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore the state that Tune has saved."""
        self._count = state["count"]


def tune_space(searched: Mapping[str, Any]) -> dict[str, Any]:
    """Return Tune's search space for the searched keys."""
    makers: dict[str, Callable[..., Any]] = dict(
        zip(DRAWN, (lambda *values: tune.choice(values), tune.uniform, tune.loguniform, tune.randint), strict=True)
    )
    return {name: makers[word](*values) for name, search in searched.items() for word, values in search.items()}
