"""RLlib's modules as plain functions of a batch of observations, for sampling."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from ray.rllib.core.columns import Columns

from safe_inspect.experiments.modules.distributions import distribution_of_module
from safe_inspect.experiments.modules.plain_layers import SAMPLING, PlainLayers, policy_layers
from safe_inspect.experiments.modules.tanh_net import TanhNet, linear_layers
from safe_inspect.types import AnyArray

#: The results of the matrix products of fewer rows depend on their number, in the last bit.
LEAST_ROWS = 16

_VECTOR = 16  # float32 numbers, at most


class PolicyNet:
    """The inputs of a policy's action distribution, for the observations of one step.

    The rows are padded to `LEAST_ROWS`, so that a row's result does not depend on how many stand beside it.

    Args:
        module: RLlib's module of the policy; its weights may change, in place.
        rows: Number of rows of a batch.
        device: Where the module computes.
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
        #: The action distribution that takes the outputs; None where it is not known.
        self.distribution = distribution_of_module(module)

    def __call__(self, explore: bool, step: int) -> AnyArray:
        """Return the inputs of the action distributions, float32, shape (rows, I).

        Args:
            explore: Whether the module is asked for actions that explore.
            step: Steps that the whole training has sampled, for modules that anneal their exploration.
        """
        with torch.no_grad():
            batch = self._batch if self._remote is None else self._remote.copy_(self._batch)
            found = self._ask(batch, explore, step) if self._plain is None else self._plain(batch)
        return np.asarray(found[: self._rows].cpu().numpy())

    def _ask(self, batch: torch.Tensor, explore: bool, step: int) -> torch.Tensor:
        asked = {Columns.OBS: batch}
        outputs = self._module.forward_exploration(asked, t=step) if explore else self._module.forward_inference(asked)
        found: torch.Tensor = outputs[Columns.ACTION_DIST_INPUTS]
        return found

    def _plain_layers(self) -> Callable[[torch.Tensor], torch.Tensor] | None:
        """Return the policy's layers without RLlib's dictionaries; None where its class does not declare them."""
        found = policy_layers(self._module, SAMPLING)
        if found is None:
            return None
        quick = _quick(found, len(self._batch)) if self._remote is None else None
        return quick or (lambda batch: found.head(found.body(batch)))


def _quick(found: PlainLayers, rows: int) -> Callable[[torch.Tensor], torch.Tensor] | None:
    """Return the policy's net with the tanh that the learner has; None when there is another activation.

    The widths must be whole vectors of the processor: then each number goes the same way, wherever its row stands.
    """
    head: Any = found.head
    layers = linear_layers(found.body, head.net.mlp) if found.whole else None
    if layers is None or any(layer.out_features % _VECTOR for layer in layers[:-1]):
        return None
    return TanhNet(layers, rows, float(head.log_std_clip_param) if head.clip_log_std else None).forward
