"""RLlib algorithms of an experiment, without Tune, for the benchmarks."""

from __future__ import annotations

import logging
import warnings
from typing import Any

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment

SINGLE = configs_root() / "translational-inspection" / "experiment-seed.yml"
TEAM = configs_root() / "multiagent-translational-inspection" / "experiment-seed.yml"


def configure(cfg: Any, overrides: list[str] | tuple[str, ...] = (), **rllib: Any) -> Any:
    """Return the configuration of the algorithm of an experiment; keyword arguments are further RLlib keys."""
    from safe_inspect.experiments.learning.algorithm import build_config, register_environments
    from safe_inspect.experiments.runs.training_run import read_settings
    from safe_inspect.experiments.settings.policies import environment_settings

    experiment = load_experiment(cfg, overrides)
    task = experiment.config.config.config
    keys = {"algorithm": experiment.algorithm, **experiment.rllib, **rllib}
    settings = read_settings(keys, task.tune_config, task.ray_config, tuple(experiment.policies.values()))
    if settings.problems:
        raise SystemExit("\n".join(map(str, settings.problems)))
    register_environments()
    found = environment_settings(experiment.resolved, settings.rllib.settings)
    return build_config(settings.rllib, found, settings.policies)


def start_ray(processors: int = 2) -> None:
    """Start a Ray of the benchmark's own, and say nothing about it."""
    import ray

    warnings.filterwarnings("ignore")
    for name in ("ray", "ray.rllib", "ray.train", "ray.tune"):
        logging.getLogger(name).setLevel(logging.ERROR)
    ray.init(address="local", num_cpus=processors, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
