"""The nets of a policy's module, and their training: passes of a minibatch, the loss, steps of the optimiser."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from ray.rllib.algorithms.ppo.ppo import (
    LEARNER_RESULTS_KL_KEY,
    LEARNER_RESULTS_VF_EXPLAINED_VAR_KEY,
    LEARNER_RESULTS_VF_LOSS_UNCLIPPED_KEY,
)
from ray.rllib.core.columns import Columns
from ray.rllib.core.learner.learner import ENTROPY_KEY, POLICY_LOSS_KEY, VF_LOSS_KEY

from safe_inspect.compiling import njit
from safe_inspect.experiments.learning.ppo_kernels import Batch, Form, Sampled, Terms, policy_gradient, value_gradient
from safe_inspect.experiments.modules.tanh_net import TRAINING, PlainLayers, TanhNet, linear_layers
from safe_inspect.random.action_draws import Categorical, Hurdle
from safe_inspect.types import AnyArray, IntArray

#: Name of a net's part of the total loss.
_TOTAL = "total_loss"

Outputs = tuple[torch.Tensor, ...]


class AutogradPass:
    """Pass through any net, with Torch's autograd; `TanhNet` is such a pass too, and takes less time.

    Args:
        net: The net as a function from observations to its outputs, each of shape (B, number of columns).
        parameters: The parameters of the net that learn.
    """

    def __init__(self, net: Callable[[torch.Tensor], Outputs], parameters: Sequence[torch.nn.Parameter]) -> None:
        self._net, self._parameters = net, parameters
        self._outputs: Outputs = ()

    def forward(self, batch: torch.Tensor) -> torch.Tensor:
        """Return the columns of all outputs for observations (B, O)."""
        self._outputs = self._net(batch)
        return torch.cat([output.detach() for output in self._outputs], dim=1)

    def backward(self, gradient: torch.Tensor) -> list[torch.Tensor]:
        """Return the gradients of the parameters, given that with respect to the columns of the last `forward`."""
        widths = [output.shape[1] for output in self._outputs]
        pushes = [part.contiguous() for part in torch.split(gradient, widths, dim=1)]  # type: ignore[no-untyped-call]
        found = torch.autograd.grad(self._outputs, self._parameters, pushes, allow_unused=True)
        return [
            torch.zeros_like(parameter) if gradient is None else gradient
            for parameter, gradient in zip(self._parameters, found, strict=True)
        ]


@dataclass(frozen=True)
class Net:
    """A part of a module that shares no parameters with other parts, and so can learn separately.

    Its outputs are the inputs of the action distribution (I columns) if it acts, and then the value (one column) if it
    values.

    Attributes:
        make_pass: Function from the number of rows of a minibatch to a pass through the net.
        parameters: Its parameters that learn.
        acts: Whether it computes the inputs of the action distribution.
        values: Whether it computes the value.
        why_autograd: Why Torch's autograd computes its gradients; empty if `TanhNet` does, which takes less time.
    """

    make_pass: Callable[[int], AutogradPass | TanhNet]
    parameters: Sequence[torch.nn.Parameter]
    acts: bool = True
    values: bool = True
    why_autograd: str = ""


def nets_of(module: Any, together: bool = False) -> list[Net]:
    """Return a module's nets: policy and value function if they are separate, otherwise one net that computes both.

    Args:
        module: RLlib's module of the policy.
        together: Whether to return one net in any case.
    """
    whole = _whole(module)
    if together:
        return [replace(whole, why_autograd="the gradients of policy and value function are clipped together")]
    policy, value = (PlainLayers.of(module, TRAINING, values=values) for values in (False, True))
    if policy is None or value is None:
        return [replace(whole, why_autograd="its module is not RLlib's own with an encoder for each net")]
    parts = [_part(policy, False), _part(value, True)]
    known = [id(parameter) for part in parts for parameter in part.parameters]
    if len(set(known)) < len(known) or set(known) != {id(parameter) for parameter in whole.parameters}:
        return [replace(whole, why_autograd="policy and value function share parameters")]
    return parts


def _whole(module: Any) -> Net:
    parameters = _learning(module)

    def forward(observations: torch.Tensor) -> Outputs:
        batch = {Columns.OBS: observations}
        outputs = module.forward_train(batch)
        values = module.compute_values(batch, embeddings=outputs.get(Columns.EMBEDDINGS))
        return outputs[Columns.ACTION_DIST_INPUTS], values.unsqueeze(-1)

    return Net(lambda rows: AutogradPass(forward, parameters), parameters)


def _part(found: PlainLayers, values: bool) -> Net:
    parameters = [*_learning(found.body), *_learning(found.head)]
    layers = linear_layers(found.body, found.head.net.mlp) if found.whole else None
    if layers is not None and len(parameters) == 2 * len(layers):
        return Net(lambda rows: TanhNet(layers, rows, found.limit), parameters, not values, values)
    why = "its layers are not linear with tanh between"
    return Net(lambda rows: AutogradPass(lambda seen: (found(seen),), parameters), parameters, not values, values, why)


def _learning(module: Any) -> list[torch.nn.Parameter]:
    return [parameter for parameter in module.parameters() if parameter.requires_grad]


class TorchAdam:
    """Torch's Adam with the settings and the state of another optimiser, for some of its parameters."""

    def __init__(self, optimiser: Any, parameters: Sequence[torch.nn.Parameter]) -> None:
        (group,) = optimiser.param_groups
        self._parameters = parameters
        self._adam = torch.optim.Adam(parameters, lr=group["lr"], betas=group["betas"], eps=group["eps"], fused=True)
        for parameter in parameters:
            state = optimiser.state[parameter]
            # A fused Adam needs its step counts on the device of the parameters.
            state["step"] = state["step"].to(parameter.device)
            self._adam.state[parameter] = state

    def step(self, gradients: Sequence[torch.Tensor]) -> None:
        """Take a step."""
        for parameter, gradient in zip(self._parameters, gradients, strict=True):
            parameter.grad = gradient
        self._adam.step()


