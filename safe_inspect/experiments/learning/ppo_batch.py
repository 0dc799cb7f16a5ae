"""Conversion of RLlib's episodes to one batch of arrays for each policy that learns."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from ray.rllib.core import DEFAULT_MODULE_ID, Columns
from ray.rllib.utils.metrics import WEIGHTS_SEQ_NO

from safe_inspect.experiments.learning.ppo_kernels import advantages_of
from safe_inspect.experiments.sampling.rollout import DECISION_STEPS
from safe_inspect.types import AnyArray, BoolArray, IntArray

#: Smallest standard deviation by which advantages are divided, as in RLlib.
LEAST_SPREAD = 1e-4


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
        weights: Mean sequence number of the weights with which the actions were sampled; None if unknown.
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
    weights: float | None = None
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
        advantages_of(
            self.lengths, self.terminated, self.rewards, values, discounts, factor, self.advantages, self.targets
        )
        spread = max(LEAST_SPREAD, float(self.advantages.std(dtype=np.float64)))
        self.advantages -= self.advantages.mean(dtype=np.float64)
        self.advantages /= spread


def batches_of(episodes: Iterable[Any], wanted: Callable[[str], bool]) -> dict[str, Batch]:
    """Return the batch of each policy.

    Args:
        episodes: RLlib's episodes, of one agent or of several, as arrays.
        wanted: Function that returns whether a policy learns.
    """
    found: dict[str, list[Any]] = {}
    for episode in _single(episodes):
        name = str(episode.module_id or DEFAULT_MODULE_ID)
        if len(episode) and wanted(name):
            found.setdefault(name, []).append(episode)
    return {name: _batch(pieces) for name, pieces in found.items()}


def minibatches(rows: int, size: int | None, epochs: int, shuffled: bool, seed: tuple[int, str, int]) -> IntArray:
    """Return the rows of each minibatch, shape (M, B).

    All minibatches have the same size B. They are cut from the concatenated epochs, so that a minibatch may contain the
    end of one epoch and the start of the next. The last minibatch is completed with rows of a further epoch.

    Args:
        rows: Number of steps of the batch.
        size: B; None, or a size larger than the batch, selects the whole batch.
        epochs: How often each step is used.
        shuffled: Whether each epoch is shuffled separately.
        seed: Seed of the run, name of the policy, and number of the update.
    """
    size = min(size or rows, rows)
    count = -(-epochs * rows // size)
    generator = np.random.default_rng((seed[0], zlib.crc32(seed[1].encode()), seed[2]))
    passes = -(-count * size // rows)
    if not shuffled or size == rows:
        order = np.tile(np.arange(rows), passes)
    else:
        order = np.concatenate([generator.permutation(rows) for _ in range(passes)])
    return order[: count * size].reshape(count, size)


def _single(episodes: Iterable[Any]) -> Iterator[Any]:
    for episode in episodes:
        yield from episode.agent_episodes.values() if hasattr(episode, "agent_episodes") else (episode,)


def _batch(pieces: list[Any]) -> Batch:
    lengths = np.array([len(piece) for piece in pieces], dtype=np.int64)
    outputs = {
        key: [piece.extra_model_outputs[key] for piece in pieces if key in piece.extra_model_outputs]
        for key in (Columns.ACTION_DIST_INPUTS, Columns.ACTION_LOGP, WEIGHTS_SEQ_NO, DECISION_STEPS)
    }
    weights = [_data(buffer).mean() for buffer in outputs[WEIGHTS_SEQ_NO]]
    steps = outputs[DECISION_STEPS]
    return Batch(
        all_observations=_joined(piece.observations for piece in pieces),
        lengths=lengths,
        terminated=np.array([piece.is_terminated for piece in pieces], dtype=np.bool_),
        actions=_joined(piece.actions for piece in pieces),
        inputs=_joined(outputs[Columns.ACTION_DIST_INPUTS]),
        log_probabilities=_joined(outputs[Columns.ACTION_LOGP]),
        rewards=_joined(piece.rewards for piece in pieces),
        weights=float(np.average(weights, weights=lengths)) if len(weights) == len(pieces) else None,
        steps=np.concatenate([_data(buffer) for buffer in steps]) if steps else None,
    )


def _joined(buffers: Iterable[Any]) -> AnyArray:
    return np.ascontiguousarray(np.concatenate([_data(buffer) for buffer in buffers]), dtype=np.float32)


def _data(buffer: Any) -> AnyArray:
    """Return the data of one of RLlib's buffers without its lookback."""
    return np.asarray(buffer.data[buffer.lookback :])
