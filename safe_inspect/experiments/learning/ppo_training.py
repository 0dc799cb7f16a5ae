"""`NetTraining`: training of one net with all minibatches of a batch."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from ray.rllib.algorithms.ppo.ppo import (
    LEARNER_RESULTS_KL_KEY,
    LEARNER_RESULTS_VF_EXPLAINED_VAR_KEY,
    LEARNER_RESULTS_VF_LOSS_UNCLIPPED_KEY,
)
from ray.rllib.core.learner.learner import ENTROPY_KEY, POLICY_LOSS_KEY, VF_LOSS_KEY

from safe_inspect.experiments.learning.hurdle_kernel import hurdle_gradient
from safe_inspect.experiments.learning.ppo_batch import Batch
from safe_inspect.experiments.learning.ppo_kernels import (
    CLIPPED,
    ENTROPY,
    KL,
    SURROGATE,
    UNCLIPPED,
    choice_gradient,
    policy_gradient,
    value_gradient,
)
from safe_inspect.experiments.learning.ppo_nets import Net, Optimiser
from safe_inspect.random.action_draws import Categorical
from safe_inspect.random.hurdle_draws import Hurdle
from safe_inspect.types import AnyArray, IntArray

#: Name of a net's part of the total loss.
TOTAL = "total_loss"


@dataclass(frozen=True)
class Terms:
    """The coefficients of a policy's loss, as in RLlib's configuration.

    Attributes:
        clip: `clip_param`.
        value_clip: `vf_clip_param`.
        value: `vf_loss_coeff`.
        entropy: Current value of `entropy_coeff`.
        divergence: Current coefficient of the divergence; 0 without `use_kl_loss`.
        measured: Whether the divergence is reported, `use_kl_loss`.
    """

    clip: float
    value_clip: float
    value: float
    entropy: float
    divergence: float
    measured: bool


class NetTraining:
    """Training of one net with the minibatches of a batch; several trainings may run in parallel.

    The net runs on the device of its parameters; the loss, a few numbers for each row, is computed on the CPU.

    Args:
        net: The net.
        optimiser: Optimiser of its parameters.
        batch: The batch, with advantages.
        order: The rows of each minibatch, shape (M, B).
        terms: The coefficients of the loss.
        clip_gradients: Function that clips gradients in place and may return their norm; None for no clipping.
        distribution: Distribution of the actions.

    Attributes:
        losses: After `run`, the losses of the last minibatch, by RLlib's names.
        norm: After `run`, the norm of the last gradients before clipping, if `clip_gradients` has returned it.
    """

    def __init__(
        self,
        net: Net,
        optimiser: Optimiser,
        batch: Batch,
        order: IntArray,
        terms: Terms,
        clip_gradients: Callable[[dict[Any, torch.Tensor]], Any] | None = None,
        distribution: Any = None,
    ) -> None:
        self._net, self._optimiser, self._batch, self._order, self._terms = net, optimiser, batch, order, terms
        self._clip_gradients = clip_gradients
        self._work, self._sizes = _work_for(distribution)
        size = order.shape[1]
        self._sums = np.zeros(3)
        self._value_sums = np.zeros(2)
        self._gradient = torch.empty((size, batch.inputs.shape[1]))
        self._value_gradient = torch.empty(size)
        self.losses: dict[str, float] = {}
        self.norm: Any = None

    def run(self) -> None:
        """Take an optimiser step for each minibatch."""
        parameters = self._net.parameters
        device = parameters[0].device
        observations = torch.from_numpy(self._batch.observations).to(device)
        size = self._order.shape[1]
        way = self._net.make_pass(size)
        chosen = torch.empty((size, observations.shape[1]), device=device)
        gradients: list[torch.Tensor] = []
        inputs: torch.Tensor | None = None
        values: torch.Tensor | None = None
        for rows, indices in zip(self._order, torch.from_numpy(self._order).to(device), strict=True):
            torch.index_select(observations, 0, indices, out=chosen)
            inputs, values = way.forward(chosen)
            gradients = way.backward(
                (
                    None if inputs is None else self._policy_gradient(rows, inputs.cpu().numpy()).to(device),
                    None if values is None else self._values_gradient(rows, values.cpu().numpy()).to(device),
                )
            )
            if self._clip_gradients is not None:
                found: dict[Any, torch.Tensor] = dict(zip(parameters, gradients, strict=True))
                self.norm = self._clip_gradients(found)
                gradients = [found[parameter] for parameter in parameters]
            self._optimiser.step(gradients)
        for parameter, gradient in zip(parameters, gradients, strict=True):
            parameter.grad = gradient  # RLlib reads the gradients from here
        self.losses = self._losses(inputs is not None, None if values is None else values.cpu().numpy())

    def _policy_gradient(self, rows: IntArray, inputs: AnyArray) -> torch.Tensor:
        batch, terms = self._batch, self._terms
        given = (rows, inputs, *self._sizes, batch.actions)
        old = (batch.inputs, batch.log_probabilities, batch.advantages)
        coefficients = (terms.clip, terms.entropy, terms.divergence)
        self._work(*given, *old, *coefficients, self._gradient.numpy(), self._sums)
        return self._gradient

    def _values_gradient(self, rows: IntArray, values: AnyArray) -> torch.Tensor:
        terms = self._terms
        value_gradient(
            rows,
            values,
            self._batch.targets,
            terms.value_clip,
            terms.value,
            self._value_gradient.numpy(),
            self._value_sums,
        )
        return self._value_gradient

    def _losses(self, policy: bool, values: AnyArray | None) -> dict[str, float]:
        terms, count = self._terms, self._order.shape[1]
        found = {TOTAL: 0.0}
        if policy:
            surrogate, entropy, divergence = (float(self._sums[place]) / count for place in (SURROGATE, ENTROPY, KL))
            found[TOTAL] += -surrogate - terms.entropy * entropy + terms.divergence * divergence
            found[POLICY_LOSS_KEY] = -surrogate
            found[ENTROPY_KEY] = entropy
            found[LEARNER_RESULTS_KL_KEY] = divergence if terms.measured else 0.0
        if values is not None:
            targets = self._batch.targets[self._order[-1]]
            clipped, unclipped = (float(self._value_sums[place]) / count for place in (CLIPPED, UNCLIPPED))
            found[TOTAL] += terms.value * clipped
            found[VF_LOSS_KEY] = clipped
            found[LEARNER_RESULTS_VF_LOSS_UNCLIPPED_KEY] = unclipped
            found[LEARNER_RESULTS_VF_EXPLAINED_VAR_KEY] = _explained(targets, values)
        return found


def joined(trainings: list[NetTraining]) -> Mapping[str, float]:
    """Return the losses of one policy, summed over its nets."""
    found: dict[str, float] = {}
    for training in trainings:
        for name, value in training.losses.items():
            found[name] = found.get(name, 0.0) + value
    return found


def _work_for(distribution: Any) -> tuple[Any, tuple[Any, ...]]:
    """Return the kernel of the policy's loss for a distribution, and its additional arguments after the inputs."""
    if isinstance(distribution, Categorical):
        return choice_gradient, (distribution.sizes,)
    if isinstance(distribution, Hurdle):
        return hurdle_gradient, ((distribution.numbers, distribution.choices),)
    return policy_gradient, ()


def _explained(targets: AnyArray, values: AnyArray) -> float:
    """Return the fraction of the targets' variance that the values explain, at least -1."""
    variance = float(np.var(targets, dtype=np.float64))
    rest = float(np.var(np.subtract(targets, values, dtype=np.float64)))
    return max(-1.0, 1.0 - rest / variance) if variance > 0.0 else -1.0
