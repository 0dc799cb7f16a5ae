"""PPO's computations on arrays: advantages of pieces of episodes, and gradients of the loss at the nets' outputs.

Autograd would record about thirty operations on a few hundred rows for each minibatch; these loops take as long as two
of these operations. They compute RLlib's loss, term by term, and a test compares them with RLlib's.
"""

from __future__ import annotations

import math

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.random.action_draws import HALF_LOG_2PI
from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray

#: Indices of the sums that the loops return.
SURROGATE, ENTROPY, KL = 0, 1, 2
CLIPPED, UNCLIPPED = 0, 1


@njit(nogil=True)
def advantages_of(
    lengths: IntArray,
    terminated: BoolArray,
    rewards: AnyArray,
    values: AnyArray,
    discounts: FloatArray,
    factor: float,
    advantages: AnyArray,
    targets: AnyArray,
) -> None:
    """Compute generalised advantages of P concatenated pieces of episodes, with R steps in total.

    The advantage is A_t = delta_t + g_t lambda A_(t+1) with delta_t = r_t + g_t V_(t+1) - V_t within a piece, and the
    value target is A_t + V_t. The discount g_t is gamma for a step, and gamma^k for a decision of k control steps,
    whose reward is r_t = sum gamma^i r_(t,i) over them: a semi-Markov decision process. After a termination V is zero;
    after a truncation, or where a batch cuts an episode that continues, it is the value of the net. Sources: Schulman
    et al., High-Dimensional Continuous Control Using Generalized Advantage Estimation, 2016, equation 16; Sutton,
    Precup and Singh, Between MDPs and semi-MDPs, Artificial Intelligence 112, 1999, section 3.2.

    Args:
        lengths: Number of steps of each piece, shape (P,).
        terminated: Whether the task ended with the last step of each piece, shape (P,).
        rewards: Rewards, shape (R,).
        values: The net's values at the start of each step and after the last step of each piece, shape (R + P,).
        discounts: Discount of the values after each step or decision, shape (R,).
        factor: Lambda.
        advantages: Receives the advantages, shape (R,).
        targets: Receives the value targets, shape (R,).
    """
    step = 0
    for piece in range(len(lengths)):
        length = lengths[piece]
        value = step + piece  # each earlier piece has one more value than steps
        after = 0.0 if terminated[piece] else float(values[value + length])
        advantage = 0.0
        for t in range(length - 1, -1, -1):
            now = float(values[value + t])
            gamma = discounts[step + t]
            advantage = rewards[step + t] + gamma * after - now + gamma * factor * advantage
            advantages[step + t] = advantage
            targets[step + t] = advantage + now
            after = now
        step += length


@njit(nogil=True)
def clipped_surrogate(advantage: float, ratio: float, clip: float) -> tuple[float, float]:
    """Return min(A r, A clamp(r, 1 - c, 1 + c)), and the derivative of its negative with respect to log r."""
    free, held = advantage * ratio, advantage * min(max(ratio, 1.0 - clip), 1.0 + clip)
    return min(free, held), (-free if free < held or 1.0 - clip <= ratio <= 1.0 + clip else 0.0)


