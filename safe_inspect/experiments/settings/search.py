"""The trials of a search: every combination of the `grid_search` values, `num_samples` times, each sample with a seed.

They are listed here, and not by Tune, so that each trial is checked like a run of its own before Ray starts, and its
configuration states the values and the seed that it uses.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from safe_inspect.errors import Problem
from safe_inspect.experiments.settings.key_tables import TranslatedSettings
from safe_inspect.experiments.settings.translation import current_name, translate_rllib
from safe_inspect.experiments.settings.values import GRID, is_searched


@dataclass(frozen=True)
class Trial:
    """One training of a run; a run without a search has one.

    Attributes:
        name: Its name, and that of its folder.
        rllib: Settings of the algorithm.
        seed: Its seed.
        values: The value of each key that is searched, by RLlib's names.
    """

    name: str
    rllib: TranslatedSettings
    seed: int | None = None
    values: Mapping[str, Any] = field(default_factory=dict)


def sample_seed(seed: int | None, sample: int) -> int | None:
    """Return the seed of a sample, 0 to 2**31 - 1: the experiment's own for sample 0, a hash of both for the others.

    It does not depend on the searched values, so trials of one sample differ in these alone.
    """
    if sample == 0:
        return seed
    return int(np.random.SeedSequence([seed or 0, sample]).generate_state(1)[0]) >> 1


def trials_of(
    mapping: Mapping[str, Any], found: TranslatedSettings, algorithm: str | None, num_samples: int
) -> tuple[tuple[Trial, ...], list[Problem]]:
    """Return the trials in the order in which they train, and the mistakes of single combinations of values.

    Args:
        mapping: What the experiment gives under `rllib_configs`, merged.
        found: Its translation, without problems.
        algorithm: The name that `tune_config` gives, if it does.
        num_samples: How often each combination of values is trained.
    """
    grids = {name: value[GRID] for name, value in found.settings.items() if is_searched(value)}
    if not grids and num_samples == 1:
        return (Trial(_name(0), found, found.settings.get("seed")),), []
    trials: list[Trial] = []
    problems: dict[str, Problem] = {}
    for sample, choice in itertools.product(range(num_samples), itertools.product(*grids.values())):
        values = dict(zip(grids, choice, strict=True))
        seed = sample_seed(values.get("seed", found.settings.get("seed")), sample)
        values.pop("seed", None)
        own = translate_rllib({**chosen(mapping, values), "seed": seed}, algorithm)
        for problem in own.problems:
            where = f"with {', '.join(f'{key} {value}' for key, value in values.items())}: {problem.message}"
            problems.setdefault(problem.path, replace(problem, message=where))
        trials.append(Trial(_name(len(trials)), own, seed, values))
    return tuple(trials), list(problems.values())


def _name(number: int) -> str:
    return f"trial_{number:05d}"  # Tune counts alike


def chosen(tree: Any, values: Mapping[str, Any]) -> Any:
    """Return a configuration in which each search over a key, by any of its names, is the value of one trial."""
    if isinstance(tree, Mapping):
        return {
            key: values[current_name(str(key))]
            if is_searched(item) and current_name(str(key)) in values
            else chosen(item, values)
            for key, item in tree.items()
        }
    return [chosen(item, values) for item in tree] if isinstance(tree, list) else tree


def experiment_of(experiment: Mapping[str, Any], trial: Trial) -> dict[str, Any]:
    """Return the resolved configuration of a trial of a search, with which it can be repeated alone."""
    tree: dict[str, Any] = chosen(experiment, trial.values)
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
