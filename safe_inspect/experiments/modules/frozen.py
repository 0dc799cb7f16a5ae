"""Policies that are loaded from a checkpoint and not trained. Importing this module loads Ray and Torch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from gymnasium.spaces import MultiDiscrete
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.rl_module import RLModuleSpec

from safe_inspect.environments.facades.spaces import action_space, box
from safe_inspect.environments.group import AgentGroup
from safe_inspect.errors import CheckpointError
from safe_inspect.evaluation.policy_file import check_layout
from safe_inspect.experiments.files.checkpoints import policy_folder
from safe_inspect.experiments.files.weights import read_weights
from safe_inspect.experiments.modules.dqn_policy import CHOICES
from safe_inspect.experiments.modules.fresh_policy import FreshPolicy
from safe_inspect.experiments.modules.sac_policy import TWIN_Q
from safe_inspect.experiments.modules.saved_policy import load_arrays
from safe_inspect.experiments.settings.policies import PolicySettings, layouts_of
from safe_inspect.random.action_draws import NO_NOISE

_SOURCE = "frozen_from"


class FrozenPolicy(FreshPolicy):
    """RLlib's policy as it acts after its training: burns have no noise, and choices are sampled.

    ``frozen_from`` in its `model_config` is the folder of the policy in its checkpoint.
    """

    def setup(self) -> None:
        """Build the nets and load their weights."""
        super().setup()
        own: Any = self.model_config
        if own.get(_SOURCE) and not self.inference_only:  # a runner gets its weights from the learner
            load_arrays(self, read_weights(Path(own[_SOURCE])).arrays, own[_SOURCE])
        self.model_config = {key: value for key, value in own.items() if key != _SOURCE}

    def _forward_exploration(self, batch: dict[str, Any], **kwargs: Any) -> dict[str, Any]:
        outputs: dict[str, Any] = self._forward(batch)
        if not isinstance(self.action_space, MultiDiscrete):
            quiet = outputs[Columns.ACTION_DIST_INPUTS].clone()
            quiet[..., self.log_deviations()] = NO_NOISE
            outputs[Columns.ACTION_DIST_INPUTS] = quiet
        return outputs


def frozen_spec(policy: PolicySettings) -> RLModuleSpec:
    """Return RLlib's specification of a policy that is loaded from a checkpoint."""
    folder = _source(policy)
    weights = read_weights(folder)
    return RLModuleSpec(
        module_class=FrozenPolicy,
        observation_space=weights.observation_space,
        action_space=weights.action_space,
        model_config={**weights.model, "initial_weights": None, _SOURCE: str(folder)},
    )


def check_frozen(policies: Mapping[str, PolicySettings], groups: Sequence[AgentGroup]) -> None:
    """Check that each policy that is loaded from a checkpoint exists and matches its agents.

    Raises:
        CheckpointError: A checkpoint is missing, damaged or of another task.
    """
    layouts = layouts_of(groups)
    group_of = {agent: group for group in groups for agent in group.agents}
    for policy in policies.values():
        if policy.trains:
            continue
        weights = read_weights(_source(policy))
        if {CHOICES, TWIN_Q} & weights.model.keys():
            raise CheckpointError(
                f"{policy.checkpoint}: policies of SAC and DQN cannot be combined with policies that learn; "
                "give one of PPO"
            )
        for agent in policy.agents:
            pairs = zip(
                ("observation", "action"),
                (weights.observation_space, weights.action_space),
                layouts[agent],
                strict=True,
            )
            for what, space, layout in pairs:
                wanted = box(layout) if what == "observation" else action_space(layout)
                if space.shape != wanted.shape or type(space) is not type(wanted):
                    raise CheckpointError(
                        f"{policy.checkpoint}: the policy of {agent} has {space.shape[0]} elements of {what}, but the "
                        f"agent has {layout.size}; give a checkpoint with the same glues"
                    )
            if weights.info is not None:
                check_layout(str(policy.checkpoint), weights.info, replace(group_of[agent].agent, name=agent))


def _source(policy: PolicySettings) -> Path:
    return policy_folder(policy.checkpoint or "", policy.source_policy, policy.name)
