"""`FreshPolicy`: RLlib's PPO policy with initial weights of one's own. Importing this module loads Ray and Torch."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import torch
from gymnasium.spaces import MultiDiscrete
from ray.rllib.algorithms.ppo.torch.default_ppo_torch_rl_module import DefaultPPOTorchRLModule
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.rllib.core.rl_module.rl_module import RLModule, RLModuleSpec

from safe_inspect.errors import CheckpointError
from safe_inspect.evaluation.shipped import shipped_policies, shipped_policy
from safe_inspect.experiments.checkpoints import policy_folder
from safe_inspect.experiments.keys import FRESH_KEYS

_HIDDEN_GAIN = math.sqrt(2.0)
_POLICY_GAIN = 0.01


class FreshPolicy(DefaultPPOTorchRLModule):  # type: ignore[misc]
    """RLlib's policy; its `model_config` may also hold the keys of `FRESH_KEYS`.

    A policy that begins with thrust at every step leaves the scene at once and learns to save fuel before it has seen
    an inspection. So ``initial_choice`` names the choice that a fresh categorical policy prefers, coasting as a rule,
    with ``initial_probability`` (0.9 unless given), and ``initial_std`` the standard deviation of a fresh Gaussian one.
    ``orthogonal`` draws orthogonal weights of gain sqrt(2), of gain 0.01 in the last layer of the policy.
    ``initial_weights`` is the folder of a checkpoint with one policy, or the name of a policy that the package ships,
    of the same nets, observations and actions, that learns on: a team may begin with what one deputy has learned.
    """

    def setup(self) -> None:
        """Build the nets, and set their first weights."""
        super().setup()  # type: ignore[no-untyped-call]
        own: Any = self.model_config
        with torch.no_grad():
            if own.get("orthogonal"):
                self._draw_orthogonal()
            if own.get("initial_choice") is not None:
                self._prefer(int(own["initial_choice"]), float(own.get("initial_probability", 0.9)))
            if own.get("initial_std") is not None and not isinstance(self.action_space, MultiDiscrete):
                bias = _last(self.pi).bias
                bias[len(bias) // 2 :] = math.log(float(own["initial_std"]))
            if own.get("initial_weights"):
                self._take(str(own["initial_weights"]))
                # A checkpoint builds the module anew with this, and the other one may be gone by then.
                self.model_config = {**own, "initial_weights": None}

    def _take(self, checkpoint: str) -> None:
        try:
            folder = shipped_policy(checkpoint).checkpoint if checkpoint in shipped_policies() else checkpoint
            found = RLModule.from_checkpoint(str(policy_folder(folder))).get_state()
            self.load_state_dict({key: torch.as_tensor(value) for key, value in found.items()})
        except (RuntimeError, ValueError) as error:
            told = str(error).strip().splitlines()[-1].strip()
            raise CheckpointError(f"{checkpoint}: its policy is no beginning for this one ({told})") from None

    def _draw_orthogonal(self) -> None:
        for part in (self.encoder, self.pi, self.vf):
            for layer in part.modules():
                if isinstance(layer, torch.nn.Linear):
                    torch.nn.init.orthogonal_(layer.weight, _HIDDEN_GAIN)
                    torch.nn.init.zeros_(layer.bias)
        torch.nn.init.orthogonal_(_last(self.pi).weight, _POLICY_GAIN)
        torch.nn.init.orthogonal_(_last(self.vf).weight, 1.0)

    def _prefer(self, choice: int, probability: float) -> None:
        if not isinstance(self.action_space, MultiDiscrete):
            return
        bias, first = _last(self.pi).bias, 0
        for size in self.action_space.nvec.tolist():
            if choice >= size:
                raise ValueError(f"`initial_choice` ({choice}) is beyond the last of {size} choices, {size - 1}")
            others = max(size - 1, 1)
            bias[first : first + size] = 0.0
            bias[first + choice] = math.log(probability * others / (1.0 - probability))
            first += size


def _last(head: torch.nn.Module) -> torch.nn.Linear:
    return [layer for layer in head.modules() if isinstance(layer, torch.nn.Linear)][-1]


def policy_spec(model: Mapping[str, Any]) -> RLModuleSpec:
    """Return how RLlib builds a policy that learns, from the keys of `model_config`."""
    own = {key: value for key, value in model.items() if key in FRESH_KEYS}
    known = DefaultModelConfig(**{key: value for key, value in model.items() if key not in FRESH_KEYS})
    if not own:
        return RLModuleSpec(model_config=known)
    return RLModuleSpec(module_class=FreshPolicy, model_config={**dataclasses.asdict(known), **own})
