"""`SavedPolicy`: an RLlib module that also saves its weights without pickle, and the policies of SAC, APPO and DQN.

Also the action distributions that the batched runner and the fast learner support, and the hurdle distribution for
RLlib. Importing this module loads Ray and Torch.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box, MultiDiscrete
from pyarrow.fs import FileSystem, LocalFileSystem  # type: ignore[import-untyped]
from ray.rllib.algorithms.appo.torch.default_appo_torch_rl_module import DefaultAPPOTorchRLModule
from ray.rllib.algorithms.dqn.default_dqn_rl_module import QF_PREDS
from ray.rllib.algorithms.dqn.torch.default_dqn_torch_rl_module import DefaultDQNTorchRLModule
from ray.rllib.algorithms.ppo.ppo_catalog import PPOCatalog
from ray.rllib.algorithms.sac.torch.default_sac_torch_rl_module import DefaultSACTorchRLModule
from ray.rllib.core.columns import Columns
from ray.rllib.core.distribution.torch.torch_distribution import (
    TorchDiagGaussian,
    TorchDistribution,
    TorchMultiCategorical,
    TorchSquashedGaussian,
)
from ray.rllib.core.rl_module.rl_module import RLModule

from safe_inspect.environments.facades.spaces import flat_space
from safe_inspect.errors import CheckpointError, ConfigError, Problem
from safe_inspect.experiments.modules.checkpoints import CHOICES, WEIGHTS, pack
from safe_inspect.random.action_draws import Categorical, Distribution, Gaussian, Greedy, Hurdle, SquashedGaussian
from safe_inspect.types import AnyArray

#: Keys of `model_config` that only DQN policies have.
DQN_MODEL_KEYS = frozenset({CHOICES, "double_q", "dueling", "epsilon", "num_atoms", "std_init", "v_max", "v_min"})
_MOST = 4096
#: Keys of `model_config`: whether continuous thrust has a hurdle distribution, and its number of durations.
HURDLE, COASTS = "hurdle", "coasts"


class SavedPolicy(RLModule):  # type: ignore[misc]
    """Base class of the package's policies, which adds a weights file (see `WEIGHTS`) to RLlib's files of a checkpoint.

    Attributes:
        flown_space: The action space of the task, if it differs from the module's; otherwise None.
    """

    flown_space: Any = None

    def save_to_path(self, path: Any = None, *, state: Any = None, filesystem: Any = None, **options: Any) -> str:
        """Save the module into a folder, as RLlib does, and its weights file too."""
        if path is not None and filesystem is None:
            filesystem, path = FileSystem.from_uri(str(path))
        saved: str = super().save_to_path(path, state=state, filesystem=filesystem, **options)
        if not self.inference_only:  # a runner's copy has no value function and is not saved
            content = pack(self, state or self.get_state())
            with (filesystem or LocalFileSystem()).open_output_stream(f"{saved}/{WEIGHTS}") as file:
                file.write(content)
        return saved

    def load_arrays(self, arrays: Mapping[str, AnyArray], title: str) -> None:
        """Load the arrays of a weights file.

        Raises:
            CheckpointError: The arrays do not match the nets.
        """
        module: Any = self  # RLlib's base class does not declare Torch's methods
        try:
            module.load_state_dict({name: torch.as_tensor(value) for name, value in arrays.items()})
        except (RuntimeError, ValueError) as error:
            reason = str(error).strip().splitlines()[-1].strip()
            raise CheckpointError(f"{title}: its weights do not match this policy ({reason})") from None


class SacPolicy(SavedPolicy, DefaultSACTorchRLModule):  # type: ignore[misc]
    """RLlib's policy for SAC."""


class AppoPolicy(SavedPolicy, DefaultAPPOTorchRLModule):  # type: ignore[misc]
    """RLlib's policy for APPO."""


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


