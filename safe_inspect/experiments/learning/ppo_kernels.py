"""PPO's loss on arrays: batches, their advantages, and gradients of the loss at the nets' outputs.

Autograd would record about thirty operations on a few hundred rows for each minibatch; these loops take as long as two
of these operations. They compute RLlib's loss, term by term, and a test compares them with RLlib's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.random.action_draws import HALF_LOG_2PI, log_logistic
from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray

#: Indices of the sums that the loops return.
SURROGATE, ENTROPY, KL = 0, 1, 2
CLIPPED, UNCLIPPED = 0, 1
#: Smallest standard deviation by which advantages are divided, as in RLlib.
_LEAST_SPREAD = 1e-4


class Terms(NamedTuple):
    """The coefficients of a policy's loss, as in RLlib's configuration.

    Attributes:
        clip: `clip_param`.
        value_clip: `vf_clip_param`, the largest squared error of a value with a gradient.
        value: `vf_loss_coeff`.
        entropy: Current value of `entropy_coeff`.
        divergence: Current coefficient of the divergence; 0 without `use_kl_loss`.
        measured: Whether the divergence is reported, `use_kl_loss`.
    """

    clip: float
    value_clip: float
    value: float
    entropy: float
    divergence: float
    measured: bool


class Form(NamedTuple):
    """The kind of an action distribution over A real numbers and choices of K_1 to K_m values.

    Its inputs are the logit of the probability of a burn if there is a gate, the means and the logarithms of the
    standard deviations of the numbers, and the logits of the choices.

    Attributes:
        gate: 1 for a hurdle distribution, whose numbers are all 0 unless there is a burn; 0 for others.
        sizes: K_1 to K_m, shape (m,).
    """

    gate: int
    sizes: IntArray


class Sampled(NamedTuple):
    """The R actions of a batch.

    Attributes:
        actions: Real numbers and indices of choices, shape (R, A + m).
        inputs: Inputs of the distribution with which they were sampled, shape (R, I).
        log_probabilities: Logarithms of their probability densities when they were sampled, shape (R,).
        advantages: Their advantages, shape (R,).
    """

    actions: AnyArray
    inputs: AnyArray
    log_probabilities: AnyArray
    advantages: AnyArray


@dataclass
class Batch:
    """P pieces of episodes of one policy, with R steps in total; arrays of numbers are float32.

    Attributes:
        all_observations: Observations of each step, and the one after the last step of each piece, shape (R + P, O).
        lengths: Number of steps of each piece, shape (P,).
        terminated: Whether the task ended with the last step of each piece, shape (P,).
        actions: Actions, shape (R, A).
        inputs: Inputs of the action distribution with which the actions were sampled, shape (R, I).
        log_probabilities: Log probabilities of the actions, shape (R,).
        rewards: Rewards, shape (R,).
        steps: Number of control steps of each decision, shape (R,); None if each row is one step.
        observations: Observations of each step, shape (R, O).
        advantages: Standardised advantages, shape (R,); see `advise`.
        targets: Targets of the value function, shape (R,); see `advise`.
    """

    all_observations: AnyArray
    lengths: IntArray
    terminated: BoolArray
    actions: AnyArray
    inputs: AnyArray
    log_probabilities: AnyArray
    rewards: AnyArray
    steps: IntArray | None = None
    observations: AnyArray = field(init=False)
    advantages: AnyArray = field(init=False)
    targets: AnyArray = field(init=False)

    def __post_init__(self) -> None:
        ends = np.cumsum(self.lengths + 1) - 1
        self.observations = np.delete(self.all_observations, ends, axis=0)
        self.advantages = np.empty_like(self.rewards)
        self.targets = np.empty_like(self.rewards)

    def __len__(self) -> int:
        return len(self.rewards)

    def advise(self, values: AnyArray, gamma: float, factor: float) -> None:
        """Compute advantages and value targets.

        Advantages get mean 0 and standard deviation 1 over the steps of the batch. RLlib also includes the artificial
        step after each piece, whose advantage depends on the order of the pieces and has no meaning.

        Args:
            values: Values of all observations, shape (R + P,).
            gamma: Discount of a control step; a decision of k steps discounts later rewards by gamma^k.
            factor: Lambda of the advantage estimation, applied once per row.
        """
        discounts = np.full(len(self), gamma) if self.steps is None else gamma ** self.steps.astype(np.float64)
        _advantages_of(
            self.lengths, self.terminated, self.rewards, values, discounts, factor, self.advantages, self.targets
        )
        spread = max(_LEAST_SPREAD, float(self.advantages.std(dtype=np.float64)))
        self.advantages -= self.advantages.mean(dtype=np.float64)
        self.advantages /= spread


@njit(nogil=True)
def _advantages_of(
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
def _clipped_surrogate(advantage: float, ratio: float, clip: float) -> tuple[float, float]:
    """Return min(A r, A clamp(r, 1 - c, 1 + c)), and the derivative of its negative with respect to log r."""
    free, held = advantage * ratio, advantage * min(max(ratio, 1.0 - clip), 1.0 + clip)
    return min(free, held), (-free if free < held or 1.0 - clip <= ratio <= 1.0 + clip else 0.0)


@njit(nogil=True)
def policy_gradient(
    rows: IntArray, inputs: AnyArray, form: Form, sampled: Sampled, terms: Terms, gradient: AnyArray, sums: FloatArray
) -> None:
    """Compute the gradient of the policy's loss with respect to the inputs of its action distribution.

    The loss is the mean of -min(A r, A clamp(r, 1 - c, 1 + c)) - e H + k KL over the minibatch's B rows, with the ratio
    r of the action's densities, the entropy H, and the divergence KL of the new distribution from the old. With the
    probability p of a burn, H = H(p) + p H(Gaussian) + H(choices) and KL = KL(p) + p_old KL(Gaussian) + KL(choices).
    Source: Schulman et al., Proximal Policy Optimization Algorithms, 2017, equations 7 and 8.

    Args:
        rows: Indices of the minibatch's rows among the batch's R rows, shape (B,).
        inputs: Inputs of the distribution for the minibatch, shape (B, I).
        form: Kind of the distribution.
        sampled: The actions of the batch.
        terms: The coefficients c, e and k.
        gradient: Receives the gradient, shape (B, I).
        sums: Receives the sums of surrogate, entropy and divergence, shape (3,).
    """
    sums[:] = 0.0
    count, gate, sizes = len(rows), form.gate, form.sizes
    numbers = sampled.actions.shape[1] - len(sizes)
    logs, old_logs = np.empty(inputs.shape[1]), np.empty(inputs.shape[1])
    for i in range(count):
        row = rows[i]
        actions, old_inputs = sampled.actions[row], sampled.inputs[row]
        burns, logit, log_p, log_q, old_log_p, old_log_q = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
        if gate:
            logit, old_logit = float(inputs[i, 0]), float(old_inputs[0])
            log_p, log_q = log_logistic(logit), log_logistic(-logit)
            old_log_p, old_log_q = log_logistic(old_logit), log_logistic(-old_logit)
            burns = 0.0
            for j in range(numbers):
                if actions[j] != 0.0:
                    burns = 1.0
        p, old_p = math.exp(log_p), math.exp(old_log_p)
        density, entropy, divergence = log_p if burns > 0.0 else log_q, 0.0, 0.0
        for j in range(numbers):
            log_std = float(inputs[i, gate + numbers + j])
            z = (float(actions[j]) - float(inputs[i, gate + j])) * math.exp(-log_std)
            density -= burns * (0.5 * z * z + log_std + HALF_LOG_2PI)
            entropy += log_std + 0.5 + HALF_LOG_2PI
        first = gate + 2 * numbers
        for j in range(len(sizes)):
            _log_softmax(inputs[i], first, sizes[j], logs)
            _log_softmax(old_inputs, first, sizes[j], old_logs)
            density += logs[first + int(actions[numbers + j])]
            first += sizes[j]
        advantage = float(sampled.advantages[row])
        ratio = math.exp(density - float(sampled.log_probabilities[row]))
        surrogate, push = _clipped_surrogate(advantage, ratio, terms.clip)
        sums[SURROGATE] += surrogate
        sums[ENTROPY] += p * entropy - p * log_p - (1.0 - p) * log_q
        if gate:
            gradient[i, 0] = (
                push * (burns - p) - terms.entropy * p * (1.0 - p) * (entropy - logit) + terms.divergence * (p - old_p)
            ) / count
        for j in range(numbers):
            mean, log_std = float(inputs[i, gate + j]), float(inputs[i, gate + numbers + j])
            old_mean, old_log_std = float(old_inputs[gate + j]), float(old_inputs[gate + numbers + j])
            over = math.exp(-log_std)
            z, shift = (float(actions[j]) - mean) * over, (old_mean - mean) * over
            spread = math.exp(2.0 * (old_log_std - log_std)) + shift * shift
            divergence += log_std - old_log_std + 0.5 * spread - 0.5
            gradient[i, gate + j] = (push * burns * z * over - terms.divergence * old_p * shift * over) / count
            gradient[i, gate + numbers + j] = (
                push * burns * (z * z - 1.0) - terms.entropy * p + terms.divergence * old_p * (1.0 - spread)
            ) / count
        sums[KL] += old_p * (old_log_p - log_p + divergence) + (1.0 - old_p) * (old_log_q - log_q)
        first = gate + 2 * numbers
        for j in range(len(sizes)):
            entropy = 0.0
            for k in range(first, first + sizes[j]):
                entropy -= math.exp(logs[k]) * logs[k]
                sums[KL] += math.exp(old_logs[k]) * (old_logs[k] - logs[k])
            sums[ENTROPY] += entropy
            chosen = first + int(actions[numbers + j])
            for k in range(first, first + sizes[j]):
                share = math.exp(logs[k])
                drawn = 1.0 if k == chosen else 0.0
                gradient[i, k] = (
                    push * (drawn - share)
                    + terms.entropy * share * (logs[k] + entropy)
                    + terms.divergence * (share - math.exp(old_logs[k]))
                ) / count
            first += sizes[j]


@njit(nogil=True)
def _log_softmax(logits: AnyArray, first: int, size: int, logs: FloatArray) -> None:
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
    rows: IntArray, values: AnyArray, targets: AnyArray, terms: Terms, gradient: AnyArray, sums: FloatArray
) -> None:
    """Compute the gradient of the value function's loss, the mean of c min((V - target)^2, clip), with respect to V.

    Args:
        rows: Indices of the minibatch's rows among the batch's R rows, shape (B,).
        values: V for the minibatch, shape (B,).
        targets: Value targets of the batch, shape (R,).
        terms: The coefficients: c, and the largest squared error with a gradient.
        gradient: Receives the gradient, shape (B,).
        sums: Receives the sums of the clipped and the unclipped squared errors, shape (2,).
    """
    sums[:] = 0.0
    count = len(rows)
    for i in range(count):
        error = float(values[i]) - float(targets[rows[i]])
        squared = error * error
        sums[CLIPPED] += min(squared, terms.value_clip)
        sums[UNCLIPPED] += squared
        gradient[i] = 2.0 * terms.value * error / count if squared <= terms.value_clip else 0.0
