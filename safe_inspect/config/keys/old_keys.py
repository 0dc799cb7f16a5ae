"""Keys of RLlib's old API stack, and keys that an experiment must not set, as plain data.

Files that were written for safe-autonomy-sims use the old names. A name that still
exists is translated, one without a meaning today is dropped with its reason, and one
that requests something unsupported is an error.
"""

from __future__ import annotations

from collections.abc import Collection

from safe_inspect.config.keys import by_name
from safe_inspect.errors import did_you_mean

#: Keys whose old names have `worker` in place of `env_runner`.
_OF_RUNNERS = """
    num_env_runners num_envs_per_env_runner num_cpus_per_env_runner num_gpus_per_env_runner
    custom_resources_per_env_runner evaluation_num_env_runners ignore_env_runner_failures max_num_env_runner_restarts
    delay_between_env_runner_restarts_s num_consecutive_env_runner_failures_tolerance env_runner_health_probe_timeout_s
    env_runner_restore_timeout_s validate_env_runners_after_construction
"""

#: Old name to new name, with the names of other libraries. A dot separates `model_config` from a key of that mapping.
RENAMED: dict[str, str] = {key.replace("env_runner", "worker"): key for key in _OF_RUNNERS.split()} | by_name(
    {
        "num_env_runners": "num_rollout_workers",
        "num_cpus_for_main_process": "num_cpus_for_driver num_cpus_for_local_worker",
        "num_gpus_per_learner": "num_gpus num_gpus_per_learner_worker",
        "num_learners": "num_learner_workers",
        "num_cpus_per_learner": "num_cpus_per_learner_worker",
        "train_batch_size_per_learner": "train_batch_size",
        "minibatch_size": "sgd_minibatch_size",
        "num_epochs": "num_sgd_iter n_epochs",
        "shuffle_batch_per_epoch": "shuffle_sequences",
        "lr": "lr_schedule learning_rate",
        "lambda": "gae_lambda",
        "clip_param": "clip_range",
        "entropy_coeff": "ent_coef entropy_coeff_schedule",
        "vf_loss_coeff": "vf_coef",
        "grad_clip": "max_grad_norm",
        "model_config.vf_share_layers": "vf_share_layers",
        "model_config": "model",
        "rl_module": "rl_module_class rl_module_spec",
        "evaluation_duration": "evaluation_num_episodes",
        "metrics_num_episodes_for_smoothing": "metrics_smoothing_episodes",
        "metrics_episode_collection_timeout_s": "collect_metrics_timeout",
        "min_time_s_per_iteration": "min_iter_time_s min_time_s_per_reporting",
        "min_sample_timesteps_per_iteration": "timesteps_per_iteration min_sample_timesteps_per_reporting",
        "min_train_timesteps_per_iteration": "min_train_timesteps_per_reporting",
        "create_env_on_local_worker": "create_env_on_driver",
        "restart_failed_env_runners": "recreate_failed_workers recreate_failed_env_runners",
    }
)

#: Other spellings of the same key in Python and YAML, which are accepted without a message.
SPELLINGS: dict[str, str] = {"lambda_": "lambda", "framework_str": "framework", "run": "algorithm"}

#: Old keys without an effect, and the reasons.
DROPPED: dict[str, str] = by_name(
    {
        "the time limit belongs to the environment (a time-limit done of the agent)": "horizon",
        "the time limit belongs to the environment": "soft_horizon",
        "the environment distinguishes termination from truncation": "no_done_at_end",
        "the environments clip actions to their bounds themselves": "clip_actions",
        "actions are in [-1, 1] already, and the environments clip them": "normalize_actions",
        "observations are vectors that the glues normalise": "preprocessor_pref",
        "it has no effect on the current API stack": """
            compress_observations disable_env_checking auto_wrap_old_gym_envs simple_optimizer sample_collector
            sample_async sampler_perf_stats_ema_coef synchronize_filters update_worker_filter_stats
            use_worker_filter_stats sync_filters_on_rollout_workers_timeout_s keep_per_episode_custom_metrics
            export_native_model_files checkpoint_trainable_policies_only always_attach_evaluation_results fake_sampler
            policy_map_capacity policy_map_cache policy_states_are_swappable
        """,
        "the environments of a runner are one batch of arrays": """
            remote_worker_envs remote_env_batch_wait_ms gym_env_vectorize_mode
        """,
        "rendering is a separate command": "render_env record_env monitor",
        "only Torch is supported": """
            eager_tracing eager_max_retraces tf_session_args local_tf_session_args enable_tf1_exec_eagerly
        """,
        "it has no effect on the current API stack; `lr` and `grad_clip` do": "optimizer",
        "actions are sampled from the policy's distribution; see `explore`": "exploration_config",
        "it concerns offline data only": "ignore_final_observation",
        "only the current API stack is supported": """
            enable_connectors enable_rl_module_and_learner enable_env_runner_and_connector_v2 _enable_rl_module_api
            _enable_learner_api
        """,
    }
)

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
RESERVED: dict[str, str] = by_name(
    {
        "the environment is built from `config`, `platform_config` and `agent_config`": "env",
        "`env_config` is a key of the experiment, next to `rllib_configs`": "env_config",
        "it follows from the agent's glues": "observation_space action_space",
        "masks are not supported": "action_mask_key",
        "safe_inspect chooses the runner": "env_runner_cls",
        "the policies follow from `agent_config`": "policies policy_mapping_fn policies_to_train multiagent",
        "an agent's observation follows from its glues": "observation_fn",
        "steps are counted as environment steps": "count_steps_by",
        "put the settings of an agent into its `policy` file": "algorithm_config_overrides_per_module",
        "give your class as `callbacks`": "callbacks_class",
        "use `safe-inspect evaluate`": "custom_evaluation_function custom_eval_function",
        "it takes Python classes": "stats_cls_lookup",
        "the learner needs arrays": "episodes_to_numpy",
        "RLlib sets it for the evaluation runners": "in_evaluation",
        "it takes a Python value": "torch_compile_learner_what_to_compile",
        "use `algorithm`": "algo_class",
    }
)

