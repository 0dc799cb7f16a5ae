"""`export_onnx`: writes a policy of Stable-Baselines3 as an ONNX file, which `safe-inspect evaluate` can read."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

import stable_baselines3
import torch
from gymnasium.spaces import Box, Discrete, MultiDiscrete
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import FlattenExtractor, MlpExtractor
from stable_baselines3.dqn.policies import DQNPolicy
from stable_baselines3.sac.policies import SACPolicy
from stable_baselines3.td3.policies import TD3Policy

from safe_inspect.errors import CheckpointError
from safe_inspect.experiments.export import Exported
from safe_inspect.experiments.perceptron import export_perceptron
from safe_inspect.types import AnyArray


def export_onnx(
    model: BaseAlgorithm, cfg: str | os.PathLike[str], output: str | os.PathLike[str], overrides: Iterable[str] = ()
) -> Exported:
    """Write the policy of a model as an ONNX file: `MlpPolicy` of PPO, A2C, SAC, TD3, DDPG and DQN.

    The file contains the normalisers of the task and the scaling of the action, like that of `safe-inspect export`. The
    actions of SAC are squashed samples, and TD3 and DQN do not sample, so their files only give the most likely action,
    whether actions are sampled or not. The task of a DQN is the one that `FlatDiscreteActions` wraps.

    Args:
        model: The model.
        cfg: Experiment file, or id of a task, of the training.
        output: Path of the ONNX file.
        overrides: ``path.of.keys=value`` for each value to replace.

    Raises:
        CheckpointError: The policy has another form, or does not match the task.
        ConfigError: The experiment has mistakes.
        OutputError: The file cannot be written.
        SafeInspectError: The package onnx or onnxruntime is not installed.
    """
    if model.get_vec_normalize_env() is not None:
        raise CheckpointError("the observations of the model are changed by VecNormalize; train without it")
    layers, log_std = _net(model)
    combined = isinstance(model.action_space, Discrete)
    training = {"steps": int(model.num_timesteps), "trained_by": f"stable_baselines3 {stable_baselines3.__version__}"}
    training |= {} if model.seed is None else {"seed": int(model.seed)}
    return export_perceptron(
        layers, cfg, output, log_std=log_std, combined=combined, overrides=overrides, training=training
    )


def _net(model: BaseAlgorithm) -> tuple[list[torch.nn.Module], torch.Tensor | None]:
    """Return the layers from observation to means or logits, and the logarithms of standard deviations."""
    policy, space = model.policy, model.action_space
    if isinstance(policy, ActorCriticPolicy) and type(policy.mlp_extractor) is MlpExtractor:
        _check_features(policy.pi_features_extractor)
        if getattr(model, "use_sde", False) or not isinstance(space, Box | MultiDiscrete):
            raise _other(f"{type(model).__name__} with use_sde, or with the actions {space}")
        layers = [*policy.mlp_extractor.policy_net, policy.action_net]
        return layers, policy.log_std if isinstance(space, Box) else None
    if isinstance(policy, SACPolicy | TD3Policy) and isinstance(space, Box):
        actor: Any = policy.actor
        _check_features(actor.features_extractor)
        if getattr(model, "use_sde", False):
            raise _other(f"{type(model).__name__} with use_sde")
        own = [*actor.latent_pi, actor.mu, torch.nn.Tanh()] if isinstance(policy, SACPolicy) else [*actor.mu]
        return [*own, _scaled_to(space.low, space.high)], None
    if isinstance(policy, DQNPolicy):
        _check_features(policy.q_net.features_extractor)
        return [*policy.q_net.q_net], None
    raise _other(f"{type(policy).__name__} of {type(model).__name__}")


def _scaled_to(low: AnyArray, high: AnyArray) -> torch.nn.Linear:
    """Return the linear layer that maps -1 to `low` and 1 to `high`, element by element; both have shape (A,)."""
    least, largest = (torch.as_tensor(bound, dtype=torch.float32) for bound in (low, high))
    layer = torch.nn.Linear(len(least), len(least))
    with torch.no_grad():
        layer.weight.copy_(torch.diag((largest - least) / 2.0))
        layer.bias.copy_((largest + least) / 2.0)
    return layer


def _check_features(extractor: Any) -> None:
    if type(extractor) is not FlattenExtractor:
        raise _other(f"a features extractor {type(extractor).__name__}")


def _other(what: str) -> CheckpointError:
    return CheckpointError(f"{what} cannot be exported; MlpPolicy of PPO, A2C, SAC, TD3, DDPG and DQN can")
