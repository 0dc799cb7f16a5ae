"""Keys of RLlib's old API stack, and keys that an experiment must not set, as plain data.

Files that were written for safe-autonomy-sims use the old names. A name that still
exists is translated, one without a meaning today is dropped with its reason, and one
that requests something unsupported is an error.
"""

from __future__ import annotations

#: Old name to new name. A dot separates `model_config` from a key of that mapping.
RENAMED: dict[str, str] = {
    "num_workers": "num_env_runners",
    "num_rollout_workers": "num_env_runners",
    "num_envs_per_worker": "num_envs_per_env_runner",
    "num_cpus_per_worker": "num_cpus_per_env_runner",
    "num_gpus_per_worker": "num_gpus_per_env_runner",
    "custom_resources_per_worker": "custom_resources_per_env_runner",
    "num_cpus_for_driver": "num_cpus_for_main_process",
    "num_cpus_for_local_worker": "num_cpus_for_main_process",
    "num_gpus": "num_gpus_per_learner",
    "num_learner_workers": "num_learners",
    "num_cpus_per_learner_worker": "num_cpus_per_learner",
    "num_gpus_per_learner_worker": "num_gpus_per_learner",
    "train_batch_size": "train_batch_size_per_learner",
    "sgd_minibatch_size": "minibatch_size",
    "num_sgd_iter": "num_epochs",
    "shuffle_sequences": "shuffle_batch_per_epoch",
    "lr_schedule": "lr",
    # the names in other reinforcement learning libraries
    "learning_rate": "lr",
    "n_epochs": "num_epochs",
    "gae_lambda": "lambda",
    "clip_range": "clip_param",
    "ent_coef": "entropy_coeff",
    "vf_coef": "vf_loss_coeff",
    "max_grad_norm": "grad_clip",
    "entropy_coeff_schedule": "entropy_coeff",
    "vf_share_layers": "model_config.vf_share_layers",
    "model": "model_config",
    "rl_module_class": "rl_module",
    "rl_module_spec": "rl_module",
    "evaluation_num_workers": "evaluation_num_env_runners",
    "evaluation_num_episodes": "evaluation_duration",
    "metrics_smoothing_episodes": "metrics_num_episodes_for_smoothing",
    "collect_metrics_timeout": "metrics_episode_collection_timeout_s",
    "min_iter_time_s": "min_time_s_per_iteration",
    "min_time_s_per_reporting": "min_time_s_per_iteration",
    "timesteps_per_iteration": "min_sample_timesteps_per_iteration",
    "min_sample_timesteps_per_reporting": "min_sample_timesteps_per_iteration",
    "min_train_timesteps_per_reporting": "min_train_timesteps_per_iteration",
    "create_env_on_driver": "create_env_on_local_worker",
    "ignore_worker_failures": "ignore_env_runner_failures",
    "recreate_failed_workers": "restart_failed_env_runners",
    "recreate_failed_env_runners": "restart_failed_env_runners",
    "max_num_worker_restarts": "max_num_env_runner_restarts",
    "delay_between_worker_restarts_s": "delay_between_env_runner_restarts_s",
    "num_consecutive_worker_failures_tolerance": "num_consecutive_env_runner_failures_tolerance",
    "worker_health_probe_timeout_s": "env_runner_health_probe_timeout_s",
    "worker_restore_timeout_s": "env_runner_restore_timeout_s",
    "validate_workers_after_construction": "validate_env_runners_after_construction",
}

#: Other spellings of the same key in Python and YAML, which are accepted without a message.
SPELLINGS: dict[str, str] = {"lambda_": "lambda", "framework_str": "framework", "run": "algorithm"}

