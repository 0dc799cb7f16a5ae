"""Trained policies of a checkpoint as functions of observations."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
import tree  # type: ignore[import-untyped,import-not-found,unused-ignore]
from numpy.typing import NDArray
from ray.rllib.core.columns import Columns

from safe_inspect.errors import CheckpointError
from safe_inspect.evaluation.policies import Flight, require_finite_rows
from safe_inspect.evaluation.policy_file import PolicyInfo
from safe_inspect.experiments.files.checkpoints import policy_folder
from safe_inspect.experiments.files.weights import info_of, read_weights
from safe_inspect.experiments.modules.distributions import distribution_of_module
from safe_inspect.experiments.modules.fresh_policy import build_module
from safe_inspect.random.action_draws import Categorical, Hurdle, draw_choices, draw_in_rollout
from safe_inspect.types import AnyArray, BoolArray, FloatArray


class TrainedPolicy:
    """A trained policy as a function of observations.

    Args:
        module: RLlib's module of the policy.
        sampled: False: the action is the mean of a Gaussian policy, the most likely choice of a categorical policy, and
            both of a hurdle policy. True: actions are sampled from the distribution, as in training. None: choices are
            sampled in a rollout, because a policy learns how often to burn and no single burn need be likely; the size
            of a burn is its mean. Samples are functions of the seed, the environment slot, the step and the agent, so
            that the same seed gives the same episodes.
        seed: Seed of the sampled actions.

    Raises:
        CheckpointError: The policy's actions are neither Gaussian nor categorical.
    """

    def __init__(self, module: Any, sampled: bool | None = None, seed: int = 0) -> None:
        self.module = module.eval()
        self.sampled, self.seed = sampled, seed
        distribution = distribution_of_module(module)
        if distribution is None:
            raise CheckpointError("the policy's actions are neither Gaussian nor categorical, so it cannot be used")
        self._distribution = distribution
        self._chooses = isinstance(distribution, (Categorical, Hurdle))
        self.recurrent = bool(module.is_stateful())
        self._memory: Any = None
        self._rows = 0
        self._flight: Flight | None = None
        self._steps = 0

    @property
    def info(self) -> PolicyInfo | None:
        """The description of the policy; None if its checkpoint does not contain it."""
        return info_of(self.module.model_config)

    def begin(self, flight: Flight) -> None:
        """Start a rollout: set the slots of the rows, for sampled actions, and reset any recurrent state."""
        self._flight, self._steps = flight, 0
        self.reset()

    def reset(self, rows: BoolArray | None = None) -> None:
        """Reset the state of a recurrent policy at the start of episodes.

        Args:
            rows: Mask of the rows in which episodes start, shape (R,), with R as in the last call; by default all rows.
        """
        if rows is None:
            self._memory = None
        elif self._memory is not None:
            fresh = _for_rows(self.module.get_initial_state(), self._rows)
            starts = torch.tensor(rows)
            self._memory = tree.map_structure(
                lambda held, new: torch.where(starts.reshape(-1, *(1,) * (held.dim() - 1)), new, held),
                self._memory,
                fresh,
            )

    def inputs(self, observation: NDArray[np.float32]) -> AnyArray:
        """Return the inputs of the action distributions, float32, shape (R, I), for observations (R, O).

        A recurrent policy stores the state of each row until `begin` or `reset` is called or the number of rows
        changes.

        Raises:
            ArgumentError: The observations contain NaN or infinity.
        """
        require_finite_rows(observation)
        seen = torch.from_numpy(np.ascontiguousarray(observation))
        with torch.no_grad(), _one_thread():
            if not self.recurrent:
                outputs = self.module.forward_inference({Columns.OBS: seen})
                return np.asarray(outputs[Columns.ACTION_DIST_INPUTS].numpy())
            if self._memory is None or self._rows != len(seen):
                self._rows, self._memory = len(seen), _for_rows(self.module.get_initial_state(), len(seen))
            batch = {Columns.OBS: seen[:, None], Columns.STATE_IN: self._memory}  # one step of time
            outputs = self.module.forward_inference(batch)
            self._memory = outputs[Columns.STATE_OUT]
        return np.asarray(outputs[Columns.ACTION_DIST_INPUTS][:, 0].numpy())

    def draw(self, observation: NDArray[np.float32], seed: int) -> FloatArray:
        """Return actions (R, A) for observations (R, O), with sampled choices and mean numbers."""
        return draw_choices(self._distribution, self.inputs(observation), seed)

    def __call__(self, observation: NDArray[np.float32]) -> FloatArray:
        """Return the actions (R, A) for observations (R, O)."""
        inputs = self.inputs(observation)
        drawn = self._chooses and self._flight is not None if self.sampled is None else self.sampled
        if self.sampled is None and isinstance(self._distribution, Hurdle):
            inputs = self._distribution.without_noise(inputs)
        flight, rows = self._flight, len(inputs)
        slots = np.arange(rows) if flight is None else flight.slots
        deputies = np.zeros(rows, dtype=np.int64) if flight is None else flight.deputies
        actions = draw_in_rollout(self._distribution, inputs, drawn, self.seed, slots, deputies, self._steps)
        self._steps += 1
        return actions


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let Torch use one thread, which is faster for small nets and bit-identical on any number of cores."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def _for_rows(state: Any, count: int) -> Any:
    """Return the initial state of a recurrent module, repeated for each row, with the same nesting."""
    return tree.map_structure(lambda value: torch.as_tensor(value).expand(count, *value.shape), state)


def trained_policy(
    checkpoint: str | os.PathLike[str], policy: str | None = None, *, sampled: bool | None = None, seed: int = 0
) -> TrainedPolicy:
    """Return a policy of a checkpoint.

    Args:
        checkpoint: The checkpoint's folder.
        policy: Name of the policy; needed if the checkpoint contains several.
        sampled: Whether actions are sampled, see `TrainedPolicy`.
        seed: Seed of the sampled actions.

    Raises:
        CheckpointError: The checkpoint is missing or damaged, or has the policy not at all or only as a pickle.
    """
    return TrainedPolicy(_load(checkpoint, policy), sampled, seed)


def untrained_policy(checkpoint: str | os.PathLike[str], seed: int = 0, policy: str | None = None) -> TrainedPolicy:
    """Return a policy with the same settings as a checkpoint's, but with new random weights.

    Args:
        checkpoint: The checkpoint's folder.
        seed: Seed of the weights.
        policy: Name of the policy; needed if the checkpoint contains several.

    Raises:
        CheckpointError: The checkpoint is missing or damaged, or has the policy not at all or only as a pickle.
    """
    module = _load(checkpoint, policy)
    arguments, keywords = module.get_ctor_args_and_kwargs()
    torch.manual_seed(seed)
    return TrainedPolicy(type(module)(*arguments, **keywords))


def _load(checkpoint: str | os.PathLike[str], policy: str | None) -> Any:
    folder = policy_folder(checkpoint, policy)
    for name in ("ray.rllib", "ray._common.deprecation"):
        logging.getLogger(name).setLevel(logging.ERROR)
    return build_module(read_weights(folder), str(folder))
