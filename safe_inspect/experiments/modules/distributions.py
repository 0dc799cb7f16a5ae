"""The action distributions that the batched runner and the fast learner support, and the hurdle distribution for RLlib.

Importing this module loads Ray and Torch.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box, MultiDiscrete
from ray.rllib.algorithms.ppo.ppo_catalog import PPOCatalog
from ray.rllib.core.distribution.torch.torch_distribution import (
    TorchDiagGaussian,
    TorchDistribution,
    TorchMultiCategorical,
    TorchSquashedGaussian,
)

from safe_inspect.experiments.modules.saved_policy import DqnPolicy
from safe_inspect.random.action_draws import Categorical, Distribution, Gaussian, Greedy, Hurdle, SquashedGaussian


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


#: Keys of `model_config`: whether continuous thrust has a hurdle distribution, and its number of durations.
HURDLE, COASTS = "hurdle", "coasts"


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
    """`safe_inspect.random.action_draws.Hurdle` in Torch.

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
