"""Keys of RLlib's old API stack, and keys that an experiment must not set, as plain data.

Files that were written for safe-autonomy-sims use the old names. A name that still
exists is translated, one without a meaning today is dropped with its reason, and one
that requests something unsupported is an error.
"""

from __future__ import annotations

from collections.abc import Collection

from safe_inspect.config.keys import by_name
from safe_inspect.config.keys.rllib_keys import COMMON_KEYS
from safe_inspect.errors import did_you_mean

#: Old name to new name; runners were called workers. A dot separates `model_config` from a key of that mapping.
RENAMED: dict[str, str] = {
    key.replace("env_runner", "worker"): key for key in COMMON_KEYS if "env_runner" in key
} | by_name(
    {
        "num_env_runners": "num_rollout_workers",
        "num_cpus_for_main_process": "num_cpus_for_driver num_cpus_for_local_worker",
        "num_gpus_per_learner": "num_gpus num_gpus_per_learner_worker",
        "num_learners": "num_learner_workers",
        "num_cpus_per_learner": "num_cpus_per_learner_worker",
        "train_batch_size_per_learner": "train_batch_size",
        "minibatch_size": "sgd_minibatch_size",
        "num_epochs": "num_sgd_iter",
        "shuffle_batch_per_epoch": "shuffle_sequences",
        "lr": "lr_schedule",
        "entropy_coeff": "entropy_coeff_schedule",
        "model_config.vf_share_layers": "vf_share_layers",
        "model_config": "model",
        "restart_failed_env_runners": "recreate_failed_workers recreate_failed_env_runners",
    }
)

#: Other spellings of the same key in Python and YAML, which are accepted without a message.
SPELLINGS: dict[str, str] = {"lambda_": "lambda", "framework_str": "framework", "run": "algorithm"}

#: Old keys without an effect, and the reasons.
DROPPED: dict[str, str] = by_name(
    {
        "the time limit belongs to the environment (a time-limit done of the agent)": "horizon soft_horizon",
        "the environment distinguishes termination from truncation": "no_done_at_end",
        "the environments clip actions to [-1, 1] themselves": "clip_actions normalize_actions",
        "observations are vectors that the glues normalise": "preprocessor_pref",
        "rendering is a separate command": "render_env record_env monitor",
        "only the current API stack is supported": """
            enable_rl_module_and_learner enable_env_runner_and_connector_v2 simple_optimizer compress_observations
            disable_env_checking eager_tracing
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
        "the policies follow from `agent_config`": "policies policy_mapping_fn policies_to_train multiagent",
        "put the settings of an agent into its `policy` file": "algorithm_config_overrides_per_module",
        "give your class as `callbacks`": "callbacks_class",
    }
)

#: Keys of the networks, old name to new name.
MODEL_RENAMED: dict[str, str] = {f"post_{key}": f"head_{key}" for key in ("fcnet_hiddens", "fcnet_activation")}

#: Old keys of the networks that are accepted at one value only.
MODEL_ONLY_AT: dict[str, tuple[tuple[object, ...], str]] = {
    "use_attention": ((False, None), "RLlib no longer supports attention networks; use `use_lstm`"),
    "custom_model": ((None,), "models of RLlib's old API stack cannot be loaded"),
}

#: The key for each word of users and of other libraries; these words are only suggestions, between which the user
#: decides.
OTHER_WORDS: dict[str, str] = by_name(
    {
        "training_iteration": "max_iterations num_iterations n_iterations iterations training_iterations max_iter",
        "num_env_steps_sampled_lifetime": """
            total_timesteps total_steps timesteps max_timesteps num_timesteps env_steps steps
        """,
        "horizon": "max_episode_steps max_episode_length episode_length max_steps time_limit",
        "rollout_fragment_length": "n_steps num_steps rollout_length unroll_length",
        "num_envs_per_env_runner": "num_envs n_envs",
        "num_env_runners": "workers n_workers num_actors",
        "num_epochs": "n_epochs update_epochs epochs",
        "lr": "learning_rate",
        "gamma": "discount discount_factor",
        "lambda": "gae_lambda",
        "clip_param": "clip_range clip_ratio clip_eps clip_epsilon clip_coef",
        "entropy_coeff": "ent_coef",
        "vf_loss_coeff": "vf_coef",
        "grad_clip": "max_grad_norm",
        "fcnet_hiddens": "net_arch hidden_sizes hidden_layers layers",
        "fcnet_activation": "activation activation_fn",
        "algorithm": "algo",
    }
)


def key_hint(word: str, known: Collection[str]) -> str:
    """Return a hint with the known key that a word may refer to, in the form of `did_you_mean`."""
    key = OTHER_WORDS.get(word)
    return f"did you mean `{key}`?" if key in known else did_you_mean(word, known)
