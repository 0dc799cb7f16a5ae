"""The trials of a search as Tune takes them: all listed, or suggested by a searcher. Importing this module loads Ray.

Tune pickles its searcher, so `Suggestions` holds the searcher and a count alone; what makes a trial of suggested values
belongs to the process, and is set by `making`.
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

#: Key of the environment's configuration that holds the number of the trial.
TRIAL_KEY = "trial"


class OfTrial:
    """Tune's function from the configuration of a trial to one of its values.

    Args:
        values: The value of each trial.
    """

    def __init__(self, values: Sequence[Any]) -> None:
        self._values = list(values)

    def __call__(self, config: Mapping[str, Any]) -> Any:
        """Return the value of the trial."""
        return self._values[config["env_config"][TRIAL_KEY]]


def search_space(configs: Sequence[AlgorithmConfig]) -> dict[str, Any]:
    """Return a space in which Tune finds each configuration once, in their order.

    The only thing that Tune searches is the number of the trial; every other value is a function of it.
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
    """Makes a trial of the values that a searcher suggests.

    Args:
        searcher: The searcher.
        searched: The keys that it searches, such as ``{"lr": {"loguniform": [1e-5, 1e-3]}}``.
        metric: The figure that it is told of each trial.
        mode: ``max`` or ``min``.

    Raises:
        ValueError: The searcher takes no search space, as one that has been given a space of its own.
    """

    def __init__(self, searcher: Searcher, searched: Mapping[str, Any], metric: str, mode: str) -> None:
        super().__init__(metric=metric, mode=mode)
        self.searcher = searcher  # by this name Tune finds what it saves
        self._count = 0
        if not searcher.set_search_properties(metric, mode, tune_space(searched)):
            raise ValueError("it takes no search space; remove its own, the ranges of `rllib_configs` are searched")

    def set_search_properties(self, metric: str | None, mode: str | None, config: Any, **spec: Any) -> bool:
        """Return whether the search is accepted; its properties are set already."""
        return True

    def set_max_concurrency(self, max_concurrent: int) -> bool:
        """Return whether the searcher limits by itself how many trials train at a time."""
        return bool(self.searcher.set_max_concurrency(max_concurrent))

    def suggest(self, trial_id: str) -> Any:
        """Return the configuration of a new trial; None or `Searcher.FINISHED` where there is none."""
        values: Any = self.searcher.suggest(trial_id)
        if values is None or values == Searcher.FINISHED:
            return values
        assert _maker is not None, "a search runs within `making`"
        number = self._count
        self._count += 1
        made = _maker(number, values)
        return {**made, "env_config": {**made["env_config"], TRIAL_KEY: number}}

    def on_trial_result(self, trial_id: str, result: dict[str, Any]) -> None:
        """Tell the searcher of an iteration, unless its figure is missing, as before the first episode has ended."""
        if isfinite(result.get(self.metric, float("nan"))):
            self.searcher.on_trial_result(trial_id, result)

    def on_trial_complete(self, trial_id: str, result: dict[str, Any] | None = None, error: bool = False) -> None:
        """Tell the searcher what came of a trial."""
        known = result is not None and isfinite(result.get(self.metric, float("nan")))
        self.searcher.on_trial_complete(trial_id, result=result if known else None, error=error)

    def get_state(self) -> dict[str, Any]:
        """Return what Tune keeps for a run that goes on."""
        return {"count": self._count}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Go on from what Tune has kept."""
        self._count = state["count"]

    def save(self, checkpoint_path: str) -> None:
        """Write the state of the searcher."""
        self.searcher.save(checkpoint_path)

    def restore(self, checkpoint_path: str) -> None:
        """Read the state of the searcher."""
        self.searcher.restore(checkpoint_path)


def tune_space(searched: Mapping[str, Any]) -> dict[str, Any]:
    """Return a search space of Tune."""
    makers: dict[str, Callable[..., Any]] = dict(
        zip(DRAWN, (lambda *values: tune.choice(values), tune.uniform, tune.loguniform, tune.randint), strict=True)
    )
    return {name: makers[word](*values) for name, search in searched.items() for word, values in search.items()}


@contextmanager
def making(maker: Callable[[int, Mapping[str, Any]], dict[str, Any]]) -> Iterator[None]:
    """Make trials of suggested values by a function of their number and values, which returns their configuration."""
    global _maker
    _maker = maker
    try:
        yield
    finally:
        _maker = None