#: Old keys without an effect, and the reasons.
DROPPED: dict[str, str] = {
    "horizon": "the time limit belongs to the environment (a time-limit done of the agent)",
    "soft_horizon": "the time limit belongs to the environment",
    "no_done_at_end": "the environment distinguishes termination from truncation",
    "clip_actions": "the environments clip actions to their bounds themselves",
    "normalize_actions": "actions are in [-1, 1] already, and the environments clip them",
    "preprocessor_pref": "observations are vectors that the glues normalise",
    "compress_observations": "it has no effect on the current API stack",
    "remote_worker_envs": "the environments of a runner are one batch of arrays",
    "remote_env_batch_wait_ms": "the environments of a runner are one batch of arrays",
    "gym_env_vectorize_mode": "the environments of a runner are one batch of arrays",
    "disable_env_checking": "it has no effect on the current API stack",
    "auto_wrap_old_gym_envs": "it has no effect on the current API stack",
    "render_env": "rendering is a separate command",
    "record_env": "rendering is a separate command",
    "monitor": "rendering is a separate command",
    "eager_tracing": "only Torch is supported",
    "eager_max_retraces": "only Torch is supported",
    "tf_session_args": "only Torch is supported",
    "local_tf_session_args": "only Torch is supported",
    "enable_tf1_exec_eagerly": "only Torch is supported",
    "simple_optimizer": "it has no effect on the current API stack",
    "optimizer": "it has no effect on the current API stack; `lr` and `grad_clip` do",
    "exploration_config": "actions are sampled from the policy's distribution; see `explore`",
    "sample_collector": "it has no effect on the current API stack",
    "sample_async": "it has no effect on the current API stack",
    "sampler_perf_stats_ema_coef": "it has no effect on the current API stack",
    "synchronize_filters": "it has no effect on the current API stack",
    "update_worker_filter_stats": "it has no effect on the current API stack",
    "use_worker_filter_stats": "it has no effect on the current API stack",
    "sync_filters_on_rollout_workers_timeout_s": "it has no effect on the current API stack",
    "keep_per_episode_custom_metrics": "it has no effect on the current API stack",
    "export_native_model_files": "it has no effect on the current API stack",
    "checkpoint_trainable_policies_only": "it has no effect on the current API stack",
    "always_attach_evaluation_results": "it has no effect on the current API stack",
    "fake_sampler": "it has no effect on the current API stack",
    "ignore_final_observation": "it concerns offline data only",
    "enable_connectors": "only the current API stack is supported",
    "enable_rl_module_and_learner": "only the current API stack is supported",
    "enable_env_runner_and_connector_v2": "only the current API stack is supported",
    "_enable_rl_module_api": "only the current API stack is supported",
    "_enable_learner_api": "only the current API stack is supported",
    "policy_map_capacity": "it has no effect on the current API stack",
    "policy_map_cache": "it has no effect on the current API stack",
    "policy_states_are_swappable": "it has no effect on the current API stack",
}

#: Old keys that have no effect at one value and are not supported at any other.
ONLY_AT: dict[str, tuple[tuple[object, ...], str]] = {
    "framework": (("torch", None), "only `torch` is supported; remove the key"),
    "observation_filter": (
        ("NoFilter", None),
        "running filters are not supported; set `normalization` in the glues of the agent instead",
    ),
    "clip_rewards": ((False, None), "it has no effect on RLlib's current API stack; scale the rewards instead"),
}

#: Keys that safe_inspect sets itself, and their source.
RESERVED: dict[str, str] = {
    "env": "the environment is built from `config`, `platform_config` and `agent_config`",
    "env_config": "`env_config` is a key of the experiment, next to `rllib_configs`",
    "observation_space": "it follows from the agent's glues",
    "action_space": "it follows from the agent's glues",
    "action_mask_key": "masks are not supported",
    "env_runner_cls": "safe_inspect chooses the runner",
    "policies": "the policies follow from `agent_config`",
    "policy_mapping_fn": "the policies follow from `agent_config`",
    "policies_to_train": "the policies follow from `agent_config`",
    "multiagent": "the policies follow from `agent_config`",
    "observation_fn": "an agent's observation follows from its glues",
    "count_steps_by": "steps are counted as environment steps",
    "algorithm_config_overrides_per_module": "put the settings of an agent into its `policy` file",
    "callbacks_class": "give your class as `callbacks`",
    "custom_evaluation_function": "use `safe-inspect evaluate`",
    "custom_eval_function": "use `safe-inspect evaluate`",
    "stats_cls_lookup": "it takes Python classes",
    "episodes_to_numpy": "the learner needs arrays",
    "in_evaluation": "RLlib sets it for the evaluation runners",
    "torch_compile_learner_what_to_compile": "it takes a Python value",
    "algo_class": "use `algorithm`",
}

