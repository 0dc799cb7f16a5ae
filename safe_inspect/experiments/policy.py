"""Trained policies: from a checkpoint to a function of observations."""

from __future__ import annotations

import logging
import os
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.rl_module import RLModule

from safe_inspect.experiments.checkpoints import policy_folder
from safe_inspect.types import FloatArray


class TrainedPolicy:
    """The mean action of a Gaussian policy, without exploration.

    Args:
        module: RLlib's module of the policy.
    """

    def __init__(self, module: Any) -> None:
        self.module = module.eval()

    def __call__(self, observation: NDArray[np.float32]) -> FloatArray:
        """Return the actions (N, A) for observations (N, O)."""
        with torch.no_grad():
            outputs = self.module.forward_inference({Columns.OBS: torch.from_numpy(np.ascontiguousarray(observation))})
        mean = outputs[Columns.ACTION_DIST_INPUTS].chunk(2, dim=-1)[0]
        return np.asarray(mean.numpy(), dtype=np.float64)


def load_policy(checkpoint: str | os.PathLike[str], policy: str | None = None) -> TrainedPolicy:
    """Return a policy of a checkpoint.

    Args:
        checkpoint: The checkpoint's folder.
        policy: Name of the policy, where the checkpoint holds several.

    Raises:
        CheckpointError: The checkpoint is missing or damaged, or has no such policy.
    """
    return TrainedPolicy(_load(checkpoint, policy))


def untrained_policy(checkpoint: str | os.PathLike[str], seed: int = 0, policy: str | None = None) -> TrainedPolicy:
    """Return a policy of the same make as a checkpoint's, with fresh random weights.

    Args:
        checkpoint: The checkpoint's folder.
        seed: Seed of the weights.
        policy: Name of the policy, where the checkpoint holds several.

    Raises:
        CheckpointError: The checkpoint is missing or damaged, or has no such policy.
    """
    module = _load(checkpoint, policy)
    arguments, keywords = module.get_ctor_args_and_kwargs()
    torch.manual_seed(seed)
    return TrainedPolicy(type(module)(*arguments, **keywords))


def _load(checkpoint: str | os.PathLike[str], policy: str | None) -> Any:
    folder = policy_folder(checkpoint, policy)
    logging.getLogger("ray.rllib").setLevel(logging.ERROR)
    return RLModule.from_checkpoint(str(folder))
