"""`DqnPolicy`: the policy that DQN trains. Importing this module loads Ray and Torch."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from gymnasium.spaces import MultiDiscrete
from ray.rllib.algorithms.dqn.default_dqn_rl_module import QF_PREDS
from ray.rllib.algorithms.dqn.torch.default_dqn_torch_rl_module import DefaultDQNTorchRLModule
from ray.rllib.core.columns import Columns

from safe_inspect.environments.facades.flat_actions import flat_space
from safe_inspect.errors import ConfigError, Problem
from safe_inspect.experiments.modules.saved_policy import SavedPolicy

#: This package's key in the `model_config` of DQN policies: the number of values of each element of the action.
CHOICES = "choices"
#: Keys of `model_config` that only DQN policies have.
DQN_MODEL_KEYS = frozenset({CHOICES, "double_q", "dueling", "epsilon", "num_atoms", "std_init", "v_max", "v_min"})

_MOST = 4096


class BestChoices(torch.nn.Module):
    """Layer from the values of all combinations of choices to the value of each choice, with the best other choices.

    V_j(k) = max of Q(a) over the combinations a with a_j = k. So the best choice of each element is that of the best
    combination, as `from_flat` computes it from the index with the largest Q.

    Args:
        choices: Number of values of each element, K_1 to K_A.
    """

    def __init__(self, choices: Sequence[int]) -> None:
        super().__init__()
        self.choices = tuple(int(count) for count in choices)

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        """Return the values of the choices, shape (..., K_1 + ... + K_A).

        Args:
            values: The values of the combinations, shape (..., K_1 ... K_A).
        """
        table, before = values.reshape(*values.shape[:-1], *self.choices), values.dim() - 1
        axes = range(before, before + len(self.choices))
        others = [tuple(axis for axis in axes if axis != own) for own in axes]
        return torch.cat([table.amax(dim=rest) if rest else table for rest in others], dim=-1)


class DqnPolicy(SavedPolicy, DefaultDQNTorchRLModule):  # type: ignore[misc]
    """RLlib's policy for DQN, for a task with levels: its action is the index of a combination of levels.

    In inference it also returns the values of the choices, from `BestChoices`, for the action of the task.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        choices = (kwargs.get("model_config") or {}).get(CHOICES)
        if choices:
            kwargs["action_space"] = flat_space(choices)
        super().__init__(*args, **kwargs)  # type: ignore[no-untyped-call]

    def setup(self) -> None:
        """Build the nets."""
        super().setup()  # type: ignore[no-untyped-call]
        own: Any = self.model_config
        space: Any = self.action_space
        self.choices = tuple(own.get(CHOICES) or (int(space.n),))
        self.flown_space = MultiDiscrete(list(self.choices))
        self._best = BestChoices(self.choices)

    def _forward_inference(self, batch: dict[str, Any], **kwargs: Any) -> dict[str, Any]:
        found: dict[str, Any] = self.compute_q_values(batch)
        best: dict[str, Any] = {
            Columns.ACTIONS: found[QF_PREDS].argmax(dim=-1),
            Columns.ACTION_DIST_INPUTS: self._best(found[QF_PREDS]),
        }
        if Columns.STATE_OUT in found:
            best[Columns.STATE_OUT] = found[Columns.STATE_OUT]
        return best


def choices_of(info: Mapping[str, str]) -> list[int]:
    """Return the number of values of each element of the action, from the metadata of a `PolicyInfo`.

    Raises:
        ConfigError: There are too many combinations of values.
    """
    choices = [len(element["levels"]) for element in json.loads(info["action"])]
    if math.prod(choices) > _MOST:
        raise ConfigError(
            Problem(
                f"DQN learns the value of each combination of levels, and there are {math.prod(choices):,} of them",
                "rllib_configs.algorithm",
                hint=f"use PPO, or levels with at most {_MOST:,} combinations",
            )
        )
    return choices
