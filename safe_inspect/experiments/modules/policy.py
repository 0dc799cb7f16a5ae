"""The policies of the package: new ones, those of checkpoints for RLlib, and trained ones as functions of observations.

Importing this module loads Ray and Torch.
"""

from __future__ import annotations

import dataclasses
import json
import logging
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tree  # type: ignore[import-untyped,import-not-found,unused-ignore]
from gymnasium.spaces import MultiDiscrete
from numpy.typing import NDArray
from ray.rllib.algorithms.ppo.torch.default_ppo_torch_rl_module import DefaultPPOTorchRLModule
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.rllib.core.rl_module.rl_module import RLModuleSpec

from safe_inspect.config.keys.rllib_keys import FRESH_KEYS
from safe_inspect.config.spec import PolicySpec
from safe_inspect.errors import CheckpointError, ConfigError, Problem
from safe_inspect.evaluation.policies import Flight, require_finite_rows
from safe_inspect.evaluation.shipped import shipped_policies
from safe_inspect.experiments.modules.checkpoints import (
    CHOICES,
    INFO,
    TWIN_Q,
    Weights,
    frozen_folder,
    policy_folder,
    read_weights,
    starting_weights,
)
from safe_inspect.experiments.modules.saved_policy import (
    COASTS,
    DQN_MODEL_KEYS,
    HURDLE,
    AppoPolicy,
    DqnPolicy,
    HurdleCatalog,
    SacPolicy,
    SavedPolicy,
    TorchHurdle,
    choices_of,
    distribution_of_module,
)
from safe_inspect.random.action_draws import NO_NOISE, Categorical, Hurdle, draw_choices, draw_in_rollout
from safe_inspect.types import AnyArray, BoolArray, FloatArray

_HIDDEN_GAIN = math.sqrt(2.0)
_POLICY_GAIN = 0.01

_SOURCE = "frozen_from"


