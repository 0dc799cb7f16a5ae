"""The keys that an experiment may give to RLlib, as plain data.

RLlib accepts any key without a message: unknown ones, and many of its old API stack, have
no effect. Therefore these tables list the valid keys. They import nothing, because
`safe-inspect validate` must work without loading Ray; a test compares them with the
installed release of Ray.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Key:
    """The values that a key accepts.

    Attributes:
        kind: ``integer``, ``number``, ``boolean``, ``text``, ``mapping``, ``integers`` (a list of them),
            ``schedule`` (a number, or pairs of step and number), ``names`` (a dotted path of a class, or a list) or
            ``objects`` (`{functor: module.Class, config: {...}}` or a dotted path, or a list), ``object`` for one.
        low: Smallest value of a number.
        high: Largest value of a number; infinity is valid only if it is this value.
        choices: The strings that are valid; for a number, strings that are valid in addition.
        optional: Whether null is valid.
    """

    kind: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    optional: bool = False


_COUNT = Key("integer", low=0)
_POSITIVE = Key("integer", low=1)
_SECONDS = Key("number", low=0, high=math.inf)
_SHARE = Key("number", low=0, high=1)
_AMOUNT = Key("number", low=0)
_SWITCH = Key("boolean")
_MAPPING = Key("mapping")
_TEXT = Key("text")

#: Keys of every RLlib algorithm: attributes of `AlgorithmConfig`.
COMMON_KEYS: dict[str, Key] = {
    # training
    "gamma": _SHARE,
    "lr": Key("schedule", low=0),
    "grad_clip": Key("number", low=0, high=math.inf, optional=True),
    "grad_clip_by": Key("text", choices=("value", "norm", "global_norm")),
    "train_batch_size_per_learner": _POSITIVE,
    "num_epochs": _POSITIVE,
    "minibatch_size": Key("integer", low=1, optional=True),
    "shuffle_batch_per_epoch": _SWITCH,
    "learner_config_dict": _MAPPING,
    # sampling
    "num_env_runners": _COUNT,
    "num_envs_per_env_runner": _POSITIVE,
    "num_cpus_per_env_runner": _AMOUNT,
    "num_gpus_per_env_runner": _AMOUNT,
    "custom_resources_per_env_runner": _MAPPING,
    "rollout_fragment_length": Key("integer", low=1, choices=("auto",)),
    "batch_mode": Key("text", choices=("truncate_episodes", "complete_episodes")),
    "explore": _SWITCH,
    "sample_timeout_s": Key("number", low=0, high=math.inf, optional=True),
    "validate_env_runners_after_construction": _SWITCH,
    "max_requests_in_flight_per_env_runner": _POSITIVE,
    "create_env_on_local_worker": _SWITCH,
    "create_local_env_runner": _SWITCH,
    "merge_env_runner_states": Key("boolean", choices=("training_only",)),
    "broadcast_env_runner_states": _SWITCH,
    "use_env_runner_state_server": _SWITCH,
    "env_runner_state_server_max_concurrency": _POSITIVE,
    "episode_lookback_horizon": _COUNT,
    # learners and resources
    "num_learners": _COUNT,
    "num_cpus_per_learner": Key("number", low=0, choices=("auto",)),
    "num_gpus_per_learner": _AMOUNT,
    "custom_resources_per_learner": _MAPPING,
    "num_aggregator_actors_per_learner": _COUNT,
    "max_requests_in_flight_per_aggregator_actor": _POSITIVE,
    "max_requests_in_flight_per_learner": _POSITIVE,
    "local_gpu_idx": _COUNT,
    "num_cpus_for_main_process": _AMOUNT,
    "custom_resources_for_main_process": _MAPPING,
    "placement_strategy": Key("text", choices=("PACK", "SPREAD", "STRICT_PACK", "STRICT_SPREAD")),
    # Torch
    "torch_compile_learner": _SWITCH,
    "torch_compile_learner_dynamo_backend": _TEXT,
    "torch_compile_learner_dynamo_mode": Key("text", optional=True),
    "torch_compile_worker": _SWITCH,
    "torch_compile_worker_dynamo_backend": _TEXT,
    "torch_compile_worker_dynamo_mode": Key("text", optional=True),
    "torch_ddp_kwargs": _MAPPING,
    "torch_skip_nan_gradients": _SWITCH,
    # evaluation
    "evaluation_interval": Key("integer", low=1, optional=True),
    "evaluation_duration": Key("integer", low=1, choices=("auto",)),
    "evaluation_duration_unit": Key("text", choices=("episodes", "timesteps")),
    "evaluation_num_env_runners": _COUNT,
    "evaluation_parallel_to_training": _SWITCH,
    "evaluation_force_reset_envs_before_iteration": _SWITCH,
    "evaluation_config": Key("mapping", optional=True),
    "evaluation_sample_timeout_s": _SECONDS,
    "evaluation_auto_duration_min_env_steps_per_sample": _POSITIVE,
    "evaluation_auto_duration_max_env_steps_per_sample": _POSITIVE,
    "evaluation_unhealthy_workers_timeout_s": _SECONDS,
    "evaluation_error_after_n_consecutive_skips": Key("integer", low=1, optional=True),
    # reporting
    "metrics_num_episodes_for_smoothing": _POSITIVE,
    "metrics_episode_collection_timeout_s": _SECONDS,
    "min_time_s_per_iteration": Key("number", low=0, optional=True),
    "min_train_timesteps_per_iteration": _COUNT,
    "min_sample_timesteps_per_iteration": _COUNT,
    "log_gradients": _SWITCH,
    "log_level": Key("text", choices=("DEBUG", "INFO", "WARN", "ERROR")),
    "log_sys_usage": _SWITCH,
    "seed": Key("integer", low=0, high=2**32 - 1, optional=True),  # NumPy's generators, which RLlib seeds, take no more
    # failures
    "restart_failed_env_runners": _SWITCH,
    "ignore_env_runner_failures": _SWITCH,
    "max_num_env_runner_restarts": _COUNT,
    "delay_between_env_runner_restarts_s": _SECONDS,
    "restart_failed_sub_environments": _SWITCH,
    "num_consecutive_env_runner_failures_tolerance": _COUNT,
    "env_runner_health_probe_timeout_s": _SECONDS,
    "env_runner_restore_timeout_s": _SECONDS,
}

#: Additional keys of PPO.
PPO_KEYS: dict[str, Key] = {
    "lambda": _SHARE,
    "use_critic": _SWITCH,
    "use_gae": _SWITCH,
    "use_kl_loss": _SWITCH,
    "kl_coeff": _AMOUNT,
    "kl_target": _AMOUNT,
    "vf_loss_coeff": _AMOUNT,
    "entropy_coeff": Key("schedule", low=0),
    "clip_param": Key("number", low=1e-6, high=math.inf),  # with 0 there is no gradient
    "vf_clip_param": Key("number", low=1e-6, high=math.inf),
}

_REPLAY_KEYS: dict[str, Key] = {
    "replay_buffer_config": _MAPPING,
    "num_steps_sampled_before_learning_starts": _COUNT,
    "target_network_update_freq": _COUNT,
    "training_intensity": Key("number", low=0, optional=True),
    "store_buffer_in_checkpoints": _SWITCH,
    "tau": _SHARE,
}
_RATE = Key("schedule", low=0, optional=True)

#: Additional keys of SAC that are often set.
SAC_KEYS: dict[str, Key] = {
    **_REPLAY_KEYS,
    "actor_lr": _RATE,
    "critic_lr": _RATE,
    "alpha_lr": _RATE,
    "initial_alpha": _AMOUNT,
    "target_entropy": Key("number", choices=("auto",)),
    "twin_q": _SWITCH,
}

#: Additional keys of DQN that are often set.
DQN_KEYS: dict[str, Key] = {
    **_REPLAY_KEYS,
    "epsilon": Key("schedule", low=0, high=1),
    "double_q": _SWITCH,
    "dueling": _SWITCH,
    "num_atoms": _POSITIVE,
    "v_min": Key("number"),
    "v_max": Key("number"),
    "adam_epsilon": _AMOUNT,
    "td_error_loss_fn": Key("text", choices=("huber", "mse")),
}

#: Algorithms with a table of additional keys here. The values of keys that are in no table are checked when Ray is
#: loaded; their names are in `rllib_release`.
ALGORITHM_KEYS: dict[str, dict[str, Key]] = {"PPO": PPO_KEYS, "SAC": SAC_KEYS, "DQN": DQN_KEYS}
#: Algorithms with a complete table, for which any other key is a mistake.
CLOSED_ALGORITHMS = ("PPO",)

#: Names of RLlib's algorithms for environments (offline algorithms need data and are rejected).
ALGORITHMS = ("PPO", "APPO", "IMPALA", "SAC", "DQN", "DreamerV3")

#: Algorithms that the batched runner supports.
BATCHED_ALGORITHMS = ("PPO", "APPO", "IMPALA")
#: Algorithms whose policies can be evaluated and, unless they are recurrent, exported.
FLOWN_ALGORITHMS = (*BATCHED_ALGORITHMS, "SAC", "DQN")

#: Keys of safe_inspect that are given with RLlib's.
OWN_KEYS: dict[str, Key] = {
    "algorithm": _TEXT,
    "model_config": _MAPPING,
    "torch_num_threads": _POSITIVE,
    "env_runner": Key("text", choices=("batched", "stock")),
    "learner": Key("text", choices=("fast", "stock")),
    "learner_threads": _POSITIVE,
    "callbacks": Key("names", optional=True),
    "rl_module": Key("object", optional=True),
    "env_to_module_connector": Key("objects", optional=True),
    "module_to_env_connector": Key("objects", optional=True),
    "learner_connector": Key("objects", optional=True),
}

#: Keys whose objects change a policy, its input or its output, so that its weights alone do not define it.
CHANGING_KEYS = ("rl_module", "env_to_module_connector", "module_to_env_connector")

#: Keys that may differ between policies that are trained together.
POLICY_KEYS = (
    "lr",
    "grad_clip",
    "grad_clip_by",
    "clip_param",
    "vf_clip_param",
    "vf_loss_coeff",
    "entropy_coeff",
    "use_kl_loss",
    "kl_coeff",
    "kl_target",
    "model_config",
)

_ACTIVATION = Key("text", choices=("tanh", "relu", "swish", "silu", "linear"), optional=True)

#: Initial weights of a policy: keys of safe_inspect in `model_config`, for PPO.
FRESH_KEYS: dict[str, Key] = {
    "orthogonal": _SWITCH,
    "initial_choice": Key("integer", low=0, optional=True),
    "initial_probability": Key("number", low=0.01, high=0.99),
    "hurdle": _SWITCH,
    "initial_burn_probability": Key("number", low=0.01, high=0.99),
    "initial_std": Key("number", low=1e-4, optional=True),
    "initial_weights": Key("text", optional=True),
}

#: Keys of the networks: attributes of `DefaultModelConfig` that apply to vectors of numbers.
MODEL_KEYS: dict[str, Key] = {
    "fcnet_hiddens": Key("integers", low=1),
    "fcnet_activation": _ACTIVATION,
    "fcnet_kernel_initializer": Key("text", optional=True),
    "fcnet_kernel_initializer_kwargs": Key("mapping", optional=True),
    "fcnet_bias_initializer": Key("text", optional=True),
    "fcnet_bias_initializer_kwargs": Key("mapping", optional=True),
    "fcnet_use_layernorm": _SWITCH,
    "head_fcnet_hiddens": Key("integers", low=1),
    "head_fcnet_activation": _ACTIVATION,
    "head_fcnet_kernel_initializer": Key("text", optional=True),
    "head_fcnet_kernel_initializer_kwargs": Key("mapping", optional=True),
    "head_fcnet_bias_initializer": Key("text", optional=True),
    "head_fcnet_bias_initializer_kwargs": Key("mapping", optional=True),
    "head_fcnet_use_layernorm": _SWITCH,
    "free_log_std": _SWITCH,
    "log_std_clip_param": Key("number", low=0, high=math.inf),
    "vf_share_layers": _SWITCH,
    "use_lstm": _SWITCH,
    "max_seq_len": _POSITIVE,
    "lstm_cell_size": _POSITIVE,
    "lstm_use_prev_action": _SWITCH,
    "lstm_use_prev_reward": _SWITCH,
    "lstm_kernel_initializer": Key("text", optional=True),
    "lstm_kernel_initializer_kwargs": Key("mapping", optional=True),
    "lstm_bias_initializer": Key("text", optional=True),
    "lstm_bias_initializer_kwargs": Key("mapping", optional=True),
}

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
MODEL_DEFAULTS: dict[str, Any] = {
    "fcnet_hiddens": [256, 256],
    "fcnet_activation": "tanh",
    "vf_share_layers": False,
}

#: Keys that affect where and how fast a run computes, but not what it learns; a resumed run may change them.
PLACE_KEYS = frozenset(
    name
    for name in (*COMMON_KEYS, *OWN_KEYS)
    if name.startswith(("num_cpus", "num_gpus", "custom_resources", "log_", "torch_compile", "env_runner_"))
    or name.endswith(("_timeout_s", "_restarts_s", "_restarts", "_tolerance"))
    or name in ("env_runner", "learner", "learner_threads", "torch_num_threads", "placement_strategy")
    or name in ("local_gpu_idx", "num_env_runners")
)
