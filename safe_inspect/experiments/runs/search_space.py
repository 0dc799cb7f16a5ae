"""The trials of a search for Tune: all listed, or suggested by a searcher. Importing this module loads Ray.

Tune pickles its searcher, so `Suggestions` contains only the searcher and a count. The function that makes a trial from
suggested values is a global variable of the process, which `making` sets.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import isfinite
from typing import Any

from ray import tune
from ray.rllib.algorithms.algorithm_config import AlgorithmConfig
from ray.tune.search import Searcher

from safe_inspect.experiments.settings.values import DRAWN, GRID

#: Key of the environment's configuration for the number of the trial.
TRIAL_KEY = "trial"


class OfTrial:
    """Function for Tune that returns one value of a trial, given the trial's configuration.

    Args:
        values: The value of each trial.
    """

    def __init__(self, values: Sequence[Any]) -> None:
        self._values = list(values)

    def __call__(self, config: Mapping[str, Any]) -> Any:
        """Return the value of the trial."""
        return self._values[config["env_config"][TRIAL_KEY]]


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
    return {key: tune.sample_from(OfTrial([tree[key] for tree in trees])) for key in trees[0]}


_maker: Callable[[int, Mapping[str, Any]], dict[str, Any]] | None = None


class Suggestions(Searcher):
    """Searcher for Tune that makes a trial from the values that another searcher suggests.

    Args:
        searcher: The searcher that suggests values.
        searched: The keys that it searches, such as ``{"lr": {"loguniform": [1e-5, 1e-3]}}``.
        metric: The metric that is reported to it for each trial.
        mode: ``max`` or ``min``.

    Raises:
        ValueError: The searcher accepts no search space, for example because it already has one.
    """

    def __init__(self, searcher: Searcher, searched: Mapping[str, Any], metric: str, mode: str) -> None:
        super().__init__(metric=metric, mode=mode)
        self.searcher = searcher  # the attribute by which Tune finds the searcher to save
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
        assert _maker is not None, "a search runs within `making`"
        number = self._count
        self._count += 1
        made = _maker(number, values)
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

    def save(self, checkpoint_path: str) -> None:
        """Write the state of the searcher."""
        self.searcher.save(checkpoint_path)

    def restore(self, checkpoint_path: str) -> None:
        """Read the state of the searcher."""
        self.searcher.restore(checkpoint_path)


def tune_space(searched: Mapping[str, Any]) -> dict[str, Any]:
    """Return Tune's search space for the searched keys."""
    makers: dict[str, Callable[..., Any]] = dict(
        zip(DRAWN, (lambda *values: tune.choice(values), tune.uniform, tune.loguniform, tune.randint), strict=True)
    )
    return {name: makers[word](*values) for name, search in searched.items() for word, values in search.items()}


@contextmanager
def making(maker: Callable[[int, Mapping[str, Any]], dict[str, Any]]) -> Iterator[None]:
    """Set within a context the function that returns the configuration of a trial, given its number and values."""
    global _maker
    _maker = maker
    try:
        yield
    finally:
        _maker = None
