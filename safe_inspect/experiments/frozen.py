"""Policies that come from a checkpoint and are not trained. Importing this module loads Ray and Torch."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from gymnasium.spaces import MultiDiscrete
from ray.rllib.algorithms.ppo.torch.default_ppo_torch_rl_module import DefaultPPOTorchRLModule
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.rl_module import RLModule, RLModuleSpec

from safe_inspect.environments.group import AgentGroup
from safe_inspect.environments.spaces import action_space, box
from safe_inspect.errors import CheckpointError
from safe_inspect.experiments.checkpoints import policy_folder
from safe_inspect.experiments.fresh_policy import FreshPolicy
from safe_inspect.experiments.policies import PolicySettings, layouts_of

_NO_NOISE = -20.0


class FrozenPolicy(DefaultPPOTorchRLModule):  # type: ignore[misc]
    """RLlib's policy as it flies after its training: a Gaussian one without noise, a categorical one as it is."""

    def _forward_exploration(self, batch: dict[str, Any], **kwargs: Any) -> dict[str, Any]:
        outputs: dict[str, Any] = self._forward(batch)
        if not isinstance(self.action_space, MultiDiscrete):
            mean = outputs[Columns.ACTION_DIST_INPUTS].chunk(2, dim=-1)[0]
            outputs[Columns.ACTION_DIST_INPUTS] = torch.cat((mean, torch.full_like(mean, _NO_NOISE)), dim=-1)
        return outputs


def frozen_spec(policy: PolicySettings) -> RLModuleSpec:
    """Return how RLlib builds a policy that comes from a checkpoint."""
    path = _source(policy)
    module = _load(path)
    own = type(module) in (DefaultPPOTorchRLModule, FreshPolicy)
    return RLModuleSpec(
        module_class=FrozenPolicy if own else type(module),
        observation_space=module.observation_space,
        action_space=module.action_space,
        model_config=dict(module.model_config),
        load_state_path=str(path),
    )


def check_frozen(policies: Mapping[str, PolicySettings], groups: Sequence[AgentGroup]) -> None:
    """Check that each policy that comes from a checkpoint is there and fits its agents.

    Raises:
        CheckpointError: A checkpoint is missing, damaged or of another task.
    """
    layouts = layouts_of(groups)
    for policy in policies.values():
        if policy.trains:
            continue
        module = _load(_source(policy))
        for agent in policy.agents:
            pairs = zip(
                ("observation", "action"),
                (module.observation_space, module.action_space),
                layouts[agent],
                strict=True,
            )
            for what, space, layout in pairs:
                wanted = box(layout) if what == "observation" else action_space(layout)
                if space.shape != wanted.shape or type(space) is not type(wanted):
                    raise CheckpointError(
                        f"{policy.checkpoint}: the policy of {agent} has {space.shape[0]} elements of {what}, and the "
                        f"agent {layout.size}; give a checkpoint of the same glues"
                    )


def _source(policy: PolicySettings) -> Path:
    return policy_folder(policy.checkpoint or "", policy.source_policy, policy.name)


def _load(path: Path) -> Any:
    for name in ("ray.rllib", "ray._common.deprecation"):
        logging.getLogger(name).setLevel(logging.ERROR)
    try:
        return RLModule.from_checkpoint(str(path))
    except Exception as error:  # whatever unpickling meets
        raise CheckpointError(f"{path}: the policy cannot be loaded ({error})") from error
