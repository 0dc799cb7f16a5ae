"""`FastPPOLearner`: updates of policies like those of RLlib's PPO learner, but on arrays.

RLlib's own learner builds each batch from the episodes step by step, uses dictionaries as minibatches and logs each of
them; for small nets this takes longer than the nets. This learner makes one `Batch` of arrays for each policy, and the
nets of the policy and the value function, if they share no parameters, learn from it in parallel (`NetTraining`).
Modules, optimisers, schedules, coefficients and checkpoints are RLlib's.
"""

from __future__ import annotations

import logging
import warnings
import zlib
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
import torch
from ray.rllib.algorithms.ppo.torch.ppo_torch_learner import PPOTorchLearner
from ray.rllib.core import ALL_MODULES, DEFAULT_MODULE_ID, Columns
from ray.rllib.utils import metrics as names

from safe_inspect.experiments.learning.ppo_kernels import Batch, Terms
from safe_inspect.experiments.learning.ppo_nets import NetTraining, joined, nets_of, part_of
from safe_inspect.experiments.modules.saved_policy import distribution_of_module
from safe_inspect.experiments.sampling.env_runners import set_threads
from safe_inspect.experiments.sampling.rollout import DECISION_STEPS
from safe_inspect.types import AnyArray, IntArray

#: Key in `learner_config_dict` of the number of nets that learn in parallel.
THREADS = "threads"
_LOGGER = logging.getLogger(__name__)
_ROWS_AT_ONCE = 1024


def batches_of(episodes: Iterable[Any], wanted: Callable[[str], bool]) -> dict[str, Batch]:
    """Return the batch of each policy.

    Args:
        episodes: RLlib's episodes, of one agent or of several, as arrays.
        wanted: Function that returns whether a policy learns.
    """
    found: dict[str, list[Any]] = {}
    for whole in episodes:
        for episode in whole.agent_episodes.values() if hasattr(whole, "agent_episodes") else (whole,):
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


def _batch(pieces: list[Any]) -> Batch:
    lengths = np.array([len(piece) for piece in pieces], dtype=np.int64)
    outputs = {
        key: [piece.extra_model_outputs[key] for piece in pieces if key in piece.extra_model_outputs]
        for key in (Columns.ACTION_DIST_INPUTS, Columns.ACTION_LOGP, DECISION_STEPS)
    }
    steps = outputs[DECISION_STEPS]
    return Batch(
        all_observations=_joined(piece.observations for piece in pieces),
        lengths=lengths,
        terminated=np.array([piece.is_terminated for piece in pieces], dtype=np.bool_),
        actions=_joined(piece.actions for piece in pieces),
        inputs=_joined(outputs[Columns.ACTION_DIST_INPUTS]),
        log_probabilities=_joined(outputs[Columns.ACTION_LOGP]),
        rewards=_joined(piece.rewards for piece in pieces),
        steps=np.concatenate([_data(buffer) for buffer in steps]) if steps else None,
    )


def _joined(buffers: Iterable[Any]) -> AnyArray:
    return np.ascontiguousarray(np.concatenate([_data(buffer) for buffer in buffers]), dtype=np.float32)


def _data(buffer: Any) -> AnyArray:
    """Return the data of one of RLlib's buffers without its lookback."""
    return np.asarray(buffer.data[buffer.lookback :])


