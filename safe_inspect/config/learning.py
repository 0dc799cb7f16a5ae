"""Check what an experiment says to RLlib, Tune and Ray, with the place of every mistake; nothing here loads Ray."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

from safe_inspect.config.experiment import Experiment
from safe_inspect.config.located import has, locate, path_text
from safe_inspect.errors import ConfigError, Problem

Path = tuple[Any, ...]

_TASK: Path = ("config", "config")
_POLICY: Path = ("agent_config", 0, "policy", "config")
_STEP = re.compile(r"([^.\[\]]+)|\[(\d+)\]")


def placed(experiment: Experiment, problems: Sequence[Problem]) -> list[Problem]:
    """Give problems whose path begins with `rllib_configs`, `tune_config` or `ray_config` their place in the files."""
    return [_placed(experiment, problem) for problem in problems]


def check_learning(experiment: Experiment, read: Callable[[Any, Any, Any], Any]) -> Any:
    """Translate the three mappings and return the settings.

    Args:
        experiment: The experiment.
        read: `safe_inspect.experiments.train.read_settings`, which lies in a higher layer.

    Raises:
        ConfigError: With every mistake in them.
    """
    task = experiment.config.config.config
    settings = read({"algorithm": experiment.algorithm, **experiment.rllib}, task.tune_config, task.ray_config)
    if settings.problems:
        raise ConfigError(placed(experiment, settings.problems))
    return settings


def _placed(experiment: Experiment, problem: Problem) -> Problem:
    steps: Path = tuple(name or int(index) for name, index in _STEP.findall(problem.path))
    if not steps or problem.location is not None:
        return problem
    head, rest = steps[0], steps[1:]
    if head == "rllib_configs":
        places: list[Path] = [(*_POLICY, *rest)]
        platforms = experiment.config.config.config.rllib_configs
        places += [(*_TASK, "rllib_configs", name, *rest) for name in platforms]
        if rest == ("algorithm",):
            places = [(*_POLICY[:-1], "algorithm")]
    else:
        places = [(*_TASK, *steps)]
    for place in places:
        if _stands(experiment.tree, place):
            return Problem(problem.message, path_text(place), locate(experiment.tree, place), problem.hint)
    return problem


def _stands(tree: Any, path: Path) -> bool:
    for key in path:
        if not has(tree, key):
            return False
        tree = tree[key]
    return True
