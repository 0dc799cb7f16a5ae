"""`InitialPolicy`: the policy with which a training began, to which a term of the loss holds it for some time."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from typing import Any

import numpy as np
import torch

from safe_inspect.experiments.learning.ppo_nets import nets_of
from safe_inspect.experiments.modules.saved_policy import load_arrays
from safe_inspect.experiments.modules.starting_weights import starting_weights
from safe_inspect.types import AnyArray

_ROWS_AT_ONCE = 1024


class InitialPolicy:
    """A policy that does not learn; the loss has c KL(this policy || the one that learns), with a c that may fade.

    Source: Schmitt et al., Kickstarting Deep Reinforcement Learning, 2018; their cross entropy has the same gradient.

    Args:
        module: RLlib's module of the policy that learns.
        source: Where its initial weights come from, see `starting_weights`.
        coefficients: c, or pairs [control steps of the training, c] with straight lines between them.
    """

    def __init__(self, module: Any, source: str, coefficients: float | Sequence[Sequence[float]]) -> None:
        self._module = deepcopy(module)
        load_arrays(self._module, starting_weights(source, self._module.model_config), source)
        pairs = coefficients if isinstance(coefficients, Sequence) else [[0, coefficients]]
        self._times, self._values = (np.array(column, dtype=np.float64) for column in zip(*pairs, strict=True))

    def coefficient(self, steps: int) -> float:
        """Return c after a number of control steps."""
        return float(np.interp(steps, self._times, self._values))

    def inputs(self, observations: AnyArray) -> AnyArray:
        """Return the inputs of its action distribution, float32, shape (R, I), for observations of shape (R, O)."""
        found = []
        with torch.no_grad():
            net, *_ = nets_of(self._module)
            for part in torch.split(torch.from_numpy(observations).to(net.parameters[0].device), _ROWS_AT_ONCE):
                inputs, _ = net.make_pass(len(part)).forward(part)
                assert inputs is not None, "the first net gives them"
                found.append(inputs.cpu().numpy().copy())
        return np.concatenate(found)
