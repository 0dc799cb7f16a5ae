"""Sampling of actions from the distributions of policies, as a function of (seed, slot, episode, step, agent).

Therefore the same seed gives the same actions in training and evaluation, for any number of environments in a batch and
any number of processes. The counters are those of `safe_inspect.random.streams`, with the purpose ``action``;
block b of agent i has the index i ceil(A / 4) + b.
"""

from __future__ import annotations

import math
import zlib
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from safe_inspect.compiling import njit
from safe_inspect.random.streams import philox4x32
from safe_inspect.types import AnyArray, FloatArray, IntArray

_ACTION = np.uint64(zlib.crc32(b"action"))
_STEP_SHIFT = np.uint64(12)
_UNIT = 2.0**-32
#: Logarithm of a standard deviation that is so small that a sample equals the mean.
NO_NOISE = -20.0
HALF_LOG_2PI = 0.5 * math.log(2.0 * math.pi)


class DrawRows(NamedTuple):
    """The quantities that determine the samples of R rows.

    Attributes:
        seed: The seed of the run.
        slot: Global index of each row's environment slot, shape (R,).
        episode: Index of the episode within its slot, shape (R,).
        step: Steps since the reset, below 2**20, shape (R,).
        agent: Index of each row's deputy, below 4096 / ceil(A / 4), shape (R,).
    """

    seed: np.uint64
    slot: NDArray[np.uint64]
    episode: IntArray
    step: IntArray
    agent: IntArray


class Gaussian:
    """Independent normal distributions over A real numbers; the most likely action is the mean.

    Args:
        width: A.
    """

    def __init__(self, width: int) -> None:
        self.width = width

    @property
    def inputs(self) -> int:
        """Number of outputs of the network that are used: means and logarithms of the standard deviations, 2 A."""
        return 2 * self.width

    def draw(self, inputs: AnyArray, explore: bool, rows: DrawRows, *out: AnyArray) -> None:
        """Sample actions, or take the most likely ones.

        Args:
            inputs: Outputs of the network, float32, shape (R, I).
            explore: If False, take the most likely action.
            rows: The quantities that determine the samples.
            *out: Receive the actions, float32, shape (R, A), and the logarithms of their probabilities, or densities,
                float32, shape (R,).
        """
        draw_gaussian(inputs, explore, rows, *out)


class SquashedGaussian(Gaussian):
    """Hyperbolic tangents of `Gaussian` numbers, as in SAC; without exploration, of the means.

    The probability is that of the Gaussian numbers.
    """

    def draw(self, inputs: AnyArray, explore: bool, rows: DrawRows, *out: AnyArray) -> None:
        """Sample actions; see `Gaussian.draw`."""
        super().draw(inputs, explore, rows, *out)
        np.tanh(out[0], out=out[0])


class Categorical:
    """Independent choices of A indices; the most likely action has the largest logits, the first ones if equal.

    Args:
        sizes: Number of values of each index.
    """

    def __init__(self, sizes: tuple[int, ...]) -> None:
        self.sizes: IntArray = np.array(sizes, dtype=np.int64)
        self.width = len(sizes)

    @property
    def inputs(self) -> int:
        """Number of logits, K_1 + ... + K_A."""
        return int(self.sizes.sum())

    def draw(self, inputs: AnyArray, explore: bool, rows: DrawRows, *out: AnyArray) -> None:
        """Sample actions; see `Gaussian.draw`."""
        _draw_categorical(inputs, self.sizes, explore, rows, *out)


class Greedy(Categorical):
    """The choices with the largest values, the first ones if equal, also with exploration, as for a policy of DQN."""

    def draw(self, inputs: AnyArray, explore: bool, rows: DrawRows, *out: AnyArray) -> None:
        """Select actions; see `Gaussian.draw`."""
        super().draw(inputs, False, rows, *out)


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
        """Sample actions; see `Gaussian.draw`."""
        _draw_hurdle(inputs, self.numbers, self.choices, explore, rows, *out)


#: A mapping from the outputs of a policy's network to actions.
Distribution: TypeAlias = Gaussian | Categorical | Hurdle