def part_of(optimiser: Any, parameters: Sequence[torch.nn.Parameter]) -> FastAdam | TorchAdam:
    """Return an optimiser for some of the parameters of RLlib's Adam, whose settings and state it shares.

    RLlib has one optimiser for all parameters of a module, and checkpoints contain the state of that optimiser.
    """
    for parameter in parameters:
        state = optimiser.state[parameter]
        if not state:
            state["step"] = torch.zeros((), dtype=torch.float32, device=parameter.device)
            state["exp_avg"] = torch.zeros_like(parameter)
            state["exp_avg_sq"] = torch.zeros_like(parameter)
    on_cpu = all(p.dtype == torch.float32 and p.device.type == "cpu" for p in parameters)
    return FastAdam(optimiser, parameters) if on_cpu else TorchAdam(optimiser, parameters)


@njit(nogil=True, fastmath={"contract", "nsz"}, error_model="numpy")
def _adam_step(
    parameter: AnyArray,
    gradient: AnyArray,
    mean: AnyArray,
    square: AnyArray,
    forget: tuple[float, float],
    rate: float,
    scale: float,
    epsilon: float,
) -> None:
    """Take a step of Adam in place; all arrays are float32, shape (n,).

    Source: Kingma and Ba, Adam: A Method for Stochastic Optimization, 2015, algorithm 1.

    Args:
        parameter: theta, changed in place.
        gradient: g.
        mean: m, changed in place.
        square: v, changed in place.
        forget: 1 - beta_1 and 1 - beta_2.
        rate: Learning rate alpha / (1 - beta_1^t).
        scale: 1 / sqrt(1 - beta_2^t).
        epsilon: epsilon.
    """
    first, second = np.float32(forget[0]), np.float32(forget[1])
    alpha, spread, least = np.float32(rate), np.float32(scale), np.float32(epsilon)
    for i in range(parameter.shape[0]):
        g = gradient[i]
        m = mean[i] + first * (g - mean[i])
        v = square[i] + second * (g * g - square[i])
        mean[i] = m
        square[i] = v
        parameter[i] -= alpha * m / (np.sqrt(v) * spread + least)


class FastAdam:
    """Adam that shares the settings and the state of one of Torch's optimisers.

    Args:
        optimiser: RLlib's Adam, with one group.
        parameters: Some of its parameters, float32, on the CPU.
    """

    def __init__(self, optimiser: torch.optim.Adam, parameters: Sequence[torch.nn.Parameter]) -> None:
        (self._group,) = optimiser.param_groups
        states = [optimiser.state[parameter] for parameter in parameters]
        self._steps: list[torch.Tensor] = [state["step"] for state in states]
        self._arrays = [
            [part.detach().view(-1).numpy() for part in (parameter, state["exp_avg"], state["exp_avg_sq"])]
            for parameter, state in zip(parameters, states, strict=True)
        ]

    def step(self, gradients: Sequence[torch.Tensor]) -> None:
        """Take a step.

        Args:
            gradients: Gradients of the parameters, in their order.
        """
        one, two = (float(beta) for beta in self._group["betas"])
        rate, epsilon = float(self._group["lr"]), float(self._group["eps"])
        for step, (parameter, mean, square), gradient in zip(self._steps, self._arrays, gradients, strict=True):
            step += 1.0
            count = float(step)
            _adam_step(
                parameter,
                gradient.view(-1).numpy(),
                mean,
                square,
                (1.0 - one, 1.0 - two),
                rate / (1.0 - one**count),
                1.0 / math.sqrt(1.0 - two**count),
                epsilon,
            )


