"""`NetTraining`: training of one net with all minibatches of a batch."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from ray.rllib.algorithms.ppo.ppo import (
    LEARNER_RESULTS_KL_KEY,
    LEARNER_RESULTS_VF_EXPLAINED_VAR_KEY,
    LEARNER_RESULTS_VF_LOSS_UNCLIPPED_KEY,
)
from ray.rllib.core.learner.learner import ENTROPY_KEY, POLICY_LOSS_KEY, VF_LOSS_KEY

from safe_inspect.experiments.learning import ppo_kernels as kernels
from safe_inspect.experiments.learning.ppo_batch import Batch
from safe_inspect.experiments.learning.ppo_nets import Net
from safe_inspect.random.action_draws import Categorical, Hurdle
from safe_inspect.types import AnyArray, IntArray

#: Name of a net's part of the total loss.
TOTAL = "total_loss"


class NetTraining:
    """Training of one net with the minibatches of a batch; several trainings may run in parallel.

    The net runs on the device of its parameters; the loss, a few numbers for each row, is computed on the CPU.

    Args:
        net: The net.
        optimiser: Any of its parameters.
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
        optimiser: Any,
        batch: Batch,
        order: IntArray,
        terms: kernels.Terms,
        clip_gradients: Callable[[dict[Any, torch.Tensor]], Any] | None = None,
        distribution: Any = None,
    ) -> None:
        self._net, self._optimiser, self._batch, self._order, self._terms = net, optimiser, batch, order, terms
        self._clip_gradients = clip_gradients
        self._form = _form_of(distribution)
        self._sampled = kernels.Sampled(batch.actions, batch.inputs, batch.log_probabilities, batch.advantages)
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
            pushes: list[torch.Tensor | None] = [None, None]
            if inputs is not None:
                net, out = inputs.cpu().numpy(), self._gradient.numpy()
                kernels.policy_gradient(rows, net, self._form, self._sampled, self._terms, out, self._sums)
                pushes[0] = self._gradient.to(device)
            if values is not None:
                net, out = values.cpu().numpy(), self._value_gradient.numpy()
                kernels.value_gradient(rows, net, self._batch.targets, self._terms, out, self._value_sums)
                pushes[1] = self._value_gradient.to(device)
            gradients = way.backward((pushes[0], pushes[1]))
            if self._clip_gradients is not None:
                found: dict[Any, torch.Tensor] = dict(zip(parameters, gradients, strict=True))
                self.norm = self._clip_gradients(found)
                gradients = [found[parameter] for parameter in parameters]
            self._optimiser.step(gradients)
        for parameter, gradient in zip(parameters, gradients, strict=True):
            parameter.grad = gradient  # RLlib reads the gradients from here
        self.losses = self._losses(inputs is not None, None if values is None else values.cpu().numpy())

    def _losses(self, policy: bool, values: AnyArray | None) -> dict[str, float]:
        terms, count = self._terms, self._order.shape[1]
        found = {TOTAL: 0.0}
        if policy:
            surrogate, entropy, divergence = (self._sums / count).tolist()
            found[TOTAL] += -surrogate - terms.entropy * entropy + terms.divergence * divergence
            found[POLICY_LOSS_KEY] = -surrogate
            found[ENTROPY_KEY] = entropy
            found[LEARNER_RESULTS_KL_KEY] = divergence if terms.measured else 0.0
        if values is not None:
            targets = self._batch.targets[self._order[-1]]
            clipped, unclipped = (self._value_sums / count).tolist()
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


def _form_of(distribution: Any) -> kernels.Form:
    """Return the form of a distribution, Gaussian if it is None."""
    if isinstance(distribution, Categorical):
        return kernels.Form(0, distribution.sizes)
    hurdle = isinstance(distribution, Hurdle)
    sizes = [distribution.choices] if hurdle and distribution.choices else []
    return kernels.Form(int(hurdle), np.array(sizes, dtype=np.int64))


def _explained(targets: AnyArray, values: AnyArray) -> float:
    """Return the fraction of the targets' variance that the values explain, at least -1."""
    variance = float(np.var(targets, dtype=np.float64))
    rest = float(np.var(np.subtract(targets, values, dtype=np.float64)))
    return max(-1.0, 1.0 - rest / variance) if variance > 0.0 else -1.0