def draw_in_rollout(
    distribution: Any, inputs: AnyArray, explore: bool, seed: int, slots: IntArray, deputies: IntArray, step: int
) -> FloatArray:
    """Return actions for the first episode of every slot, shape (R, A).

    Args:
        distribution: A `Distribution`.
        inputs: Outputs of the network, float32, shape (R, I).
        explore: If False, take the most likely action.
        seed: Seed of the draws.
        slots: Global index of each row's environment slot, shape (R,).
        deputies: Index of each row's deputy, shape (R,).
        step: Steps since the reset.
    """
    rows = DrawRows(
        np.uint64(seed),
        slots.astype(np.uint64),
        np.zeros(len(inputs), dtype=np.int64),
        np.full(len(inputs), step, dtype=np.int64),
        deputies.astype(np.int64),
    )
    action, log_probability = np.empty((len(inputs), distribution.width), np.float32), np.empty(len(inputs), np.float32)
    distribution.draw(np.ascontiguousarray(inputs, np.float32), explore, rows, action, log_probability)
    return action.astype(np.float64)


def draw_choices(distribution: Distribution, inputs: AnyArray, seed: int) -> FloatArray:
    """Return actions with sampled choices and with the means of the numbers, shape (R, A).

    Args:
        distribution: The distribution.
        inputs: Outputs of the network, float32, shape (R, I).
        seed: Seed of the draws.
    """
    rows = np.arange(len(inputs))
    if isinstance(distribution, Hurdle):
        inputs = distribution.without_noise(inputs)
    drawn = isinstance(distribution, Hurdle | Categorical)
    return draw_in_rollout(distribution, inputs, drawn, seed, rows, np.zeros_like(rows), 0)


