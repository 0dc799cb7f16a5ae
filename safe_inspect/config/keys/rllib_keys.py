"""The keys that an experiment may give to RLlib, with the types of their values.

RLlib accepts any key without a message: unknown ones, and many of its old API stack, have
no effect. Therefore these tables list the valid keys. They do not import Ray, because
`safe-inspect validate` must work without loading Ray; a test compares them with the
installed release of Ray.
"""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

from annotated_types import Ge, Le, MinLen
from pydantic import StrictBool

from safe_inspect.config.keys import by_name
from safe_inspect.config.keys.value_types import (
    AMOUNT,
    COUNT,
    FINITE,
    NUMBER,
    OBJECT,
    OBJECTS,
    PATHS,
    POSITIVE,
    SHARE,
    UNLIMITED,
    numeric,
    schedule_of,
)

_RATE = schedule_of(AMOUNT)
_MAPPING = dict[Any, Any]
_SIZES: Any = list[POSITIVE]  # type: ignore[valid-type]
_AUTO = Literal["auto"]

#: Keys of every RLlib algorithm: attributes of `AlgorithmConfig`.
COMMON_KEYS: dict[str, Any] = by_name(
    {
        SHARE: "gamma",
        _RATE: "lr",
        UNLIMITED | None: "grad_clip sample_timeout_s",
        Literal["value", "norm", "global_norm"]: "grad_clip_by",
        POSITIVE: """
            train_batch_size_per_learner num_epochs num_envs_per_env_runner max_requests_in_flight_per_env_runner
            env_runner_state_server_max_concurrency max_requests_in_flight_per_aggregator_actor
            max_requests_in_flight_per_learner evaluation_auto_duration_min_env_steps_per_sample
            evaluation_auto_duration_max_env_steps_per_sample metrics_num_episodes_for_smoothing
        """,
        POSITIVE | None: "minibatch_size evaluation_interval evaluation_error_after_n_consecutive_skips",
        StrictBool: """
            shuffle_batch_per_epoch explore validate_env_runners_after_construction create_env_on_local_worker
            create_local_env_runner broadcast_env_runner_states use_env_runner_state_server torch_compile_learner
            torch_compile_worker torch_skip_nan_gradients evaluation_parallel_to_training
            evaluation_force_reset_envs_before_iteration log_gradients log_sys_usage restart_failed_env_runners
            ignore_env_runner_failures restart_failed_sub_environments
        """,
        _MAPPING: """
            learner_config_dict custom_resources_per_env_runner custom_resources_per_learner
            custom_resources_for_main_process torch_ddp_kwargs
        """,
        COUNT: """
            num_env_runners episode_lookback_horizon num_learners num_aggregator_actors_per_learner local_gpu_idx
            evaluation_num_env_runners min_train_timesteps_per_iteration min_sample_timesteps_per_iteration
            max_num_env_runner_restarts num_consecutive_env_runner_failures_tolerance
        """,
        AMOUNT: "num_cpus_per_env_runner num_gpus_per_env_runner num_gpus_per_learner num_cpus_for_main_process",
        _AUTO | POSITIVE: "rollout_fragment_length evaluation_duration",
        Literal["truncate_episodes", "complete_episodes"]: "batch_mode",
        StrictBool | Literal["training_only"]: "merge_env_runner_states",
        _AUTO | AMOUNT: "num_cpus_per_learner",
        Literal["PACK", "SPREAD", "STRICT_PACK", "STRICT_SPREAD"]: "placement_strategy",
        str: "torch_compile_learner_dynamo_backend torch_compile_worker_dynamo_backend",
        str | None: "torch_compile_learner_dynamo_mode torch_compile_worker_dynamo_mode",
        Literal["episodes", "timesteps"]: "evaluation_duration_unit",
        _MAPPING | None: "evaluation_config",
        UNLIMITED: """
            evaluation_sample_timeout_s evaluation_unhealthy_workers_timeout_s metrics_episode_collection_timeout_s
            delay_between_env_runner_restarts_s env_runner_health_probe_timeout_s env_runner_restore_timeout_s
        """,
        AMOUNT | None: "min_time_s_per_iteration",
        Literal["DEBUG", "INFO", "WARN", "ERROR"]: "log_level",
        # NumPy's generators, which RLlib seeds, take no more
        numeric(int, Ge(0), Le(2**32 - 1)) | None: "seed",
    }
)