#: Prefixes of names that are rejected for the same reason.
RESERVED_PREFIXES: dict[str, str] = by_name(
    {
        "name a class with these methods as `callbacks`": "callbacks_on_",
        "offline data is not supported": """
            input_ output offline_ prelearner_ materialize_ dataset_ map_batches_ iter_batches_ off_policy_ ope_
            actions_in_input_ postprocess_inputs shuffle_buffer_
        """,
        "set environment variables before the command": "extra_python_environs",
        "the connectors of the run are fixed": "add_default_connectors",
        "replay settings of RLlib's old API stack have no effect": """
            replay_sequence replay_batch replay_mode replay_proportion prioritized_replay
        """,
        "private attributes of RLlib are not settings": "_",
    }
)

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
MODEL_DROPPED: dict[str, str] = by_name(
    {
        "it has no effect for the policies of this package": """
            _disable_action_flattening _disable_preprocessor_api _time_major _use_default_native_models
            always_check_shapes conv_activation conv_filters custom_model_config dim encoder_latent_dim framestack
            grayscale no_final_linear zero_mean
        """,
    }
)

#: Old keys of the networks that are accepted at one value only.
MODEL_ONLY_AT: dict[str, tuple[tuple[object, ...], str]] = {
    "use_attention": ((False, None), "RLlib no longer supports attention networks; use `use_lstm`"),
    "custom_model": ((None,), "models of RLlib's old API stack cannot be loaded"),
    "custom_preprocessor": ((None,), "preprocessors of RLlib's old API stack cannot be loaded"),
    "custom_action_dist": ((None,), "distributions of RLlib's old API stack cannot be loaded"),
}


_ITERATIONS = ("max_iterations", "num_iterations", "n_iterations", "iterations", "training_iterations", "max_iter")
_STEPS = ("total_timesteps", "total_steps", "timesteps", "max_timesteps", "num_timesteps", "env_steps", "steps")
_EPISODE = ("max_episode_steps", "max_episode_length", "episode_length", "max_steps", "time_limit")

#: The key for each word. Words of `old_keys` have exactly the meaning of their key and replace it; these words are only
#: suggestions, between which the user decides.
OTHER_WORDS: dict[str, str] = {
    **dict.fromkeys(_ITERATIONS, "training_iteration"),
    **dict.fromkeys(_STEPS, "num_env_steps_sampled_lifetime"),
    **dict.fromkeys(_EPISODE, "horizon"),
    **dict.fromkeys(("n_steps", "num_steps", "rollout_length", "unroll_length"), "rollout_fragment_length"),
    **dict.fromkeys(("num_envs", "n_envs"), "num_envs_per_env_runner"),
    **dict.fromkeys(("workers", "n_workers", "num_actors"), "num_env_runners"),
    **dict.fromkeys(("discount", "discount_factor"), "gamma"),
    **dict.fromkeys(("clip_ratio", "clip_eps", "clip_epsilon", "clip_coef"), "clip_param"),
    **dict.fromkeys(("net_arch", "hidden_sizes", "hidden_layers", "layers"), "fcnet_hiddens"),
    **dict.fromkeys(("activation", "activation_fn"), "fcnet_activation"),
    **dict.fromkeys(("update_epochs", "epochs"), "num_epochs"),
    "algo": "algorithm",
}


def key_hint(word: str, known: Collection[str]) -> str:
    """Return a hint with the known key that a word may refer to, in the form of `did_you_mean`."""
    key = OTHER_WORDS.get(word)
    return f"did you mean `{key}`?" if key in known else did_you_mean(word, known)