class FreshPolicy(SavedPolicy, DefaultPPOTorchRLModule):  # type: ignore[misc]
    """RLlib's policy for PPO, whose `model_config` may also contain the keys of `FRESH_KEYS`.

    A new policy that thrusts at every step leaves the vicinity of the chief at once, and learns to save fuel before it
    has seen an inspection. The keys therefore set the initial behaviour:

    - ``initial_choice``: the choice that a new categorical policy prefers, usually coasting, with the probability
      ``initial_probability`` (default 0.9).
    - ``initial_std``: the standard deviation of a new Gaussian policy.
    - ``hurdle``: whether continuous thrust has a hurdle distribution, which burns with the probability
      ``initial_burn_probability`` (default 0.5) in a new policy. Decisions that last several steps always have it.
    - ``orthogonal``: whether to sample orthogonal weights with gain sqrt(2), and 0.01 in the last layer of the policy.
    - ``initial_weights``: the folder of a checkpoint with one policy, or the name of a policy that the package ships,
      with the same nets and actions, whose training is continued. So a team may start with the policy of one deputy.
      The new policy may observe more than that policy (see `starting_weights`).
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        catalog = kwargs.pop("catalog_class", None) or HurdleCatalog
        super().__init__(*args, **kwargs, catalog_class=catalog)  # type: ignore[no-untyped-call]

    def setup(self) -> None:
        """Build the nets and set their initial weights."""
        super().setup()  # type: ignore[no-untyped-call]
        own: Any = self.model_config
        chooses = isinstance(self.action_space, MultiDiscrete)
        with torch.no_grad():
            if own.get("orthogonal"):
                self._draw_orthogonal()
            if own.get("initial_choice") is not None and chooses:
                self._prefer(int(own["initial_choice"]), float(own.get("initial_probability", 0.9)))
            if own.get("initial_std") is not None and not chooses:
                _last(self.pi).bias[self.log_deviations()] = math.log(float(own["initial_std"]))
            if own.get(HURDLE) and not chooses:
                burns = float(own.get("initial_burn_probability", 0.5))
                _last(self.pi).bias[0] = math.log(burns / (1.0 - burns))
            if own.get("initial_weights"):
                if not self.inference_only:  # a runner gets its weights from the learner
                    self.load_arrays(starting_weights(own["initial_weights"], own), own["initial_weights"])
                # A checkpoint builds the module again with this config, when the source may no longer exist.
                self.model_config = {**own, "initial_weights": None}

    def log_deviations(self) -> slice:
        """Return the slice of the policy's outputs that are logarithms of standard deviations."""
        kind: Any = self.get_train_action_dist_cls()
        if issubclass(kind, TorchHurdle):
            return slice(1 + kind.numbers, 1 + 2 * kind.numbers)
        width = len(_last(self.pi).bias)
        return slice(width // 2, width)

    def _draw_orthogonal(self) -> None:
        for part in (self.encoder, self.pi, self.vf):
            for layer in part.modules():
                if isinstance(layer, torch.nn.Linear):
                    torch.nn.init.orthogonal_(layer.weight, _HIDDEN_GAIN)
                    torch.nn.init.zeros_(layer.bias)
        torch.nn.init.orthogonal_(_last(self.pi).weight, _POLICY_GAIN)
        torch.nn.init.orthogonal_(_last(self.vf).weight, 1.0)

    def _prefer(self, choice: int, probability: float) -> None:
        space: Any = self.action_space
        bias, first = _last(self.pi).bias, 0
        for size in space.nvec.tolist():
            if choice >= size:
                raise ValueError(f"`initial_choice` ({choice}) is beyond the last of {size} choices, {size - 1}")
            others = max(size - 1, 1)
            bias[first : first + size] = 0.0
            bias[first + choice] = math.log(probability * others / (1.0 - probability))
            first += size


def _last(head: torch.nn.Module) -> torch.nn.Linear:
    return [layer for layer in head.modules() if isinstance(layer, torch.nn.Linear)][-1]


def build_module(weights: Weights, title: str) -> FreshPolicy | SacPolicy | DqnPolicy:
    """Return the module that a weights file describes, with its weights.

    Args:
        weights: Content of the file.
        title: Name of the file in messages.

    Raises:
        CheckpointError: The file does not describe a module, or its weights do not match it.
    """
    known = {field.name for field in dataclasses.fields(DefaultModelConfig)} | FRESH_KEYS.keys()
    known |= {INFO, TWIN_Q, COASTS, *DQN_MODEL_KEYS}
    unknown = sorted(weights.model.keys() - known)
    if unknown:
        raise CheckpointError(f"{title}: the policy has the unknown setting `{unknown[0]}` of another version")
    try:
        kind: Any = SacPolicy if TWIN_Q in weights.model else DqnPolicy if CHOICES in weights.model else FreshPolicy
        module: FreshPolicy | SacPolicy | DqnPolicy = kind(
            observation_space=weights.observation_space,
            action_space=weights.action_space,
            model_config={**weights.model, "initial_weights": None},
            inference_only=kind is not FreshPolicy,
        )
    except Exception as error:  # RLlib raises many kinds of errors for invalid settings
        raise CheckpointError(f"{title}: the policy's settings are damaged ({error})") from None
    module.load_arrays(weights.arrays, title)
    return module


def _check_zero(elements: Iterable[Mapping[str, Any]]) -> None:
    """Check that an action of zeros commands no thrust, as a hurdle distribution requires.

    Raises:
        ConfigError: A controller commands another value.
    """
    for element in elements:
        if element["offset"] and not element["levels"]:
            given = f"{element['name']} gives {element['offset']:g} {element['unit']}"
            text = f"a hurdle policy coasts by actions of 0, for which {given}"
            hint = "give the controller limits that are symmetric about 0"
            raise ConfigError(Problem(text, "agent_config", hint=hint))


def policy_spec(
    model: Mapping[str, Any], algorithm: str = "PPO", info: Mapping[str, str] | None = None
) -> RLModuleSpec:
    """Return RLlib's specification of a policy that learns.

    Args:
        model: The keys of `model_config`.
        algorithm: Name of the algorithm.
        info: The metadata of the policy's `PolicyInfo`, for its checkpoints.

    Raises:
        CheckpointError: The `initial_weights` cannot be read.
    """
    info = dict(info or {})
    own = {key: value for key, value in model.items() if key in FRESH_KEYS}
    if info.get("distribution") == "hurdle":
        own |= {HURDLE: True, COASTS: len(json.loads(info["action"])[-1]["levels"])}
    elif own.get(HURDLE) and info.get("distribution") == "gaussian":
        info["distribution"] = "hurdle"
    if info.get("distribution") == "hurdle":
        _check_zero(json.loads(info["action"]))
    known = DefaultModelConfig(**{key: value for key, value in model.items() if key not in FRESH_KEYS})
    if own.get("initial_weights"):
        starting_weights(own["initial_weights"], {INFO: info})  # raises errors here and not in RLlib's processes
        if own["initial_weights"] not in shipped_policies():  # RLlib's processes have other working directories
            own["initial_weights"] = str(Path(own["initial_weights"]).absolute())
    settings = dataclasses.asdict(known)
    if algorithm != "DQN":
        settings |= {**({} if algorithm == "SAC" else own), INFO: info}
    elif info:
        settings |= {CHOICES: choices_of(info), INFO: {**info, "distribution": "greedy"}}
    kinds: dict[str, Any] = {"SAC": SacPolicy, "APPO": AppoPolicy, "DQN": DqnPolicy}
    return RLModuleSpec(module_class=kinds.get(algorithm, FreshPolicy), model_config=settings)


class FrozenPolicy(FreshPolicy):
    """RLlib's policy as it acts after its training: burns have no noise, and choices are sampled.

    ``frozen_from`` in its `model_config` is the folder of the policy in its checkpoint.
    """

    def setup(self) -> None:
        """Build the nets and load their weights."""
        super().setup()
        own: Any = self.model_config
        if own.get(_SOURCE) and not self.inference_only:  # a runner gets its weights from the learner
            self.load_arrays(read_weights(Path(own[_SOURCE])).arrays, own[_SOURCE])
        self.model_config = {key: value for key, value in own.items() if key != _SOURCE}

    def _forward_exploration(self, batch: dict[str, Any], **kwargs: Any) -> dict[str, Any]:
        outputs: dict[str, Any] = self._forward(batch)
        if not isinstance(self.action_space, MultiDiscrete):
            quiet = outputs[Columns.ACTION_DIST_INPUTS].clone()
            quiet[..., self.log_deviations()] = NO_NOISE
            outputs[Columns.ACTION_DIST_INPUTS] = quiet
        return outputs


def frozen_spec(policy: PolicySpec) -> RLModuleSpec:
    """Return RLlib's specification of a policy that is loaded from a checkpoint."""
    folder = frozen_folder(policy)
    weights = read_weights(folder)
    return RLModuleSpec(
        module_class=FrozenPolicy,
        observation_space=weights.observation_space,
        action_space=weights.action_space,
        model_config={**weights.model, "initial_weights": None, _SOURCE: str(folder)},
    )


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
            batch = {Columns.OBS: seen}
            if self.recurrent:
                if self._memory is None or self._rows != len(seen):
                    self._rows, self._memory = len(seen), _for_rows(self.module.get_initial_state(), len(seen))
                batch = {Columns.OBS: seen[:, None], Columns.STATE_IN: self._memory}  # one step of time
            outputs = self.module.forward_inference(batch)
            found, self._memory = outputs[Columns.ACTION_DIST_INPUTS], outputs.get(Columns.STATE_OUT)
        return np.asarray((found[:, 0] if self.recurrent else found).numpy())

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
    folder = policy_folder(checkpoint, policy)
    for name in ("ray.rllib", "ray._common.deprecation"):
        logging.getLogger(name).setLevel(logging.ERROR)
    return TrainedPolicy(build_module(read_weights(folder), str(folder)), sampled, seed)
