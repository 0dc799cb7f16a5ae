"""`SavedPolicy`: an RLlib module that also saves its weights without pickle, and the policies of SAC, APPO and DQN.

Importing this module loads Ray and Torch.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from gymnasium.spaces import MultiDiscrete
from pyarrow.fs import FileSystem, LocalFileSystem  # type: ignore[import-untyped]
from ray.rllib.algorithms.appo.torch.default_appo_torch_rl_module import DefaultAPPOTorchRLModule
from ray.rllib.algorithms.dqn.default_dqn_rl_module import QF_PREDS
from ray.rllib.algorithms.dqn.torch.default_dqn_torch_rl_module import DefaultDQNTorchRLModule
from ray.rllib.algorithms.sac.torch.default_sac_torch_rl_module import DefaultSACTorchRLModule
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.rl_module import RLModule

from safe_inspect.environments.facades.spaces import flat_space
from safe_inspect.errors import CheckpointError, ConfigError, Problem
from safe_inspect.experiments.files.checkpoints import WEIGHTS
from safe_inspect.experiments.files.weights import pack
from safe_inspect.types import AnyArray


class SavedPolicy(RLModule):  # type: ignore[misc]
    """Base class of the package's policies, which adds a weights file (see `WEIGHTS`) to RLlib's files of a checkpoint.

    Attributes:
        flown_space: The action space of the task, if it differs from the module's; otherwise None.
    """

    flown_space: Any = None

    def save_to_path(
        self,
        path: str | Path | None = None,
        *,
        state: Mapping[str, Any] | None = None,
        filesystem: Any = None,
        use_msgpack: bool = False,
    ) -> str:
        """Save the module into a folder, as RLlib does, and its weights file too."""
        if path is not None and filesystem is None:
            filesystem, path = FileSystem.from_uri(str(path))
        more = {"state": state, "filesystem": filesystem, "use_msgpack": use_msgpack}
        saved: str = super().save_to_path(path, **more)
        if not self.inference_only:  # a runner's copy has no value function and is not saved
            content = pack(self, state or self.get_state())
            with (filesystem or LocalFileSystem()).open_output_stream(f"{saved}/{WEIGHTS}") as file:
                file.write(content)
        return saved


def load_arrays(module: Any, arrays: Mapping[str, AnyArray], title: str) -> None:
    """Load the arrays of a weights file into a module.

    Raises:
        CheckpointError: The arrays do not match the nets of the module.
    """
    try:
        module.load_state_dict({name: torch.as_tensor(value) for name, value in arrays.items()})
    except (RuntimeError, ValueError) as error:
        reason = str(error).strip().splitlines()[-1].strip()
        raise CheckpointError(f"{title}: its weights do not match this policy ({reason})") from None


#: Key of RLlib's `model_config` that only SAC policies have: whether there are two Q-functions.
TWIN_Q = "twin_q"


class SacPolicy(SavedPolicy, DefaultSACTorchRLModule):  # type: ignore[misc]
    """RLlib's policy for SAC."""


class AppoPolicy(SavedPolicy, DefaultAPPOTorchRLModule):  # type: ignore[misc]
    """RLlib's policy for APPO."""


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