class FastPPOLearner(PPOTorchLearner):  # type: ignore[misc]
    """RLlib's PPO learner on arrays, which `build_config` selects for the trainings that it supports.

    Attributes:
        why_autograd: For each policy that has learned, why autograd computes its gradients; see `Net`.
    """

    config: Any

    def build(self) -> None:
        """Build the modules and the optimisers, as RLlib does."""
        super().build()
        self.why_autograd: dict[str, str] = {}
        if self.config.num_learners:  # the learner runs in a separate process
            set_threads(self.config.env_config)

    def update(self, *arguments: Any, **keywords: Any) -> Any:
        """Learn from a batch; see RLlib's `Learner.update`."""
        data, episodes = keywords.get("training_data"), keywords.get("episodes") or ()
        if data is not None:
            data.validate()
            data.solve_refs()
            episodes = data.episodes
        batches = batches_of(episodes, self.should_module_be_updated)
        if not batches:
            return super().update(*arguments, **keywords)
        return self._learn(batches, sum(len(episode) for episode in episodes), **keywords)

    def _learn(
        self,
        batches: Mapping[str, Batch],
        steps: int,
        *,
        timesteps: dict[str, Any] | None = None,
        num_epochs: int = 1,
        minibatch_size: int | None = None,
        shuffle_batch_per_epoch: bool = False,
        _no_metrics_reduce: bool = False,
        **keywords: Any,
    ) -> Any:
        timesteps = timesteps or {}
        self.before_gradient_based_update(timesteps=timesteps)
        self._weights_seq_no += 1
        trainings: dict[str, list[NetTraining]] = {}
        for name, batch in batches.items():
            batch.advise(self._values(name, batch.all_observations), self.config.gamma, self.config.lambda_)
            seed = (int(self.config.seed or 0), name, self._weights_seq_no)
            order = minibatches(len(batch), minibatch_size, num_epochs, shuffle_batch_per_epoch, seed)
            trainings[name] = self._trainings(name, batch, order)
            self._log_steps(name, order)
        self._run([training for found in trainings.values() for training in found])
        for name, found in trainings.items():
            self._log_losses(name, found)
        reductions = {names.NUM_ENV_STEPS_TRAINED: "sum", names.NUM_ENV_STEPS_TRAINED_LIFETIME: "lifetime_sum"}
        for key, reduce in reductions.items():
            self.metrics.log_value((ALL_MODULES, key), steps * num_epochs, reduce=reduce, with_throughput=True)
        self.after_gradient_based_update(timesteps=timesteps)
        return None if _no_metrics_reduce else self.metrics.reduce()

    def _values(self, name: str, observations: AnyArray) -> AnyArray:
        """Return the values of observations before the update."""
        with torch.no_grad():
            *_, net = nets_of(self.module[name].unwrapped())
            parts = torch.split(torch.from_numpy(observations).to(net.parameters[0].device), _ROWS_AT_ONCE)
            ways = {len(part): net.make_pass(len(part)) for part in (parts[0], parts[-1])}
            found = [ways[len(part)].forward(part)[:, -1].cpu().numpy().copy() for part in parts]
        return np.concatenate(found)

    def _trainings(self, name: str, batch: Batch, order: IntArray) -> list[NetTraining]:
        config = self.config.get_config_for_module(name)
        terms = Terms(
            float(config.clip_param),
            float(config.vf_clip_param),
            float(config.vf_loss_coeff),
            float(self.entropy_coeff_schedulers_per_module[name].get_current_value()),
            float(self.curr_kl_coeffs_per_module[name]) if config.use_kl_loss else 0.0,
            bool(config.use_kl_loss),
        )
        clip = None
        if config.grad_clip:
            clip = partial(self._get_clip_function(), grad_clip=config.grad_clip, grad_clip_by=config.grad_clip_by)
        ((_, optimiser),) = self.get_optimizers_for_module(name)
        module: Any = self.module[name].unwrapped()
        distribution = distribution_of_module(module)
        nets = nets_of(module, clip is not None and config.grad_clip_by == "global_norm")
        self._log_path(name, next(filter(None, (net.why_autograd for net in nets)), ""))
        return [
            NetTraining(net, part_of(optimiser, net.parameters), batch, order, terms, clip, distribution)
            for net in nets
        ]

    def _log_path(self, name: str, reason: str) -> None:
        """Log how the gradients of a policy are computed, once for each policy."""
        if self.why_autograd.get(name) != reason:
            self.why_autograd[name] = reason
            how = f"Torch's autograd, because {reason}" if reason else "the gradients of its layers in closed form"
            _LOGGER.log(logging.WARNING if reason else logging.INFO, "%s learns by %s", name, how)

    def _run(self, trainings: list[NetTraining]) -> None:
        threads = min(int(self.config.learner_config_dict.get(THREADS, 1)), len(trainings))
        if threads < 2:
            for training in trainings:
                training.run()
            return
        # Each thread has its own setting of Torch's number of threads, which by default is that of the processors.
        own = torch.set_num_threads, (torch.get_num_threads(),)
        with ThreadPoolExecutor(threads, "learner", *own) as pool:
            for _ in pool.map(NetTraining.run, trainings):
                pass

    def _log_steps(self, name: str, order: IntArray) -> None:
        log = self.metrics.log_value
        log((name, names.WEIGHTS_SEQ_NO), self._weights_seq_no, window=1)
        log((name, names.MODULE_TRAIN_BATCH_SIZE_MEAN), order.shape[1], reduce="mean")
        log((name, names.NUM_MODULE_STEPS_TRAINED), order.size, reduce="sum")
        for owner in (name, ALL_MODULES):
            key = (owner, names.NUM_MODULE_STEPS_TRAINED_LIFETIME)
            log(key, order.size, reduce="lifetime_sum", with_throughput=True)
        log((ALL_MODULES, names.NUM_MODULE_STEPS_TRAINED), order.size, reduce="sum", with_throughput=True)

    def _log_losses(self, name: str, trainings: list[NetTraining]) -> None:
        losses = joined(trainings)
        if not all(np.isfinite(value) for value in losses.values()):
            warnings.warn(f"the losses of {name} are not finite: {losses}", stacklevel=2)
        self.metrics.log_dict(losses, key=name, window=1)
        norm = trainings[0].norm
        ((optimiser_name, optimiser),) = self.get_optimizers_for_module(name)
        if norm is None and self.config.get_config_for_module(name).log_gradients:
            gradients = [item.grad for item in optimiser.param_groups[0]["params"] if item.grad is not None]
            norm = torch.nn.utils.get_total_norm(gradients)
        if norm is not None:
            self.metrics.log_value((name, f"gradients_{optimiser_name}_global_norm"), float(norm), window=1)
