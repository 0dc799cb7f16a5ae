"""`Hurdle`: a distribution of zeros or Gaussian numbers, optionally with an additional categorical choice."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.random.action_draws import (
    HALF_LOG_2PI,
    NO_NOISE,
    Categorical,
    DrawRows,
    draw_choice,
    draw_in_rollout,
    normals_of,
    uniforms_of,
)
from safe_inspect.types import AnyArray, FloatArray


class Hurdle:
    """A hurdle distribution over A real numbers, optionally with a categorical one over K indices.

    With the probability 1 - p all numbers are exactly 0, otherwise they are sampled from independent normal
    distributions. Therefore a policy with continuous thrust can choose to coast exactly. The inputs are, in this order,
    the logit of p, the means, the logarithms of the standard deviations, and the logits of the choices. Source of the
    model: Mullahy, Specification and testing of some modified count data models, Journal of Econometrics 33, 1986,
    section 2.

    Without exploration the numbers are the means if p > 1/2, otherwise 0, and the choice is the most likely one.

    Args:
        numbers: A.
        choices: K, the number of values of the last element of the action; 0 if there is no such element.
    """

    def __init__(self, numbers: int, choices: int = 0) -> None:
        self.numbers, self.choices = numbers, choices
        self.width = numbers + bool(choices)

    @property
    def inputs(self) -> int:
        """Number of inputs: one logit, A means, A logarithms of standard deviations and K logits."""
        return 1 + 2 * self.numbers + self.choices

    def without_noise(self, inputs: AnyArray) -> AnyArray:
        """Return inputs whose nonzero samples are the means, shape (R, I); the choices are still sampled."""
        quiet = np.array(inputs, dtype=np.float32)
        quiet[:, 1 + self.numbers : 1 + 2 * self.numbers] = NO_NOISE
        return quiet

    def draw(self, inputs: AnyArray, explore: bool, rows: DrawRows, *out: AnyArray) -> None:
        """Sample actions; see `Distribution.draw`."""
        draw_hurdle(inputs, self.numbers, self.choices, explore, rows, *out)


def draw_choices(distribution: Any, inputs: AnyArray, seed: int) -> FloatArray:
    """Return actions with sampled choices and with the means of the numbers, shape (R, A).

    Args:
        distribution: Any distribution of a policy.
        inputs: Outputs of the network, float32, shape (R, I).
        seed: Seed of the draws.
    """
    rows = np.arange(len(inputs))
    hurdle = isinstance(distribution, Hurdle)
    drawn = hurdle or isinstance(distribution, Categorical)
    inputs = distribution.without_noise(inputs) if hurdle else inputs
    return draw_in_rollout(distribution, inputs, drawn, seed, rows, np.zeros_like(rows), 0)


@njit
def draw_hurdle(
    inputs: AnyArray,
    numbers: int,
    choices: int,
    explore: bool,
    rows: DrawRows,
    action: AnyArray,
    log_probability: AnyArray,
) -> None:
    """Sample whether the numbers are zero, the numbers, and the choice; the log-probability is of the float32 action.

    Args:
        inputs: See `Hurdle`, float32, shape (R, 1 + 2 A + K).
        numbers: A.
        choices: K.
        explore: See `Distribution.draw`.
        rows: See `Distribution.draw`.
        action: See `Distribution.draw`.
        log_probability: See `Distribution.draw`.
    """
    blocks = (numbers + 3) // 4
    width = 4 * (blocks + 1)  # one additional block of uniform numbers
    normal, uniform = np.empty(4), np.empty(4)
    for n in range(len(action)):
        logit = np.float64(inputs[n, 0])
        burns = logit > 0.0
        if explore:
            uniforms_of(rows, n, blocks, width, uniform)
            burns = uniform[0] < 1.0 / (1.0 + math.exp(-logit))
        density = log_logistic(logit if burns else -logit)
        for j in range(numbers):
            if explore and burns and j % 4 == 0:
                normals_of(rows, n, j // 4, width, normal)
            if burns:
                mean, log_std = np.float64(inputs[n, 1 + j]), np.float64(inputs[n, 1 + numbers + j])
                std = math.exp(log_std)
                action[n, j] = np.float32(mean + std * normal[j % 4]) if explore else np.float32(mean)
                z = (np.float64(action[n, j]) - mean) / std
                density -= 0.5 * z * z + log_std + HALF_LOG_2PI
            else:
                action[n, j] = np.float32(0.0)
        if choices:
            chosen, log_share = draw_choice(inputs[n], 1 + 2 * numbers, choices, explore, uniform[1])
            action[n, numbers] = np.float32(chosen)
            density += log_share
        log_probability[n] = np.float32(density)


@njit
def log_logistic(logit: float) -> float:
    """Return log(1 / (1 + exp(-logit))), without overflow."""
    if logit >= 0.0:
        return -math.log1p(math.exp(-logit))
    return logit - math.log1p(math.exp(logit))