#: Additional keys of PPO.
PPO_KEYS: dict[str, Any] = by_name(
    {
        SHARE: "lambda",
        StrictBool: "use_critic use_gae use_kl_loss",
        AMOUNT: "kl_coeff kl_target vf_loss_coeff",
        _RATE: "entropy_coeff",
        # with 0 there is no gradient
        numeric(float, Ge(1e-6)): "clip_param vf_clip_param",
    }
)

_REPLAY_KEYS: dict[str, Any] = by_name(
    {
        _MAPPING: "replay_buffer_config",
        COUNT: "num_steps_sampled_before_learning_starts target_network_update_freq",
        AMOUNT | None: "training_intensity",
        StrictBool: "store_buffer_in_checkpoints",
        SHARE: "tau",
    }
)

#: Additional keys of SAC that are often set.
SAC_KEYS: dict[str, Any] = _REPLAY_KEYS | by_name(
    {
        _RATE | None: "actor_lr critic_lr alpha_lr",
        AMOUNT: "initial_alpha",
        _AUTO | NUMBER: "target_entropy",
        StrictBool: "twin_q",
    }
)

#: Additional keys of DQN that are often set.
DQN_KEYS: dict[str, Any] = _REPLAY_KEYS | by_name(
    {
        schedule_of(SHARE): "epsilon",
        StrictBool: "double_q dueling",
        POSITIVE: "num_atoms",
        NUMBER: "v_min v_max",
        AMOUNT: "adam_epsilon",
        Literal["huber", "mse"]: "td_error_loss_fn",
    }
)

#: Algorithms with a table of additional keys here. The values of keys that are in no table are checked when Ray is
#: loaded; `keys_of_release` gives their names.
ALGORITHM_KEYS: dict[str, dict[str, Any]] = {"PPO": PPO_KEYS, "SAC": SAC_KEYS, "DQN": DQN_KEYS}
#: Algorithms that the batched runner supports.
BATCHED_ALGORITHMS = ("PPO", "APPO", "IMPALA")
#: Names of RLlib's algorithms whose policies can be trained and evaluated.
ALGORITHMS = (*BATCHED_ALGORITHMS, "SAC", "DQN")

#: Keys of safe_inspect that are given with RLlib's.
OWN_KEYS: dict[str, Any] = by_name(
    {
        str: "algorithm",
        _MAPPING: "model_config",
        POSITIVE: "torch_num_threads learner_threads",
        Literal["batched", "stock"]: "env_runner",
        Literal["fast", "stock"]: "learner",
        PATHS | None: "callbacks",
        OBJECT | None: "rl_module",
        OBJECTS | None: "env_to_module_connector module_to_env_connector learner_connector",
    }
)

#: Keys whose objects change a policy, its input or its output, so that its weights alone do not define it.
CHANGING_KEYS = ("rl_module", "env_to_module_connector", "module_to_env_connector")

#: Keys that may differ between policies that are trained together.
POLICY_KEYS = (
    *("lr", "grad_clip", "grad_clip_by", "clip_param", "vf_clip_param", "vf_loss_coeff", "entropy_coeff"),
    *("use_kl_loss", "kl_coeff", "kl_target", "model_config"),
)

_ACTIVATION = Literal["tanh", "relu", "swish", "silu", "linear"] | None

