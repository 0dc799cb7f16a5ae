"""`TanhNet` and `PolicyNet`: the nets of policies as plain functions of a batch of observations.

For nets as small as those of policies, a third of the time is autograd's overhead around the matrix products, and
Torch's tanh takes longer than half a layer's product. Without these passes and `FastAdam`, a whole training at the
shipped settings (nets of 256 and 256 units, minibatches of 500) takes 1.3 to 1.4 times as long, see
`benchmarks/learner_ablation.py`. All other nets, including those on GPUs, use autograd and Torch's fused Adam.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from ray.rllib.algorithms.ppo.torch.default_ppo_torch_rl_module import DefaultPPOTorchRLModule
from ray.rllib.core.columns import Columns
from ray.rllib.core.models.torch.encoder import TorchActorCriticEncoder, TorchMLPEncoder
from ray.rllib.core.models.torch.heads import TorchFreeLogStdMLPHead, TorchMLPHead

from safe_inspect.compiling import njit
from safe_inspect.experiments.modules.saved_policy import distribution_of_module
from safe_inspect.types import AnyArray

#: For inputs from this value on, tanh rounds to 1.
_LIMIT = np.float32(9.02)

# tanh(x) = x P(x^2) / Q(x^2) within the limit. The coefficients were fitted by least squares, which were reweighted
# until the largest relative error (2.1e-8 in exact arithmetic) no longer decreased.
_P0, _P1, _P2, _P3, _P4 = map(
    np.float32,
    (0.9999999790710492, 0.13379718625014736, 0.0034940352998007167, 2.058349174824071e-05, 1.3319083850922023e-08),
)
_Q0, _Q1, _Q2, _Q3, _Q4 = map(
    np.float32, (1.0, 0.46713033880548854, 0.025871076175641643, 0.00032830939689300917, 7.762024863258839e-07)
)

# The compiler may fuse products into sums and vectorise the loop; a division by zero cannot happen.
_vectorised = njit(cache=True, nogil=True, fastmath={"contract", "nsz"}, error_model="numpy")

#: Methods of the module that are involved in sampling an action, and in computing the losses.
SAMPLING = ("_forward", "_forward_exploration", "_forward_inference", "forward_exploration", "forward_inference")
TRAINING = ("forward_train", "_forward_train", "compute_values")
#: Least number of rows of a batch. With fewer rows, the last bit of matrix products depends on the number of rows.
LEAST_ROWS = 16
_VECTOR = 16  # largest number of float32 values in a vector register


@_vectorised  # type: ignore[untyped-decorator]
def tanh_in_place(x: AnyArray) -> None:
    """Replace x, float32, shape (n,), by tanh(x), with an error of at most 4e-7.

    The function has only one array, because the compiler would not vectorise a loop over two that may overlap.
    """
    for i in range(x.shape[0]):
        v = min(max(x[i], -_LIMIT), _LIMIT)
        s = v * v
        p = (((_P4 * s + _P3) * s + _P2) * s + _P1) * s + _P0
        q = (((_Q4 * s + _Q3) * s + _Q2) * s + _Q1) * s + _Q0
        x[i] = v * p / q


@_vectorised  # type: ignore[untyped-decorator]
def tanh_gradient(y: AnyArray, gradient: AnyArray, sums: AnyArray) -> None:
    """Replace the gradient with respect to the outputs of a tanh by that with respect to its inputs, and sum it.

    Args:
        y: Outputs of the tanh, float32, shape (B, H).
        gradient: Gradient, changed in place, float32, shape (B, H).
        sums: Receives the sums over the rows, which are the gradient of a bias, shape (H,).
    """
    sums[:] = np.float32(0.0)
    for i in range(y.shape[0]):
        for j in range(y.shape[1]):
            found = gradient[i, j] * (np.float32(1.0) - y[i, j] * y[i, j])
            gradient[i, j] = found
            sums[j] += found


def linear_layers(body: Iterable[torch.nn.Module], head: Iterable[torch.nn.Module]) -> list[torch.nn.Linear] | None:
    """Return the linear layers of a net that `TanhNet` supports; None for any other net.

    It supports float32 layers with biases on the CPU, where each layer but the last is followed by a tanh.

    Args:
        body: Alternating linear layers and activations.
        head: The remaining layers, which end with a linear layer.
    """
    modules = [*body, *head]
    layers, activations = modules[::2], modules[1::2]
    found = [layer for layer in layers if isinstance(layer, torch.nn.Linear)]
    if len(found) != len(activations) + 1 or any(type(module) is not torch.nn.Tanh for module in activations):
        return None
    parameters = [parameter for layer in found for parameter in (layer.weight, layer.bias)]
    if any(p is None or p.dtype != torch.float32 or p.device.type != "cpu" for p in parameters):
        return None
    return found


class TanhNet:
    """A net for batches with a fixed number of rows; it shares the parameters of the layers, which may change in place.

    Args:
        layers: The linear layers; the input of each is the tanh of the output of the previous one.
        rows: Number of rows of a batch, B.
        limit: Largest magnitude of the second half of the outputs, the logarithms of standard deviations; None for no
            limit.
    """

    def __init__(self, layers: Sequence[torch.nn.Linear], rows: int, limit: float | None) -> None:
        self._layers = [(layer.weight.detach(), layer.bias.detach()) for layer in layers]
        self._outputs = [torch.empty((rows, len(bias))) for _, bias in self._layers]
        self._hidden: list[AnyArray] = [output.numpy() for output in self._outputs[:-1]]
        # The views for a forward pass, in order; creating them would take a tenth of the time of the pass.
        self._steps = [
            (bias, weight.t(), output, output.numpy().reshape(-1))
            for (weight, bias), output in zip(self._layers, self._outputs, strict=True)
        ]
        self._limit = limit
        self._logarithms = self._outputs[-1][:, len(self._layers[-1][1]) // 2 :]
        self._input = torch.empty(0)
        self._gradients: list[torch.Tensor] = []
        self._slopes: list[tuple[torch.Tensor, torch.Tensor]] = []
        self._turned: list[torch.Tensor] = []

    def forward(self, batch: torch.Tensor) -> torch.Tensor:
        """Return the outputs, shape (B, I), in an array that the next call overwrites.

        Args:
            batch: The inputs, shape (B, O); they must not change before `backward`.
        """
        self._input = batch
        *hidden, (bias, weight, last, _) = self._steps
        for shift, factor, output, numbers in hidden:
            torch.addmm(shift, batch, factor, out=output)
            tanh_in_place(numbers)
            batch = output
        torch.addmm(bias, batch, weight, out=last)
        if self._limit is not None:
            self._logarithms.clamp_(-self._limit, self._limit)
        return last

    def backward(self, gradient: torch.Tensor) -> list[torch.Tensor]:
        """Return the gradients of the parameters, in arrays that the next call overwrites.

        Args:
            gradient: Gradient of the loss with respect to the outputs of the last `forward`, shape (B, I); it is
                changed in place.

        Returns:
            The gradients of the weight and the bias of each layer, in order.
        """
        if not self._slopes:
            self._slopes = [(torch.empty_like(weight), torch.empty_like(bias)) for weight, bias in self._layers]
            self._turned = [torch.empty_like(weight.t().contiguous()) for weight, _ in self._layers]
            self._gradients = [torch.empty_like(output) for output in self._outputs[:-1]]
        if self._limit is not None:
            gradient[:, gradient.shape[1] // 2 :].mul_(self._logarithms.abs() < self._limit)
        torch.sum(gradient, 0, out=self._slopes[-1][1])
        inputs = [self._input, *self._outputs[:-1]]
        for place in range(len(self._layers) - 1, -1, -1):
            self._weigh(place, gradient, inputs[place])
            if place:
                before = self._gradients[place - 1]
                torch.mm(gradient, self._layers[place][0], out=before)
                tanh_gradient(self._hidden[place - 1], before.numpy(), self._slopes[place - 1][1].numpy())
                gradient = before
        return [slope for pair in self._slopes for slope in pair]

    def _weigh(self, place: int, gradient: torch.Tensor, batch: torch.Tensor) -> None:
        """Compute the gradient of a layer's weight from the gradient of its outputs and from its inputs."""
        slope, turned = self._slopes[place][0], self._turned[place]
        if batch.shape[1] < gradient.shape[1]:  # the transposed product is up to four times as fast
            torch.mm(batch.t(), gradient, out=turned)
            slope.copy_(turned.t())
        else:
            torch.mm(gradient.t(), batch, out=slope)