@dataclass(eq=False)
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

    net: Net
    optimiser: Any
    batch: Batch
    order: IntArray
    terms: Terms
    clip_gradients: Callable[[dict[Any, torch.Tensor]], Any] | None = None
    distribution: Any = None
    losses: dict[str, float] = field(default_factory=dict, init=False)
    norm: Any = field(default=None, init=False)

    def __post_init__(self) -> None:
        batch, size = self.batch, self.order.shape[1]
        self._form = _form_of(self.distribution)
        self._sampled = Sampled(batch.actions, batch.inputs, batch.log_probabilities, batch.advantages)
        self._sums, self._value_sums = np.zeros(3), np.zeros(2)
        self._inputs = batch.inputs.shape[1]
        self._gradient = torch.empty((size, self._inputs * self.net.acts + self.net.values))

    def run(self) -> None:
        """Take an optimiser step for each minibatch."""
        parameters = self.net.parameters
        device = parameters[0].device
        observations = torch.from_numpy(self.batch.observations).to(device)
        size = self.order.shape[1]
        way = self.net.make_pass(size)
        chosen = torch.empty((size, observations.shape[1]), device=device)
        gradients: list[torch.Tensor] = []
        outputs, out = np.empty(0), self._gradient.numpy()
        for rows, indices in zip(self.order, torch.from_numpy(self.order).to(device), strict=True):
            torch.index_select(observations, 0, indices, out=chosen)
            outputs = way.forward(chosen).cpu().numpy()
            if self.net.acts:
                inputs, push = outputs[:, : self._inputs], out[:, : self._inputs]
                policy_gradient(rows, inputs, self._form, self._sampled, self.terms, push, self._sums)
            if self.net.values:
                values, push = outputs[:, -1], out[:, -1]
                value_gradient(rows, values, self.batch.targets, self.terms, push, self._value_sums)
            gradients = way.backward(self._gradient.to(device))
            if self.clip_gradients is not None:
                found: dict[Any, torch.Tensor] = dict(zip(parameters, gradients, strict=True))
                self.norm = self.clip_gradients(found)
                gradients = [found[parameter] for parameter in parameters]
            self.optimiser.step(gradients)
        for parameter, gradient in zip(parameters, gradients, strict=True):
            parameter.grad = gradient  # RLlib reads the gradients from here
        self.losses = self._losses(outputs)

    def _losses(self, outputs: AnyArray) -> dict[str, float]:
        terms, count = self.terms, self.order.shape[1]
        found = {_TOTAL: 0.0}
        if self.net.acts:
            surrogate, entropy, divergence = (self._sums / count).tolist()
            found[_TOTAL] += -surrogate - terms.entropy * entropy + terms.divergence * divergence
            found[POLICY_LOSS_KEY] = -surrogate
            found[ENTROPY_KEY] = entropy
            found[LEARNER_RESULTS_KL_KEY] = divergence if terms.measured else 0.0
        if self.net.values:
            clipped, unclipped = (self._value_sums / count).tolist()
            found[_TOTAL] += terms.value * clipped
            found[VF_LOSS_KEY] = clipped
            found[LEARNER_RESULTS_VF_LOSS_UNCLIPPED_KEY] = unclipped
            found[LEARNER_RESULTS_VF_EXPLAINED_VAR_KEY] = _explained(self.batch.targets[self.order[-1]], outputs[:, -1])
        return found


def joined(trainings: list[NetTraining]) -> Mapping[str, float]:
    """Return the losses of one policy, summed over its nets."""
    names = dict.fromkeys(name for training in trainings for name in training.losses)
    return {name: sum(training.losses.get(name, 0.0) for training in trainings) for name in names}


def _form_of(distribution: Any) -> Form:
    """Return the form of a distribution, Gaussian if it is None."""
    if isinstance(distribution, Categorical):
        return Form(0, distribution.sizes)
    hurdle = isinstance(distribution, Hurdle)
    sizes = [distribution.choices] if hurdle and distribution.choices else []
    return Form(int(hurdle), np.array(sizes, dtype=np.int64))


def _explained(targets: AnyArray, values: AnyArray) -> float:
    """Return the fraction of the targets' variance that the values explain, at least -1."""
    variance = float(np.var(targets, dtype=np.float64))
    rest = float(np.var(np.subtract(targets, values, dtype=np.float64)))
    return max(-1.0, 1.0 - rest / variance) if variance > 0.0 else -1.0
