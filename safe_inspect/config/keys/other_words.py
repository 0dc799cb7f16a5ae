"""Words of other libraries, and the keys of this package that they may refer to."""

from __future__ import annotations

from collections.abc import Collection

from safe_inspect.errors import did_you_mean

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