@dataclass(frozen=True, eq=False)
class PlainLayers:
    """A net whose outputs are ``head(body(observations))``.

    Attributes:
        body: The layers of the encoder.
        head: RLlib's head.
    """

    body: torch.nn.Sequential
    head: Any

    @classmethod
    def of(cls, module: Any, methods: tuple[str, ...], *, values: bool = False) -> PlainLayers | None:
        """Return the layers of a module's policy or value function; None if its outputs are not those of plain layers.

        Args:
            module: RLlib's module.
            methods: The methods that the layers replace, `SAMPLING` or `TRAINING`.
            values: Whether to return the layers of the value function, None if it has no separate encoder.
        """
        ours, own = DefaultPPOTorchRLModule, type(module)
        if not isinstance(module, ours) or any(getattr(own, name) is not getattr(ours, name) for name in methods):
            return None
        encoder: Any = module.encoder
        usual = type(encoder) is TorchActorCriticEncoder
        if not usual or (values and encoder.config.shared):
            return None
        separate, head = ("critic_encoder", module.vf) if values else ("actor_encoder", module.pi)
        part = encoder.encoder if encoder.config.shared else getattr(encoder, separate)
        known = type(part) is TorchMLPEncoder and type(head) in (TorchMLPHead, TorchFreeLogStdMLPHead)
        return cls(part.net.mlp, head) if known else None

    def __call__(self, observations: torch.Tensor) -> torch.Tensor:
        """Return the outputs, shape (R, I), for observations, shape (R, O)."""
        outputs: torch.Tensor = self.head(self.body(observations))
        return outputs

    @property
    def limit(self) -> float | None:
        """Largest magnitude of the logarithms of standard deviations; None for no limit."""
        return float(self.head.log_std_clip_param) if self.head.clip_log_std else None

    @property
    def whole(self) -> bool:
        """Whether the layers of the head give all outputs; otherwise it also has logarithms of standard deviations."""
        return type(self.head) is TorchMLPHead


