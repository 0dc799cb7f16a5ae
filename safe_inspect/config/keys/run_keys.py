"""The keys of `tune_config` and `ray_config`, with the types of their values; `rllib_keys` gives the reason."""

from __future__ import annotations

import re
from typing import Any, Literal

from annotated_types import Ge, Le
from pydantic import StrictBool

from safe_inspect.config.keys import by_name
from safe_inspect.config.keys.value_types import AMOUNT, COUNT, OBJECT, OBJECTS, POSITIVE, numeric

TUNE_KEYS: dict[str, Any] = by_name(
    {
        str: "algorithm",
        str | None: "name storage_path checkpoint_score_attribute metric",
        dict[Any, Any] | None: "stop",
        POSITIVE: "num_samples",
        COUNT | None: "max_concurrent_trials",
        AMOUNT | None: "time_budget_s",
        COUNT: "checkpoint_frequency max_failures",
        StrictBool: "checkpoint_at_end reuse_actors",
        POSITIVE | None: "num_to_keep",
        Literal["max", "min"]: "checkpoint_score_order",
        OBJECT | None: "scheduler search_alg",
        Literal["max", "min"] | None: "mode",
        OBJECTS | None: "callbacks",
    }
)

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

TUNE_DROPPED: dict[str, str] = by_name(
    {
        "safe_inspect prints one line for each iteration": "verbose progress_reporter",
        "Ray's logs are copied into the run folder when a run fails": "log_to_file",
        "the run folder is on a disk that all nodes share": "sync_config upload_dir",
        "a failed training is always an error": "raise_on_failed_trial fail_fast",
    }
)

#: Criteria to stop a training, and their names in RLlib's old API stack. Limits of counters are above 0.
STOP_COUNTS = (
    "training_iteration",
    "num_env_steps_sampled_lifetime",
    "time_total_s",
    "env_runners/num_episodes_lifetime",
)
_MEANS = ("episode_return_mean", "episode_len_mean", "success_rate", "inspected_fraction")
STOP_KEYS = (
    *STOP_COUNTS,
    "env_runners/episode_return_max",
    "env_runners/episode_return_min",
    *(f"{place}env_runners/{name}" for place in ("", "evaluation/") for name in _MEANS),
)

STOP_RENAMED: dict[str, str] = {name: f"env_runners/{name}" for name in _MEANS} | by_name(
    {
        "num_env_steps_sampled_lifetime": """
            timesteps_total num_env_steps_sampled env_runners/num_env_steps_sampled_lifetime
        """,
        "env_runners/num_episodes_lifetime": "episodes_total",
        "env_runners/episode_return_mean": "episode_reward_mean",
        "env_runners/episode_return_max": "episode_reward_max",
        "env_runners/episode_return_min": "episode_reward_min",
        "evaluation/env_runners/episode_return_mean": "evaluation/episode_reward_mean",
        "evaluation/env_runners/episode_len_mean": "evaluation/episode_len_mean",
    }
)

RAY_KEYS: dict[str, Any] = by_name(
    {
        str | None: "address namespace temporary_folder",
        POSITIVE | None: "num_cpus",
        COUNT | None: "num_gpus dashboard_port",
        dict[Any, Any] | None: "resources runtime_env",
        numeric(int, Ge(78_643_200), Le(2**63 - 1)) | None: "object_store_memory",
        StrictBool | None: "include_dashboard log_to_driver",
        str: "dashboard_host",
        Literal["debug", "info", "warning", "error"]: "logging_level",
    }
)

#: Valid values of `address`.
RAY_ADDRESS = re.compile(r"auto|local|(ray://)?([\w.-]+|\[[0-9A-Fa-f:.]+\])(:\d+)?")

RAY_DEFAULTS: dict[str, Any] = {
    "address": "local",
    "include_dashboard": False,
    "log_to_driver": False,
    "logging_level": "error",
}

RAY_RENAMED: dict[str, str] = {"_temp_dir": "temporary_folder", "temp_dir": "temporary_folder"}

RAY_DROPPED: dict[str, str] = {
    "local_mode": "Ray no longer supports it; `num_env_runners: 0` samples in the learner's process",
    "ignore_reinit_error": "safe_inspect uses Ray if its process has already started it",
}

#: The value of an iteration with the time [s] that this and the earlier iterations have waited for the compiler.
COMPILING = "compiling_seconds"
