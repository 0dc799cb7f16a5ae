"""The trials of a search: every combination of the `grid_search` values, `num_samples` times, each sample with a seed.

The trials are listed here and not by Tune, so that each trial is checked like a separate run before Ray starts, and its
configuration contains the values and the seed that it uses. Random values, such as those of `uniform`, are sampled here
for the same reason. The trials of a `search_alg` are checked with sampled values, and train with the values that it
suggests.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from safe_inspect.errors import Problem
from safe_inspect.experiments.settings.key_tables import (
    CHOICE,
    GRID,
    LOGUNIFORM,
    RANDINT,
    TranslatedSettings,
    is_searched,
)
from safe_inspect.experiments.settings.translation import current_name, translate_rllib

#: Part of the seed of the random values, which separates them from other random numbers of the same seed.
_DRAWS = 0x5EA7C


@dataclass(frozen=True)
class Trial:
    """One training of a run; a run without a search has one.

    Attributes:
        name: Its name, which is also the name of its folder.
        rllib: Settings of the algorithm.
        seed: Its seed.
        values: The value of each searched key, by RLlib's name of the key.
    """

    name: str
    rllib: TranslatedSettings
    seed: int | None = None
    values: Mapping[str, Any] = field(default_factory=dict)


def sample_seed(seed: int | None, sample: int) -> int | None:
    """Return the seed of a sample: the experiment's seed for sample 0, otherwise a hash of both in 0 to 2**31 - 1.

    The seed does not depend on the searched values, so the trials of one sample differ only in these values.
    """
    if sample == 0:
        return seed
    return int(np.random.SeedSequence([seed or 0, sample]).generate_state(1)[0]) >> 1


def trials_of(
    mapping: Mapping[str, Any], found: TranslatedSettings, algorithm: str | None, num_samples: int
) -> tuple[tuple[Trial, ...], list[Problem]]:
    """Return the trials in the order in which they train, and the problems of single combinations of values.

    Args:
        mapping: The merged `rllib_configs` of the experiment.
        found: Its translation, without problems.
        algorithm: The name of the algorithm in `tune_config`; None if it gives none.
        num_samples: How often each combination of values is trained.
    """
    searched = searches_of(found.settings)
    grids = {name: value[GRID] for name, value in searched.items() if GRID in value}
    if not searched and num_samples == 1:
        return (Trial(trial_folder_name(0), found, found.settings.get("seed")),), []
    seed = found.settings.get("seed")
    seed = None if is_searched(seed) else seed
    trials: list[Trial] = []
    problems: dict[str, Problem] = {}
    for sample, choice in itertools.product(range(num_samples), itertools.product(*grids.values())):
        generator = np.random.default_rng([seed or 0, _DRAWS, len(trials)])
        values = {name: _drawn(value, generator) for name, value in searched.items() if GRID not in value}
        values |= dict(zip(grids, choice, strict=True))
        trial = trial_of(mapping, algorithm, len(trials), values, sample, seed)
        for problem in trial.rllib.problems:
            where = f"with {', '.join(f'{key} {value}' for key, value in trial.values.items())}: {problem.message}"
            problems.setdefault(problem.path, replace(problem, message=where))
        trials.append(trial)
    return tuple(trials), list(problems.values())


def searches_of(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the searched keys with their searches, by RLlib's names of the keys."""
    return {name: value for name, value in settings.items() if is_searched(value)}


def search_problems(searched: Mapping[str, Any], suggested: bool) -> list[Problem]:
    """Return the problems of the searched keys with a `search_alg`.

    Args:
        searched: See `searches_of`.
        suggested: Whether there is a `search_alg`.
    """
    if suggested and not searched:
        hint = "give one as `lr: {loguniform: [1e-5, 1e-3]}`"
        return [Problem("there is no key to search", "tune_config.search_alg", hint=hint)]
    message = f"a `search_alg` suggests values and does not list them; use `{CHOICE}` instead of `{GRID}`"
    return [
        Problem(message, f"rllib_configs.{name}") for name, value in searched.items() if suggested and GRID in value
    ]


def trial_of(
    mapping: Mapping[str, Any],
    algorithm: str | None,
    number: int,
    values: Mapping[str, Any],
    sample: int,
    seed: int | None,
) -> Trial:
    """Return a trial of a search; its problems are those of its `rllib`.

    Args:
        mapping: The merged `rllib_configs` of the experiment.
        algorithm: The name of the algorithm in `tune_config`; None if it gives none.
        number: Number of the trial.
        values: The value of each searched key, by RLlib's name of the key.
        sample: Number of its sample, see `sample_seed`.
        seed: The experiment's seed; a seed among the values takes precedence.
    """
    values = dict(values)
    seed = sample_seed(values.pop("seed", seed), sample)
    rllib = translate_rllib({**_chosen(mapping, values), "seed": seed}, algorithm)
    return Trial(trial_folder_name(number), rllib, seed, values)


def trial_folder_name(number: int) -> str:
    """Return the name of a trial, which is also the name of its folder."""
    return f"trial_{number:05d}"


def _drawn(value: Mapping[str, Any], generator: np.random.Generator) -> Any:
    """Sample one of the values of a search."""
    ((word, given),) = value.items()
    if word == CHOICE:
        return given[int(generator.integers(len(given)))]
    low, high = given
    if word == RANDINT:
        return int(generator.integers(low, high))
    share = float(generator.random())
    return low * (high / low) ** share if word == LOGUNIFORM else low + share * (high - low)


def _chosen(tree: Any, values: Mapping[str, Any]) -> Any:
    """Return a configuration in which each search is replaced by the value of one trial.

    Args:
        tree: The configuration, in which keys may have their current or their old names.
        values: The value of each searched key, by RLlib's name of the key.
    """
    if isinstance(tree, Mapping):
        return {
            key: values[current_name(str(key))]
            if is_searched(item) and current_name(str(key)) in values
            else _chosen(item, values)
            for key, item in tree.items()
        }
    return [_chosen(item, values) for item in tree] if isinstance(tree, list) else tree


def experiment_of(experiment: Mapping[str, Any], trial: Trial) -> dict[str, Any]:
    """Return the resolved configuration of one trial of a search, with which the trial can be repeated by itself."""
    tree: dict[str, Any] = _chosen(experiment, trial.values)
    task = tree.get("config", {}).get("config")
    if isinstance(task, dict):
        rllib = task.get("rllib_configs") or {"default": {}}
        task["rllib_configs"] = {name: {**(keys or {}), "seed": trial.seed} for name, keys in rllib.items()}
        (task.get("tune_config") or {}).pop("num_samples", None)
    for entry in tree.get("agent_config", ()):
        own = (entry.get("policy") or {}).get("config") or {}
        if "seed" in own:
            own["seed"] = trial.seed
    return tree