@njit(nogil=True)
def policy_gradient(
    rows: IntArray,
    inputs: AnyArray,
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
    """Compute the gradient of the policy's loss with respect to the inputs of its Gaussian distribution.

    The loss is the mean of -min(A r, A clamp(r, 1 - c, 1 + c)) - e H + k KL over the minibatch's B rows, with the ratio
    r of the action's densities, the entropy H, and the divergence KL of the new distribution from the old. Source:
    Schulman et al., Proximal Policy Optimization Algorithms, 2017, equations 7 and 8.

    Args:
        rows: Indices of the minibatch's rows among the batch's R rows, shape (B,).
        inputs: Means and logarithms of the standard deviations for the minibatch, shape (B, 2 A).
        actions: Actions of the batch, shape (R, A).
        old_inputs: Means and logarithms with which the actions were sampled, shape (R, 2 A).
        old_log_probability: Logarithms of the actions' densities when they were sampled, shape (R,).
        advantages: Advantages of the batch, shape (R,).
        clip: c.
        entropy_coefficient: e.
        kl_coefficient: k; zero if the loss has no such term.
        gradient: Receives the gradient, shape (B, 2 A).
        sums: Receives the sums of surrogate, entropy and divergence, shape (3,).
    """
    sums[:] = 0.0
    count, width = len(rows), actions.shape[1]
    for i in range(count):
        row = rows[i]
        density = 0.0
        for j in range(width):
            log_std = float(inputs[i, width + j])
            z = (float(actions[row, j]) - float(inputs[i, j])) * math.exp(-log_std)
            density -= 0.5 * z * z + log_std + HALF_LOG_2PI
            sums[ENTROPY] += log_std + 0.5 + HALF_LOG_2PI
        advantage = float(advantages[row])
        ratio = math.exp(density - float(old_log_probability[row]))
        surrogate, push = clipped_surrogate(advantage, ratio, clip)
        sums[SURROGATE] += surrogate
        for j in range(width):
            mean, log_std = float(inputs[i, j]), float(inputs[i, width + j])
            old_mean, old_log_std = float(old_inputs[row, j]), float(old_inputs[row, width + j])
            over = math.exp(-log_std)
            z = (float(actions[row, j]) - mean) * over
            shift = (old_mean - mean) * over
            spread = math.exp(2.0 * (old_log_std - log_std)) + shift * shift
            sums[KL] += log_std - old_log_std + 0.5 * spread - 0.5
            gradient[i, j] = (push * z * over - kl_coefficient * shift * over) / count
            gradient[i, width + j] = (
                push * (z * z - 1.0) - entropy_coefficient + kl_coefficient * (1.0 - spread)
            ) / count


@njit(nogil=True)
def choice_gradient(
    rows: IntArray,
    inputs: AnyArray,
    sizes: IntArray,
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
    """Compute the gradient of the policy's loss with respect to the logits of its categorical distributions.

    The loss is that of `policy_gradient`.

    Args:
        rows: Indices of the minibatch's rows among the batch's R rows, shape (B,).
        inputs: Logits for the minibatch, concatenated over the elements of the action, shape (B, K_1 + ... + K_A).
        sizes: K_1 to K_A, the number of values of each element, shape (A,).
        actions: Actions of the batch as indices of values, shape (R, A).
        old_inputs: Logits with which the actions were sampled, shape (R, K_1 + ... + K_A).
        old_log_probability: Logarithms of the actions' probabilities when they were sampled, shape (R,).
        advantages: Advantages of the batch, shape (R,).
        clip: See `policy_gradient`.
        entropy_coefficient: See `policy_gradient`.
        kl_coefficient: See `policy_gradient`.
        gradient: Receives the gradient, shape (B, K_1 + ... + K_A).
        sums: Receives the sums of surrogate, entropy and divergence, shape (3,).
    """
    sums[:] = 0.0
    count, width = len(rows), len(sizes)
    logs, old_logs = np.empty(inputs.shape[1]), np.empty(inputs.shape[1])
    for i in range(count):
        row = rows[i]
        first, total = 0, 0.0
        for j in range(width):
            log_softmax(inputs[i], first, sizes[j], logs)
            log_softmax(old_inputs[row], first, sizes[j], old_logs)
            total += logs[first + int(actions[row, j])]
            first += sizes[j]
        advantage = float(advantages[row])
        ratio = math.exp(total - float(old_log_probability[row]))
        surrogate, push = clipped_surrogate(advantage, ratio, clip)
        sums[SURROGATE] += surrogate
        first = 0
        for j in range(width):
            entropy = 0.0
            for k in range(first, first + sizes[j]):
                entropy -= math.exp(logs[k]) * logs[k]
                sums[KL] += math.exp(old_logs[k]) * (old_logs[k] - logs[k])
            sums[ENTROPY] += entropy
            chosen = first + int(actions[row, j])
            for k in range(first, first + sizes[j]):
                share = math.exp(logs[k])
                drawn = 1.0 if k == chosen else 0.0
                gradient[i, k] = (
                    push * (drawn - share)
                    + entropy_coefficient * share * (logs[k] + entropy)
                    + kl_coefficient * (share - math.exp(old_logs[k]))
                ) / count
            first += sizes[j]


@njit(nogil=True)
def log_softmax(logits: AnyArray, first: int, size: int, logs: FloatArray) -> None:
    """Write the logarithms of the probabilities of `size` logits, from index `first` on, into `logs`."""
    largest = float(logits[first])
    for k in range(first + 1, first + size):
        largest = max(largest, float(logits[k]))
    mass = 0.0
    for k in range(first, first + size):
        mass += math.exp(float(logits[k]) - largest)
    for k in range(first, first + size):
        logs[k] = float(logits[k]) - largest - math.log(mass)


@njit(nogil=True)
def value_gradient(
    rows: IntArray,
    values: AnyArray,
    targets: AnyArray,
    clip: float,
    coefficient: float,
    gradient: AnyArray,
    sums: FloatArray,
) -> None:
    """Compute the gradient of the value function's loss, the mean of c min((V - target)^2, clip), with respect to V.

    Args:
        rows: Indices of the minibatch's rows among the batch's R rows, shape (B,).
        values: V for the minibatch, shape (B,).
        targets: Value targets of the batch, shape (R,).
        clip: Largest squared error with a gradient.
        coefficient: c.
        gradient: Receives the gradient, shape (B,).
        sums: Receives the sums of the clipped and the unclipped squared errors, shape (2,).
    """
    sums[:] = 0.0
    count = len(rows)
    for i in range(count):
        error = float(values[i]) - float(targets[rows[i]])
        squared = error * error
        sums[CLIPPED] += min(squared, clip)
        sums[UNCLIPPED] += squared
        gradient[i] = 2.0 * coefficient * error / count if squared <= clip else 0.0
