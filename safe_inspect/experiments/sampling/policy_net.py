"""`PolicyNet`: RLlib's modules as plain functions of a batch of observations, for sampling."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from ray.rllib.core.columns import Columns

from safe_inspect.experiments.modules.distributions import distribution_of_module
from safe_inspect.experiments.modules.tanh_net import SAMPLING, TanhNet, linear_layers, policy_layers
from safe_inspect.types import AnyArray

#: Least number of rows of a batch. With fewer rows, the last bit of matrix products depends on the number of rows.
LEAST_ROWS = 16

_VECTOR = 16  # largest number of float32 values in a vector register


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
            found = self._ask(batch, explore) if self._plain is None else self._plain(batch)
        return np.asarray(found[: self._rows].cpu().numpy())

    def _ask(self, batch: torch.Tensor, explore: bool) -> torch.Tensor:
        ask = self._module.forward_exploration if explore else self._module.forward_inference
        found: torch.Tensor = ask({Columns.OBS: batch})[Columns.ACTION_DIST_INPUTS]
        return found

    def _plain_layers(self) -> Callable[[torch.Tensor], torch.Tensor] | None:
        """Return the policy's layers as a function; None if its outputs are not those of plain layers.

        The learner's tanh needs widths that are multiples of the processor's vectors, so that the result of a row does
        not depend on its index.
        """
        found = policy_layers(self._module, SAMPLING)
        if found is None or self._remote is not None:
            return found
        layers = linear_layers(found.body, found.head.net.mlp) if found.whole else None
        if layers is None or any(layer.out_features % _VECTOR for layer in layers[:-1]):
            return found
        return TanhNet(layers, len(self._batch), found.limit).forward
