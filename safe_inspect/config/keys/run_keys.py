"""The keys of `tune_config` and `ray_config`, as plain data; `rllib_keys` gives the reason."""

from __future__ import annotations

import re
from typing import Any

from safe_inspect.config.keys.rllib_keys import Key

TUNE_KEYS: dict[str, Key] = {
    "algorithm": Key("text"),
    "name": Key("text", optional=True),
    "storage_path": Key("text", optional=True),
    "stop": Key("mapping", optional=True),
    "num_samples": Key("integer", low=1),
    "max_concurrent_trials": Key("integer", low=0, optional=True),
    "time_budget_s": Key("number", low=0, optional=True),
    "checkpoint_frequency": Key("integer", low=0),
    "checkpoint_at_end": Key("boolean"),
    "num_to_keep": Key("integer", low=1, optional=True),
    "checkpoint_score_attribute": Key("text", optional=True),
    "checkpoint_score_order": Key("text", choices=("max", "min")),
    "max_failures": Key("integer", low=0),
    "scheduler": Key("object", optional=True),
    "search_alg": Key("object", optional=True),
    "metric": Key("text", optional=True),
    "mode": Key("text", choices=("max", "min"), optional=True),
    "callbacks": Key("objects", optional=True),
    "reuse_actors": Key("boolean"),
}

TUNE_DEFAULTS: dict[str, Any] = {
    "num_samples": 1,
    "checkpoint_frequency": 10,
    "checkpoint_at_end": True,
    "num_to_keep": 3,
    "max_failures": 0,
}

TUNE_RENAMED: dict[str, str] = {
    "run_or_experiment": "algorithm",
    "checkpoint_freq": "checkpoint_frequency",
    "keep_checkpoints_num": "num_to_keep",
    "checkpoint_score_attr": "checkpoint_score_attribute",
    "local_dir": "storage_path",
}

#: Keys that have no effect at one value and are not supported at any other.
TUNE_ONLY_AT: dict[str, tuple[tuple[object, ...], str]] = {
    "restore": ((None, "", False), "use `--resume RUN_FOLDER` on the command line"),
    "resume": ((None, "", False), "use `--resume RUN_FOLDER` on the command line"),
    "loggers": (
        (None, [], (), ["csv", "json", "tensorboard"]),
        "the run folder contains progress.csv, result.json and the TensorBoard log; give others as `callbacks`, as "
        "`{functor: ray.air.integrations.wandb.WandbLoggerCallback, config: {project: inspection}}`",
    ),
    "resources_per_trial": ((None,), "give `num_env_runners`, `num_cpus_for_main_process`, ... in `rllib_configs`"),
}

TUNE_DROPPED: dict[str, str] = {
    "verbose": "safe_inspect prints one line for each iteration",
    "progress_reporter": "safe_inspect prints one line for each iteration",
    "log_to_file": "Ray's logs are copied into the run folder when a run fails",
    "sync_config": "the run folder is on a disk that all nodes share",
    "upload_dir": "the run folder is on a disk that all nodes share",
    "raise_on_failed_trial": "a failed training is always an error",
    "fail_fast": "a failed training is always an error",
    "queue_trials": "Tune always queues",
    "trial_name_creator": "safe_inspect names the folders",
    "trial_dirname_creator": "safe_inspect names the folders",
    "export_formats": "checkpoints contain the policy",
    "server_port": "it no longer has an effect",
}

#: Criteria to stop a training, and their names in RLlib's old API stack. Limits of counters are above 0.
STOP_COUNTS = (
    "training_iteration",
    "num_env_steps_sampled_lifetime",
    "time_total_s",
    "env_runners/num_episodes_lifetime",
)
STOP_KEYS = (
    *STOP_COUNTS,
    "env_runners/episode_return_mean",
    "env_runners/episode_return_max",
    "env_runners/episode_return_min",
    "env_runners/episode_len_mean",
    "env_runners/success_rate",
    "env_runners/inspected_fraction",
    "evaluation/env_runners/episode_return_mean",
    "evaluation/env_runners/episode_len_mean",
    "evaluation/env_runners/success_rate",
    "evaluation/env_runners/inspected_fraction",
)

STOP_RENAMED: dict[str, str] = {
    "timesteps_total": "num_env_steps_sampled_lifetime",
    "num_env_steps_sampled": "num_env_steps_sampled_lifetime",
    "env_runners/num_env_steps_sampled_lifetime": "num_env_steps_sampled_lifetime",
    "episodes_total": "env_runners/num_episodes_lifetime",
    "episode_reward_mean": "env_runners/episode_return_mean",
    "episode_reward_max": "env_runners/episode_return_max",
    "episode_reward_min": "env_runners/episode_return_min",
    "episode_return_mean": "env_runners/episode_return_mean",
    "episode_len_mean": "env_runners/episode_len_mean",
    "success_rate": "env_runners/success_rate",
    "inspected_fraction": "env_runners/inspected_fraction",
    "evaluation/episode_reward_mean": "evaluation/env_runners/episode_return_mean",
    "evaluation/episode_len_mean": "evaluation/env_runners/episode_len_mean",
}

RAY_KEYS: dict[str, Key] = {
    "address": Key("text", optional=True),
    "num_cpus": Key("integer", low=1, optional=True),
    "num_gpus": Key("integer", low=0, optional=True),
    "resources": Key("mapping", optional=True),
    "object_store_memory": Key("integer", low=78_643_200, high=2**63 - 1, optional=True),
    "include_dashboard": Key("boolean", optional=True),
    "dashboard_host": Key("text"),
    "dashboard_port": Key("integer", low=0, optional=True),
    "log_to_driver": Key("boolean", optional=True),
    "logging_level": Key("text", choices=("debug", "info", "warning", "error")),
    "namespace": Key("text", optional=True),
    "runtime_env": Key("mapping", optional=True),
    "temporary_folder": Key("text", optional=True),
}

#: Valid values of `address`.
RAY_ADDRESS = re.compile(r"auto|local|(ray://)?([\w.-]+|\[[0-9A-Fa-f:.]+\])(:\d+)?")

RAY_DEFAULTS: dict[str, Any] = {
    "address": "local",
    "include_dashboard": False,
    "log_to_driver": False,
    "logging_level": "error",
}

RAY_RENAMED: dict[str, str] = {"_temp_dir": "temporary_folder", "temp_dir": "temporary_folder"}

RAY_ONLY_AT: dict[str, tuple[tuple[object, ...], str]] = {}

RAY_DROPPED: dict[str, str] = {
    "local_mode": "Ray no longer supports it; `num_env_runners: 0` samples in the learner's process",
    "ignore_reinit_error": "safe_inspect uses Ray if its process has already started it",
    "configure_logging": "safe_inspect configures Ray's logs",
    "redis_max_memory": "it no longer has an effect",
    "_redis_password": "it no longer has an effect",
    "_memory": "it no longer has an effect",
    "webui_host": "it no longer has an effect; see `dashboard_host`",
}

#: The value of an iteration with the time [s] that this and the earlier iterations have waited for the compiler.
COMPILING = "compiling_seconds"