#: Initial weights of a policy: keys of safe_inspect in `model_config`, for PPO.
FRESH_KEYS: dict[str, Any] = by_name(
    {
        StrictBool: "orthogonal hurdle",
        COUNT | None: "initial_choice",
        numeric(float, Ge(0.01), Le(0.99)): "initial_probability initial_burn_probability",
        numeric(float, Ge(1e-4), FINITE) | None: "initial_std",
        str | None: "initial_weights",
    }
)

#: Keys of the networks: attributes of `DefaultModelConfig` that apply to vectors of numbers.
MODEL_KEYS: dict[str, Any] = by_name(
    {
        Annotated[_SIZES, MinLen(1)]: "fcnet_hiddens",  # RLlib builds no network without a layer
        _SIZES: "head_fcnet_hiddens",
        _ACTIVATION: "fcnet_activation head_fcnet_activation",
        str | None: """
            fcnet_kernel_initializer fcnet_bias_initializer head_fcnet_kernel_initializer head_fcnet_bias_initializer
            lstm_kernel_initializer lstm_bias_initializer
        """,
        _MAPPING | None: """
            fcnet_kernel_initializer_kwargs fcnet_bias_initializer_kwargs head_fcnet_kernel_initializer_kwargs
            head_fcnet_bias_initializer_kwargs lstm_kernel_initializer_kwargs lstm_bias_initializer_kwargs
        """,
        StrictBool: """
            fcnet_use_layernorm head_fcnet_use_layernorm free_log_std vf_share_layers use_lstm lstm_use_prev_action
            lstm_use_prev_reward
        """,
        UNLIMITED: "log_std_clip_param",
        POSITIVE: "max_seq_len lstm_cell_size",
    }
)

#: Defaults that differ from RLlib's.
COMMON_DEFAULTS: dict[str, Any] = {
    "num_env_runners": 0,  # the learner is the bottleneck, and one process starts faster than three
    "num_envs_per_env_runner": 64,
    "sample_timeout_s": 600.0,  # by default RLlib drops the samples of a round without an error after 60 s
    "torch_skip_nan_gradients": True,  # 5 to 15 % faster: it replaces a check of every gradient
    "restart_failed_env_runners": False,  # a restart would repeat a plugin's error a thousand times
    "log_sys_usage": False,
    "seed": 0,
    "torch_num_threads": 1,  # more threads are very slow on a busy machine
    "env_runner": "batched",
    "learner": "fast",
    "learner_threads": 2,  # networks that are trained in parallel, without waiting for one another
}

PPO_DEFAULTS: dict[str, Any] = {
    "lr": 3e-4,
    "lambda": 0.95,
    "train_batch_size_per_learner": 4096,
    "minibatch_size": 512,
    "num_epochs": 10,
}

ALGORITHM_DEFAULTS: dict[str, dict[str, Any]] = {"PPO": PPO_DEFAULTS}

#: The policy and the value function have separate networks.
MODEL_DEFAULTS: dict[str, Any] = {"fcnet_hiddens": [256, 256], "fcnet_activation": "tanh", "vf_share_layers": False}

#: Keys that affect where and how fast a run computes, but not what it learns; a resumed run may change them.
PLACE_KEYS = frozenset(
    name
    for name in (*COMMON_KEYS, *OWN_KEYS)
    if name.startswith(("num_cpus", "num_gpus", "custom_resources", "log_", "torch_compile", "env_runner_"))
    or name.endswith(("_timeout_s", "_restarts_s", "_restarts", "_tolerance"))
    or name in ("env_runner", "learner", "learner_threads", "torch_num_threads", "placement_strategy")
    or name in ("local_gpu_idx", "num_env_runners")
)


#: File that is written by ``scripts/rllib_keys.py`` from the pinned release of Ray.
RELEASE = Path(__file__).with_name("rllib_release.json")


@lru_cache
def keys_of_release() -> dict[str, list[str]]:
    """Return the names of the keys that each algorithm of RLlib has in addition to those of every algorithm."""
    found: dict[str, list[str]] = json.loads(RELEASE.read_text(encoding="utf-8"))
    return found