class PolicyNet:
    """Function from the observations of one step to the inputs of a policy's action distribution.

    The rows are padded to `LEAST_ROWS`, so that the result of a row does not depend on the number of other rows.

    Args:
        module: RLlib's module of the policy; its weights may change in place.
        rows: Number of rows of a batch.
        device: Device of the module.
    """

    def __init__(self, module: Any, rows: int, device: Any = "cpu") -> None:
        self._module = module
        self._device = torch.device(device)
        self._rows = rows
        size = int(np.prod(module.observation_space.shape))
        batch = torch.zeros((max(rows, LEAST_ROWS), size), dtype=torch.float32)
        self._batch = batch
        self._remote = None if self._device.type == "cpu" else batch.to(self._device)
        #: The observations of the next call, float32, shape (rows, O).
        self.observations: AnyArray = batch.numpy()[:rows]
        self._plain = self._plain_layers()
        #: The action distribution of the module, which is one of those that are supported.
        self.distribution: Any = distribution_of_module(module)

    def __call__(self, explore: bool) -> AnyArray:
        """Return the inputs of the action distributions, float32, shape (rows, I).

        Args:
            explore: Whether to call the module's forward pass for exploration instead of that for inference.
        """
        with torch.no_grad():
            batch = self._batch if self._remote is None else self._remote.copy_(self._batch)
            if self._plain is not None:
                found = self._plain(batch)
            else:
                ask = self._module.forward_exploration if explore else self._module.forward_inference
                found = ask({Columns.OBS: batch})[Columns.ACTION_DIST_INPUTS]
        return np.asarray(found[: self._rows].cpu().numpy())

    def _plain_layers(self) -> Callable[[torch.Tensor], torch.Tensor] | None:
        """Return the policy's layers as a function; None if its outputs are not those of plain layers.

        The learner's tanh needs widths that are multiples of the processor's vectors, so that the result of a row does
        not depend on its index.
        """
        found = PlainLayers.of(self._module, SAMPLING)
        if found is None or self._remote is not None:
            return found
        layers = linear_layers(found.body, found.head.net.mlp) if found.whole else None
        if layers is None or any(layer.out_features % _VECTOR for layer in layers[:-1]):
            return found
        return TanhNet(layers, len(self._batch), found.limit).forward
