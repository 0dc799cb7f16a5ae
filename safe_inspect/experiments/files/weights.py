"""The weights of a policy in a file without code: a safetensors file with further data as JSON in its header.

RLlib saves its modules as pickles. A pickle may run any code when it is loaded, so policies that are evaluated, and
trainings that start from a policy's weights, use this file instead. Its header contains strings: those of `PolicyInfo`,
if they are known, and ``net``, with the spaces and RLlib's `model_config`.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy
from gymnasium.spaces import Box, MultiDiscrete, Space
from safetensors import SafetensorError, safe_open

from safe_inspect.errors import CheckpointError, did_you_mean
from safe_inspect.evaluation.policy_file import POLICY_FORMAT, ObservedElement, PolicyInfo, difference_of
from safe_inspect.evaluation.shipped import shipped_policies, shipped_policy
from safe_inspect.experiments.files.checkpoints import newest_checkpoint, policy_folder, weights_path
from safe_inspect.types import AnyArray
from safe_inspect.version import __version__

#: Key of `model_config` for the metadata of `PolicyInfo`.
INFO = "policy_info"

#: Suffix of the name of the weights of a net's first layer; the name of its bias ends in "bias".
_FIRST = ".net.mlp.0.weight"

# Prefixes of the saved arrays; the target networks of APPO and DQN and the Q-functions of SAC are not saved.
_PARTS = ("encoder.", "pi_encoder.", "pi.", "af.", "vf.")


@dataclass(frozen=True)
class Weights:
    """Content of the weights file of a policy.

    Attributes:
        arrays: The weights, by the names of the module's parameters and buffers.
        observation_space: Observation space of the module.
        action_space: Action space of the module.
        model: RLlib's `model_config`, with the metadata of `PolicyInfo` under the key `INFO`.
    """

    arrays: Mapping[str, AnyArray]
    observation_space: Any
    action_space: Any
    model: Mapping[str, Any]

    @property
    def info(self) -> PolicyInfo | None:
        """The description of the policy; None if the checkpoint does not contain it."""
        return info_of(self.model)


def info_of(model: Mapping[str, Any]) -> PolicyInfo | None:
    """Return the description of a policy from its `model_config`; None if that does not contain it."""
    texts = model.get(INFO) or {}
    return PolicyInfo.of(texts) if "observation" in texts else None


def pack(module: Any, state: Mapping[str, Any]) -> bytes:
    """Return the bytes of the weights file of a module.

    Args:
        module: RLlib's module.
        state: The arrays of its state, by name.
    """
    model = dict(module.model_config)
    info = {"safe_inspect": __version__, "format": str(POLICY_FORMAT), **(model.pop(INFO, None) or {})}
    net = {
        "observation_space": _plain(module.observation_space),
        "action_space": _plain(getattr(module, "flown_space", None) or module.action_space),
        "model_config": model,
    }
    arrays = {name: np.asarray(value, order="C") for name, value in state.items() if name.startswith(_PARTS)}
    return safetensors.numpy.save(arrays, {**info, "net": json.dumps(net)})


def read_weights(folder: Path) -> Weights:
    """Return the content of the weights file of a policy.

    Args:
        folder: Folder of the policy, from `policy_folder`.

    Raises:
        CheckpointError: The file is missing, damaged or of another version.
    """
    path = weights_path(folder)
    try:
        with safe_open(path, framework="numpy") as file:
            texts: dict[str, str] = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        missing = {"format", "safe_inspect", "net"} - set(texts)
        if missing:
            texts_missing = ", ".join(f"`{name}`" for name in sorted(missing))
            raise CheckpointError(
                f"{path}: this is not a policy of safe_inspect: its header lacks {texts_missing}; give a checkpoint of "
                "`safe_inspect.train_rl`"
            )
        if texts["format"] != str(POLICY_FORMAT):
            raise CheckpointError(
                f"{path}: the weights were written by safe_inspect {texts['safe_inspect']}, whose format this version "
                "does not read; use that version, or train again"
            )
        net = json.loads(texts.pop("net"))
        model = {**net["model_config"], INFO: texts}
        info_of(model)  # checks the metadata now and not when it is first used
        return Weights(arrays, _space(net["observation_space"]), _space(net["action_space"]), model)
    except (SafetensorError, OSError, KeyError, TypeError, ValueError, AttributeError, AssertionError) as error:
        raise CheckpointError(f"{path}: the weights are damaged ({error}); use another checkpoint") from None


def initial_weights(source: str) -> Weights:
    """Return the initial weights of a policy.

    Args:
        source: Folder of a checkpoint with one policy, or of a run, whose newest checkpoint is used; or the name of a
            policy that the package ships.

    Raises:
        CheckpointError: The checkpoint is missing or damaged, or its weights cannot be read without running code.
    """
    shipped = shipped_policies()
    if source not in shipped and not Path(source).exists():
        raise CheckpointError(
            f"{source!r} is neither the folder of a checkpoint nor a policy that the package ships; "
            f"{did_you_mean(source, shipped)}"
        )
    folder = shipped_policy(source).checkpoint if source in shipped else newest_checkpoint(source)
    return read_weights(policy_folder(folder))


def starting_weights(source: str, model: Mapping[str, object]) -> Mapping[str, AnyArray]:
    """Return initial weights with which a new policy acts like an existing one.

    Elements of the observation are matched by their names. Where their normalisation differs, the first layers are
    converted exactly; elements that the existing policy does not observe get weights of zero.

    Args:
        source: Folder of a checkpoint with one policy, or the name of a policy that the package ships.
        model: RLlib's `model_config` of the new policy; if it contains no layout, the weights are not converted.

    Raises:
        CheckpointError: The weights cannot be read, the new policy does not observe an element that the existing policy
            observes, or its actions differ.
    """
    weights = initial_weights(source)
    theirs, mine = weights.info, info_of(model)
    if theirs is None or mine is None:
        return weights.arrays
    difference = difference_of(theirs.action, mine.action)
    if difference:
        raise CheckpointError(f"{source}: its weights do not match this policy: of the actions, {difference}")
    if theirs.observation == mine.observation:
        return weights.arrays
    places, gains, shifts = _converted(source, theirs, mine)
    arrays = dict(weights.arrays)
    for name in [name for name in arrays if name.startswith("encoder.") and name.endswith(_FIRST)]:
        layer, bias = arrays[name], f"{name.removesuffix('weight')}bias"
        wide = np.zeros((len(layer), len(mine.observation)), layer.dtype)
        wide[:, places] = layer * gains
        arrays[name] = wide
        arrays[bias] = (arrays[bias] + layer @ shifts).astype(layer.dtype)
    return arrays


def _converted(source: str, theirs: PolicyInfo, mine: PolicyInfo) -> tuple[list[int], AnyArray, AnyArray]:
    """Return the conversion between the observations of two policies.

    Returns:
        For each element of `theirs` its index in `mine`, and gains g and shifts s with theirs = g mine + s.
    """
    known = {key: place for place, key in enumerate(_keys(mine.observation))}
    places = []
    for key, element in zip(_keys(theirs.observation), theirs.observation, strict=True):
        found = known.get(key)
        if found is None or set(mine.observation[found].plugins) != set(element.plugins):
            raise CheckpointError(
                f"{source}: its weights do not match this policy, which does not observe {element} as that policy "
                "does; observe it too, or start from another policy"
            )
        places.append(found)
    seen = [mine.observation[place] for place in places]
    width = np.array([element.width for element in theirs.observation])
    gains = np.array([element.width for element in seen]) / width
    shifts = np.array([new.centre - old.centre for new, old in zip(seen, theirs.observation, strict=True)]) / width
    return places, gains, shifts


def _keys(elements: Sequence[ObservedElement]) -> list[tuple[str, str, int]]:
    """Return the name, the unit and the number of the occurrence of each element."""
    counts: Counter[str] = Counter()
    keys = []
    for element in elements:
        keys.append((element.name, element.unit.strip("-"), counts[element.name]))
        counts[element.name] += 1
    return keys


def _plain(space: Space[Any]) -> dict[str, Any]:
    if isinstance(space, MultiDiscrete):
        return {"choices": space.nvec.tolist()}
    assert isinstance(space, Box)
    return {"low": space.low.tolist(), "high": space.high.tolist()}


def _space(plain: Mapping[str, Any]) -> Space[Any]:
    if "choices" in plain:
        return MultiDiscrete([int(count) for count in plain["choices"]])
    low, high = (np.array(plain[side], dtype=np.float32) for side in ("low", "high"))
    return Box(low, high, dtype=np.float32)