#: Prefixes of names that are rejected for the same reason.
RESERVED_PREFIXES: dict[str, str] = {
    "callbacks_on_": "name a class with these methods as `callbacks`",
    "input_": "offline data is not supported",
    "output": "offline data is not supported",
    "offline_": "offline data is not supported",
    "prelearner_": "offline data is not supported",
    "materialize_": "offline data is not supported",
    "dataset_": "offline data is not supported",
    "map_batches_": "offline data is not supported",
    "iter_batches_": "offline data is not supported",
    "off_policy_": "offline data is not supported",
    "ope_": "offline data is not supported",
    "actions_in_input_": "offline data is not supported",
    "postprocess_inputs": "offline data is not supported",
    "shuffle_buffer_": "offline data is not supported",
    "extra_python_environs": "set environment variables before the command",
    "add_default_connectors": "the connectors of the run are fixed",
    "replay_sequence": "replay settings of RLlib's old API stack have no effect",
    "replay_batch": "replay settings of RLlib's old API stack have no effect",
    "replay_mode": "replay settings of RLlib's old API stack have no effect",
    "replay_proportion": "replay settings of RLlib's old API stack have no effect",
    "prioritized_replay": "replay settings of RLlib's old API stack have no effect",
    "_": "private attributes of RLlib are not settings",
}

#: Parts of names that are rejected at any position.
RESERVED_PARTS: dict[str, str] = {"offline": "offline data is not supported"}

#: Keys of the networks, old name to new name.
MODEL_RENAMED: dict[str, str] = {
    "fcnet_weights_initializer": "fcnet_kernel_initializer",
    "fcnet_weights_initializer_config": "fcnet_kernel_initializer_kwargs",
    "fcnet_bias_initializer_config": "fcnet_bias_initializer_kwargs",
    "post_fcnet_hiddens": "head_fcnet_hiddens",
    "post_fcnet_activation": "head_fcnet_activation",
    "post_fcnet_weights_initializer": "head_fcnet_kernel_initializer",
    "post_fcnet_bias_initializer": "head_fcnet_bias_initializer",
    "lstm_weights_initializer": "lstm_kernel_initializer",
}

#: Old keys of the networks that have no effect for vectors of numbers.
MODEL_DROPPED: dict[str, str] = dict.fromkeys(
    (
        "_disable_action_flattening",
        "_disable_preprocessor_api",
        "_time_major",
        "_use_default_native_models",
        "always_check_shapes",
        "conv_activation",
        "conv_filters",
        "custom_model_config",
        "dim",
        "encoder_latent_dim",
        "framestack",
        "grayscale",
        "no_final_linear",
        "zero_mean",
    ),
    "it has no effect for the policies of this package",
)

#: Old keys of the networks that are accepted at one value only.
MODEL_ONLY_AT: dict[str, tuple[tuple[object, ...], str]] = {
    "use_attention": ((False, None), "RLlib no longer supports attention networks; use `use_lstm`"),
    "custom_model": ((None,), "models of RLlib's old API stack cannot be loaded"),
    "custom_preprocessor": ((None,), "preprocessors of RLlib's old API stack cannot be loaded"),
    "custom_action_dist": ((None,), "distributions of RLlib's old API stack cannot be loaded"),
}