def distribution_of_module(module: Any) -> Distribution | None:
    """Return the distribution of RLlib's module in sampling and in training; None if it is not supported."""
    if isinstance(module, DqnPolicy):
        return Greedy(module.choices)
    try:
        kinds = {module.get_exploration_action_dist_cls(), module.get_train_action_dist_cls()}
    except (AttributeError, NotImplementedError):
        return None
    space = module.action_space
    for kind in kinds:
        if issubclass(kind, TorchHurdle):
            return Hurdle(kind.numbers, kind.choices)
    if isinstance(space, Box) and kinds == {TorchDiagGaussian}:
        return Gaussian(int(np.prod(space.shape)))
    if isinstance(space, Box) and kinds == {TorchSquashedGaussian}:
        return SquashedGaussian(int(np.prod(space.shape)))
    # RLlib derives a separate class for each number of choices.
    if isinstance(space, MultiDiscrete) and all(kind.__bases__ == (TorchMultiCategorical,) for kind in kinds):
        return Categorical(tuple(int(count) for count in space.nvec))
    return None


class HurdleCatalog(PPOCatalog):  # type: ignore[misc]
    """RLlib's catalog of PPO's nets, extended by the hurdle distribution."""

    def get_action_dist_cls(self, framework: str) -> Any:
        """Return the class of the action distribution."""
        config, space = self._model_config_dict, self.action_space
        if not (config.get(HURDLE) and isinstance(space, Box)):
            return super().get_action_dist_cls(framework)
        choices = int(config.get(COASTS, 0))
        return type("Hurdle", (TorchHurdle,), {"numbers": space.shape[0] - bool(choices), "choices": choices})


class TorchHurdle(TorchDistribution):  # type: ignore[misc]
    """`safe_inspect.random.hurdle_draws.Hurdle` in Torch.

    Class attributes:
        numbers: Number of real elements of the action, A.
        choices: Number of values of the last element, K; 0 if there is no such element.
    """

    numbers: int
    choices: int

    @classmethod
    def required_input_dim(cls, space: Any, **kwargs: Any) -> int:
        """Return the number of inputs, 1 + 2 A + K."""
        return 1 + 2 * cls.numbers + cls.choices

    def _get_torch_distribution(self, logits: torch.Tensor) -> Any:
        sizes = [1, self.numbers, self.numbers, self.choices]
        burn, mean, log_std, choice = torch.split(logits, sizes, dim=-1)  # type: ignore[no-untyped-call]
        kinds: Any = torch.distributions
        self._burns = kinds.Bernoulli(logits=burn[..., 0], validate_args=False)
        self._choice = kinds.Categorical(logits=choice, validate_args=False) if self.choices else None
        return kinds.Normal(mean, log_std.exp(), validate_args=False)

    def logp(self, value: Any, **kwargs: Any) -> Any:
        """Return the logarithms of the probability densities of actions, shape (R,)."""
        numbers = value[..., : self.numbers]
        burns = (numbers != 0.0).any(dim=-1).to(numbers.dtype)
        found = self._burns.log_prob(burns) + burns * self._dist.log_prob(numbers).sum(dim=-1)
        return found if self._choice is None else found + self._choice.log_prob(value[..., -1])

    def entropy(self, **kwargs: Any) -> Any:
        """Return the entropies, shape (R,); that of the numbers is weighted with the probability of a burn."""
        found = self._burns.entropy() + self._burns.probs * self._dist.entropy().sum(dim=-1)
        return found if self._choice is None else found + self._choice.entropy()

    def kl(self, other: Any, **kwargs: Any) -> Any:
        """Return the Kullback-Leibler divergences of another hurdle distribution from this one, shape (R,)."""
        divergence = torch.distributions.kl_divergence
        numbers = divergence(self._dist, other._dist).sum(dim=-1)
        found = divergence(self._burns, other._burns) + self._burns.probs * numbers
        return found if self._choice is None else found + divergence(self._choice, other._choice)

    def sample(self, *, sample_shape: Any = None, **kwargs: Any) -> Any:
        """Sample actions."""
        shape = torch.Size() if sample_shape is None else sample_shape
        numbers = self._dist.sample(shape) * self._burns.sample(shape)[..., None]
        if self._choice is None:
            return numbers
        return torch.cat((numbers, self._choice.sample(shape)[..., None].to(numbers.dtype)), dim=-1)

    def rsample(self, **kwargs: Any) -> torch.Tensor:
        """Raise NotImplementedError, because a sampled choice has no gradient."""
        raise NotImplementedError("a hurdle distribution samples a choice, which has no gradient")

    def to_deterministic(self) -> Any:
        """Raise NotImplementedError, because RLlib does not evaluate hurdle policies."""
        raise NotImplementedError("a hurdle policy is evaluated by this package's own code")