@njit
def draw_gaussian(inputs: AnyArray, explore: bool, rows: DrawRows, action: AnyArray, log_probability: AnyArray) -> None:
    """Sample mean + exp(log_std) z with standard normal z; the log-probability is that of the float32 action.

    Args:
        inputs: Mean and logarithm of the standard deviation, float32, shape (R, 2 A).
        explore: See `Gaussian.draw`.
        rows: See `Gaussian.draw`.
        action: See `Gaussian.draw`.
        log_probability: See `Gaussian.draw`.
    """
    count, width = action.shape
    normal = np.empty(4)
    for n in range(count):
        density = 0.0
        for block in range((width + 3) // 4):
            if explore:
                _normals_of(rows, n, block, width, normal)
            else:
                normal[:] = 0.0
            for j in range(4 * block, min(4 * block + 4, width)):
                mean, log_std = np.float64(inputs[n, j]), np.float64(inputs[n, width + j])
                std = math.exp(log_std)
                action[n, j] = np.float32(mean + std * normal[j - 4 * block])
                z = (np.float64(action[n, j]) - mean) / std
                density -= 0.5 * z * z + log_std + HALF_LOG_2PI
        log_probability[n] = np.float32(density)


@njit
def _draw_choice(logits: AnyArray, first: int, size: int, explore: bool, uniform: float) -> tuple[int, float]:
    """Return an index that is sampled with the probabilities softmax(logits), and the logarithm of its probability.

    Args:
        logits: Logits of one row, float32.
        first: Position of this element's first logit.
        size: Number of its values.
        explore: Whether to sample; otherwise the index is the most likely one.
        uniform: Uniform number in [0, 1) that determines the sample.
    """
    best = 0
    for k in range(1, size):
        if logits[first + k] > logits[first + best]:
            best = k
    largest = np.float64(logits[first + best])
    mass = 0.0
    for k in range(size):
        mass += math.exp(np.float64(logits[first + k]) - largest)
    chosen = best
    if explore:
        chosen, below = 0, math.exp(np.float64(logits[first]) - largest)
        while chosen < size - 1 and below < uniform * mass:
            chosen += 1
            below += math.exp(np.float64(logits[first + chosen]) - largest)
    return chosen, np.float64(logits[first + chosen]) - largest - math.log(mass)


@njit
def _draw_categorical(
    inputs: AnyArray, sizes: IntArray, explore: bool, rows: DrawRows, action: AnyArray, log_probability: AnyArray
) -> None:
    """Sample an index for each element, with the probabilities softmax(logits).

    Args:
        inputs: Concatenated logits of all elements, float32, shape (R, K_1 + ... + K_A).
        sizes: Number of values of each element, K_1 to K_A, shape (A,).
        explore: See `Gaussian.draw`.
        rows: See `Gaussian.draw`.
        action: See `Gaussian.draw`.
        log_probability: See `Gaussian.draw`.
    """
    count, width = action.shape
    uniform = np.empty(4)
    for n in range(count):
        first, total = 0, 0.0
        for j in range(width):
            if explore and j % 4 == 0:
                _uniforms_of(rows, n, j // 4, width, uniform)
            size = sizes[j]
            chosen, log_share = _draw_choice(inputs[n], first, size, explore, uniform[j % 4])
            action[n, j] = np.float32(chosen)
            total += log_share
            first += size
        log_probability[n] = np.float32(total)


@njit
def _draw_hurdle(
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
        explore: See `Gaussian.draw`.
        rows: See `Gaussian.draw`.
        action: See `Gaussian.draw`.
        log_probability: See `Gaussian.draw`.
    """
    blocks = (numbers + 3) // 4
    width = 4 * (blocks + 1)  # one additional block of uniform numbers
    normal, uniform = np.empty(4), np.empty(4)
    for n in range(len(action)):
        logit = np.float64(inputs[n, 0])
        burns = logit > 0.0
        if explore:
            _uniforms_of(rows, n, blocks, width, uniform)
            burns = uniform[0] < 1.0 / (1.0 + math.exp(-logit))
        density = log_logistic(logit if burns else -logit)
        for j in range(numbers):
            if explore and burns and j % 4 == 0:
                _normals_of(rows, n, j // 4, width, normal)
            if burns:
                mean, log_std = np.float64(inputs[n, 1 + j]), np.float64(inputs[n, 1 + numbers + j])
                std = math.exp(log_std)
                action[n, j] = np.float32(mean + std * normal[j % 4]) if explore else np.float32(mean)
                z = (np.float64(action[n, j]) - mean) / std
                density -= 0.5 * z * z + log_std + HALF_LOG_2PI
            else:
                action[n, j] = np.float32(0.0)
        if choices:
            chosen, log_share = _draw_choice(inputs[n], 1 + 2 * numbers, choices, explore, uniform[1])
            action[n, numbers] = np.float32(chosen)
            density += log_share
        log_probability[n] = np.float32(density)


@njit
def log_logistic(logit: float) -> float:
    """Return log(1 / (1 + exp(-logit))), without overflow."""
    if logit >= 0.0:
        return -math.log1p(math.exp(-logit))
    return logit - math.log1p(math.exp(logit))


@njit
def _words(rows: DrawRows, n: int, block: int, width: int) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """Return the four 32-bit words of a block of a row."""
    place = np.uint64(rows.agent[n] * ((width + 3) // 4) + block) + (np.uint64(rows.step[n]) << _STEP_SHIFT)
    return philox4x32(place, _ACTION, np.uint64(rows.episode[n]), rows.slot[n], rows.seed)


@njit
def _uniforms_of(rows: DrawRows, n: int, block: int, width: int, uniform: FloatArray) -> None:
    """Write four independent uniform numbers in (0, 1)."""
    w0, w1, w2, w3 = _words(rows, n, block, width)
    uniform[0], uniform[1] = (np.float64(w0) + 0.5) * _UNIT, (np.float64(w1) + 0.5) * _UNIT
    uniform[2], uniform[3] = (np.float64(w2) + 0.5) * _UNIT, (np.float64(w3) + 0.5) * _UNIT


@njit
def _normals_of(rows: DrawRows, n: int, block: int, width: int, normal: FloatArray) -> None:
    """Write four independent standard normal numbers, computed with the Box-Muller transform."""
    w0, w1, w2, w3 = _words(rows, n, block, width)
    radius = math.sqrt(-2.0 * math.log((np.float64(w0) + 0.5) * _UNIT))
    angle = 2.0 * math.pi * np.float64(w1) * _UNIT
    normal[0], normal[1] = radius * math.cos(angle), radius * math.sin(angle)
    radius = math.sqrt(-2.0 * math.log((np.float64(w2) + 0.5) * _UNIT))
    angle = 2.0 * math.pi * np.float64(w3) * _UNIT
    normal[2], normal[3] = radius * math.cos(angle), radius * math.sin(angle)
