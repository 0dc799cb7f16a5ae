"""Supervised steps on a policy's module: its actions those of a teacher, its values the returns."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import torch
from ray.rllib.core.columns import Columns

from safe_inspect.experiments.imitation.demonstrations import Act, Steps
from safe_inspect.experiments.sampling.distributions import distribution_of_module
from safe_inspect.experiments.settings.imitation import Imitation
from safe_inspect.random.action_draws import Gaussian
from safe_inspect.types import AnyArray


def sampling(module: Any, generator: torch.Generator) -> Act:
    """Return a function that draws actions from a module's distribution of exploration.

    Args:
        module: RLlib's module of a policy.
        generator: Seeds the draws, one number for each call.
    """
    kind = module.get_exploration_action_dist_cls()

    def act(observations: AnyArray) -> AnyArray:
        with torch.no_grad(), torch.random.fork_rng(devices=[]):
            torch.manual_seed(int(torch.randint(2**62, (), generator=generator)))
            inputs = module.forward_exploration({Columns.OBS: torch.from_numpy(observations)})
            return np.asarray(kind.from_logits(inputs[Columns.ACTION_DIST_INPUTS]).sample().numpy(), dtype=np.float64)

    return act


def clone(module: Any, steps: Steps, settings: Imitation, generator: torch.Generator) -> float:
    """Make the logarithm of the probability of the teacher's actions as large as possible.

    The standard deviations of a Gaussian policy are not asked to fit: they would shrink to nothing where a teacher
    coasts.

    Args:
        module: RLlib's module of the policy, which learns in place.
        steps: What the teacher would have done.
        settings: Epochs, minibatches and learning rate.
        generator: Orders the steps.

    Returns:
        The mean of minus the logarithm of the probability over the last epoch [-].
    """
    kind = module.get_train_action_dist_cls()

    def loss(rows: torch.Tensor) -> torch.Tensor:
        inputs = module.forward_train({Columns.OBS: observations[rows]})[Columns.ACTION_DIST_INPUTS]
        if isinstance(distribution_of_module(module), Gaussian):
            mean, deviation = inputs.chunk(2, dim=-1)
            inputs = torch.cat((mean, deviation.detach()), dim=-1)
        log_probability: torch.Tensor = kind.from_logits(inputs).logp(actions[rows])
        return -log_probability.mean()

    observations, actions = torch.from_numpy(steps.observations), torch.from_numpy(steps.actions)
    return _descend(loss, len(observations), list(module.parameters()), settings, generator)


def fit_values(module: Any, steps: Steps, settings: Imitation, generator: torch.Generator) -> float:
    """Make the values those of the returns in the mean square; parameters that the actions depend on stay.

    Args:
        module: RLlib's module of the policy, which learns in place.
        steps: Steps of the policy itself.
        settings: Epochs, minibatches and learning rate.
        generator: Orders the steps.

    Returns:
        The root of the mean squared error over the last epoch [-].
    """
    observations, returns = torch.from_numpy(steps.observations), torch.from_numpy(steps.returns)

    def loss(rows: torch.Tensor) -> torch.Tensor:
        values: torch.Tensor = module.compute_values({Columns.OBS: observations[rows]})
        return torch.nn.functional.mse_loss(values, returns[rows])

    inputs = module.forward_train({Columns.OBS: observations[:1]})[Columns.ACTION_DIST_INPUTS]
    parameters = list(module.parameters())
    shared = torch.autograd.grad(inputs.sum(), parameters, allow_unused=True)
    own = [parameter for parameter, used in zip(parameters, shared, strict=True) if used is None]
    return math.sqrt(_descend(loss, len(observations), own, settings, generator))


def _descend(
    loss: Callable[[torch.Tensor], torch.Tensor],
    count: int,
    parameters: Sequence[torch.nn.Parameter],
    settings: Imitation,
    generator: torch.Generator,
) -> float:
    """Take Adam's steps along all minibatches of all epochs; return the mean loss of the last epoch."""
    optimiser = torch.optim.Adam(parameters, lr=settings.lr)
    losses: list[float] = []
    for _ in range(settings.epochs):
        losses = []
        for rows in _minibatches(count, settings.minibatch_size, generator):
            optimiser.zero_grad()
            found = loss(rows)
            found.backward()  # type: ignore[no-untyped-call]
            optimiser.step()
            losses.append(float(found.detach()))
    return float(np.mean(losses))


def _minibatches(count: int, size: int, generator: torch.Generator) -> Iterator[torch.Tensor]:
    order: Any = torch.randperm(count, generator=generator)
    yield from order.split(size)
