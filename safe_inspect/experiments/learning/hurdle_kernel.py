"""The gradient of PPO's loss for a hurdle distribution, with respect to the outputs of the policy net."""

from __future__ import annotations

import math

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.experiments.learning.ppo_kernels import ENTROPY, KL, SURROGATE, clipped_surrogate, log_softmax
from safe_inspect.random.action_draws import HALF_LOG_2PI
from safe_inspect.random.hurdle_draws import log_logistic
from safe_inspect.types import AnyArray, FloatArray, IntArray


@njit(nogil=True)
def hurdle_gradient(
    rows: IntArray,
    inputs: AnyArray,
    sizes: tuple[int, int],
    actions: AnyArray,
    old_inputs: AnyArray,
    old_log_probability: AnyArray,
    advantages: AnyArray,
    clip: float,
    entropy_coefficient: float,
    kl_coefficient: float,
    gradient: AnyArray,
    sums: FloatArray,
) -> None:
    """Compute the gradient of the policy's loss with respect to the inputs of its hurdle distribution.

    The loss is that of `policy_gradient`. With the probability p of a burn, the entropy is
    H(p) + p H(Gaussian) + H(choices), and the divergence is KL(p) + p_old KL(Gaussian) + KL(choices).

    Args:
        rows: Indices of the minibatch's rows among the batch's R rows, shape (B,).
        inputs: Inputs of the distribution for the minibatch, see `Hurdle`, shape (B, 1 + 2 A + K).
        sizes: A and K; K is 0 if the action has no choice.
        actions: Actions of the batch, shape (R, A), or (R, A + 1) with a choice; if all numbers are 0, there is no
            burn.
        old_inputs: Inputs with which the actions were sampled, shape (R, 1 + 2 A + K).
        old_log_probability: Logarithms of the actions' probability densities when they were sampled, shape (R,).
        advantages: Advantages of the batch, shape (R,).
        clip: See `policy_gradient`.
        entropy_coefficient: See `policy_gradient`.
        kl_coefficient: See `policy_gradient`.
        gradient: Receives the gradient, shape (B, 1 + 2 A + K).
        sums: Receives the sums of surrogate, entropy and divergence, shape (3,).
    """
    sums[:] = 0.0
    numbers, choices = sizes
    count, first = len(rows), 1 + 2 * numbers
    logs, old_logs = np.empty(inputs.shape[1]), np.empty(inputs.shape[1])
    for i in range(count):
        row = rows[i]
        logit, old_logit = float(inputs[i, 0]), float(old_inputs[row, 0])
        log_p, log_q = log_logistic(logit), log_logistic(-logit)
        p, old_p = math.exp(log_p), math.exp(log_logistic(old_logit))
        burns = 0.0
        for j in range(numbers):
            if actions[row, j] != 0.0:
                burns = 1.0
        density = log_p if burns > 0.0 else log_q
        gaussian_entropy, gaussian_kl = 0.0, 0.0
        for j in range(numbers):
            mean, log_std = float(inputs[i, 1 + j]), float(inputs[i, 1 + numbers + j])
            old_mean, old_log_std = float(old_inputs[row, 1 + j]), float(old_inputs[row, 1 + numbers + j])
            over = math.exp(-log_std)
            z, shift = (float(actions[row, j]) - mean) * over, (old_mean - mean) * over
            density -= burns * (0.5 * z * z + log_std + HALF_LOG_2PI)
            gaussian_entropy += log_std + 0.5 + HALF_LOG_2PI
            spread = math.exp(2.0 * (old_log_std - log_std)) + shift * shift
            gaussian_kl += log_std - old_log_std + 0.5 * spread - 0.5
        chosen, entropy = first, 0.0
        if choices:
            log_softmax(inputs[i], first, choices, logs)
            log_softmax(old_inputs[row], first, choices, old_logs)
            chosen += int(actions[row, numbers])
            density += logs[chosen]
            for k in range(first, first + choices):
                entropy -= math.exp(logs[k]) * logs[k]
                sums[KL] += math.exp(old_logs[k]) * (old_logs[k] - logs[k])
        sums[ENTROPY] += entropy - p * log_p - (1.0 - p) * log_q + p * gaussian_entropy
        old_log_p, old_log_q = log_logistic(old_logit), log_logistic(-old_logit)
        sums[KL] += old_p * (old_log_p - log_p + gaussian_kl) + (1.0 - old_p) * (old_log_q - log_q)
        advantage = float(advantages[row])
        ratio = math.exp(density - float(old_log_probability[row]))
        surrogate, push = clipped_surrogate(advantage, ratio, clip)
        sums[SURROGATE] += surrogate
        gradient[i, 0] = (
            push * (burns - p)
            - entropy_coefficient * p * (1.0 - p) * (gaussian_entropy - logit)
            + kl_coefficient * (p - old_p)
        ) / count
        for j in range(numbers):
            mean, log_std = float(inputs[i, 1 + j]), float(inputs[i, 1 + numbers + j])
            old_mean, old_log_std = float(old_inputs[row, 1 + j]), float(old_inputs[row, 1 + numbers + j])
            over = math.exp(-log_std)
            z, shift = (float(actions[row, j]) - mean) * over, (old_mean - mean) * over
            spread = math.exp(2.0 * (old_log_std - log_std)) + shift * shift
            gradient[i, 1 + j] = (push * burns * z * over - kl_coefficient * old_p * shift * over) / count
            gradient[i, 1 + numbers + j] = (
                push * burns * (z * z - 1.0) - entropy_coefficient * p + kl_coefficient * old_p * (1.0 - spread)
            ) / count
        for k in range(first, first + choices):
            share = math.exp(logs[k])
            drawn = 1.0 if k == chosen else 0.0
            gradient[i, k] = (
                push * (drawn - share)
                + entropy_coefficient * share * (logs[k] + entropy)
                + kl_coefficient * (share - math.exp(old_logs[k]))
            ) / count
