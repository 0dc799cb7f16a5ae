"""Checkpoints with a seal, which shows that they are complete and undamaged.

A process that is killed while Tune writes a checkpoint leaves a folder that looks like a checkpoint. So each complete
checkpoint gets a file with the sizes and checksums of all its files, and a checkpoint without that file, or with other
sizes or checksums, is not loaded.

The weights of a policy are in a file without code: a safetensors file with further data as JSON in its header. RLlib
saves its modules as pickles. A pickle may run any code when it is loaded, so policies that are evaluated, and trainings
that start from a policy's weights, use this file instead. Its header contains strings: those of `PolicyInfo`, if they
are known, and ``net``, with the spaces and RLlib's `model_config`.
"""

from __future__ import annotations

import json
import os
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy
from gymnasium.spaces import Box, MultiDiscrete, Space
from safetensors import SafetensorError, safe_open

from safe_inspect.config.elements import ObservedElement, difference_of
from safe_inspect.config.spec import AgentSpec, PolicySpec
from safe_inspect.environments.layout import action_layout, observation_layout
from safe_inspect.errors import CheckpointError, did_you_mean
from safe_inspect.evaluation.policy_file import POLICY_FORMAT, PolicyInfo, check_layout
from safe_inspect.evaluation.shipped import shipped_policies, shipped_policy
from safe_inspect.experiments.modules.run_folder import PARAMETERS, RunFolder, parameters_text
from safe_inspect.outputs import new_file
from safe_inspect.types import AnyArray
from safe_inspect.version import __version__

SEAL = "safe_inspect.json"

#: The folder of the policies in a checkpoint, which contains one folder for each policy.
MODULES = Path("learner_group", "learner", "rl_module")

#: The file of the weights in the folder of a policy, see `Weights`. RLlib's own files in that folder are pickles, which
#: may run any code when they are loaded: only a resumed run reads them.
WEIGHTS = "policy.safetensors"

#: Key of `model_config` for the metadata of `PolicyInfo`.
INFO = "policy_info"
#: Key of RLlib's `model_config` that only SAC policies have: whether there are two Q-functions.
TWIN_Q = "twin_q"
#: This package's key in the `model_config` of DQN policies: the number of values of each element of the action.
CHOICES = "choices"
#: Suffix of the name of the weights of a net's first layer; the name of its bias ends in "bias".
_FIRST = ".net.mlp.0.weight"
# Prefixes of the saved arrays; the target networks of APPO and DQN and the Q-functions of SAC are not saved.
_PARTS = ("encoder.", "pi_encoder.", "pi.", "af.", "vf.")


@dataclass(frozen=True)
class Checkpoint:
    """A complete checkpoint.

    Attributes:
        path: Its folder.
        iteration: The iteration after which it was saved.
        steps: Number of environment steps sampled up to that iteration.
        seconds: Training time up to that iteration [s].
        digest: Hash of the configuration, see `run_folder.digest`.
    """

    path: Path
    iteration: int
    steps: int = 0
    seconds: float = 0.0
    digest: str = ""

    def seal(self) -> None:
        """Mark the checkpoint as complete by writing its seal."""
        content = {**asdict(self), "path": None, "files": _sums(self.path)}
        with new_file(self.path / SEAL) as work:
            work.write_text(json.dumps(content, indent=1), encoding="utf-8")

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Checkpoint:
        """Return a checkpoint after comparing all its files with its seal.

        Raises:
            CheckpointError: The checkpoint is missing, incomplete or damaged.
        """
        path = Path(path)
        if not path.is_dir():
            raise _missing(path)
        try:
            seal: dict[str, Any] = json.loads((path / SEAL).read_text(encoding="utf-8"))
            checkpoint = cls(
                path, int(seal["iteration"]), int(seal["steps"]), float(seal["seconds"]), str(seal["digest"])
            )
            expected: dict[str, list[int]] = seal["files"]
        except FileNotFoundError:
            raise CheckpointError(
                f"{path}: the checkpoint is incomplete, because saving it was interrupted; give an earlier one"
            ) from None
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise CheckpointError(f"{path}: the checkpoint's seal {SEAL} is damaged ({error})") from error
        found = _sums(path)
        for name in sorted(expected):
            if name not in found:
                raise CheckpointError(f"{path}: the checkpoint is damaged; {name} is missing")
            if found[name] != expected[name]:
                raise CheckpointError(f"{path}: the checkpoint is damaged; {name} is not what was saved")
        return checkpoint


def policy_folder(path: str | os.PathLike[str], policy: str | None = None, usual: str = "") -> Path:
    """Return the folder of a policy in a checkpoint.

    Args:
        path: The checkpoint.
        policy: Name of the policy; by default the only policy of the checkpoint, or the one named `usual`.
        usual: Name of the policy to use if the checkpoint contains several.

    Raises:
        CheckpointError: The checkpoint is missing, incomplete or damaged, or has no such policy.
    """
    names = policy_names(path)
    if policy is None:
        if len(names) != 1 and usual not in names:
            known = ", ".join(names)
            raise CheckpointError(f"{path}: the checkpoint has the policies {known}; name one of them with `policy`")
        policy = names[0] if len(names) == 1 else usual
    if policy not in names:
        raise CheckpointError(f"{path}: the checkpoint has no policy {policy!r}; {did_you_mean(policy, names)}")
    return Path(path).absolute() / MODULES / policy


def policy_names(path: str | os.PathLike[str]) -> list[str]:
    """Return the names of the policies of a checkpoint.

    Raises:
        CheckpointError: The checkpoint is missing, incomplete or damaged, or contains no policy.
    """
    names = sorted(folder.name for folder in (Checkpoint.read(path).path / MODULES).glob("*") if folder.is_dir())
    if not names:
        raise CheckpointError(f"{path}: the checkpoint contains no policy")
    return names


def find_newest(folder: Path, digest: str = "") -> tuple[Checkpoint | None, list[str]]:
    """Return the complete checkpoint with the highest iteration in `folder`, at any depth.

    Args:
        folder: The folder of a run or of a trial, or a folder inside it.
        digest: Hash of the configuration that the checkpoint must have; empty accepts any configuration.

    Returns:
        The checkpoint, None if there is none, and one sentence for each newer folder that was skipped because it is
        not a complete checkpoint of the run.

    Raises:
        CheckpointError: The folder is that of a search with several trials.
    """
    _check_one_trial(folder)
    refused: list[str] = []
    for path in sorted(folder.glob("**/checkpoint_*"), key=_order, reverse=True):
        if not path.is_dir():
            continue
        try:
            checkpoint = Checkpoint.read(path)
        except CheckpointError as error:
            refused.append(str(error))
            continue
        if not digest or checkpoint.digest == digest:
            return checkpoint, refused
        refused.append(f"{path}: the checkpoint has another configuration")
    return None, refused


def _check_one_trial(folder: Path) -> None:
    """Raise CheckpointError for a folder with several trials, as its newest checkpoint could be that of any trial."""
    trials = sorted(path.parent for path in folder.glob(f"**/{PARAMETERS}"))
    if len(trials) > 1:
        lines = "\n".join(f"  {path}  {parameters_text(RunFolder(path).read_parameters())}" for path in trials)
        text = f"this is a search with {len(trials)} trials; give the folder of one of them"
        raise CheckpointError(f"{folder}: {text}:\n{lines}")


def _order(path: Path) -> tuple[int, float, str]:
    """Return a sort key: the iteration; a folder without a readable seal counts as newest, as it may be the newest."""
    try:
        iteration = int(json.loads((path / SEAL).read_text(encoding="utf-8"))["iteration"])
    except (OSError, ValueError, KeyError, TypeError):
        return 2**62, path.stat().st_mtime, path.name
    return iteration, path.stat().st_mtime, path.name


def _sums(folder: Path) -> dict[str, list[int]]:
    files = sorted(path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(SEAL))
    return {path.relative_to(folder).as_posix(): [path.stat().st_size, zlib.crc32(path.read_bytes())] for path in files}


def _missing(path: Path) -> CheckpointError:
    is_file = "this is a file; give the folder of a checkpoint or of a training run"
    return CheckpointError(f"{path}: {is_file if path.exists() else 'there is no such checkpoint'}")


def newest_checkpoint(path: str | os.PathLike[str]) -> Path:
    """Return the folder of a checkpoint.

    Args:
        path: Folder of a checkpoint, or the folder of a run (or a folder inside it), whose newest complete checkpoint
            is used.

    Raises:
        CheckpointError: There is no such checkpoint.
    """
    folder = Path(path).expanduser()
    if not folder.is_dir():
        raise _missing(folder)
    if (folder / SEAL).is_file() or folder.name.startswith("checkpoint_"):
        return folder
    if configuration_of(folder) is None:
        raise CheckpointError(
            f"{path}: this is neither a checkpoint nor the folder of a training run; give one of these"
        )
    newest, refused = find_newest(folder)
    if newest is None:
        why = refused[0] if refused else "wait for the first, or give another run"
        raise CheckpointError(f"{path}: the run has no complete checkpoint; {why}")
    return newest.path


def configuration_of(checkpoint: str | os.PathLike[str]) -> Path | None:
    """Return the file of the resolved configuration of a checkpoint's run; None if the checkpoint is not in a run."""
    path = Path(checkpoint).expanduser().absolute()
    for folder in (path, *path.parents):
        configuration = RunFolder(folder).configuration
        if configuration.is_file():
            return configuration
    return None


def known_configuration(checkpoint: str | os.PathLike[str]) -> Path:
    """Return the file of the resolved configuration of a checkpoint's run; see `configuration_of`.

    Raises:
        CheckpointError: The checkpoint is not in a run.
    """
    found = configuration_of(checkpoint)
    if found is None:
        raise CheckpointError(
            f"{checkpoint}: the checkpoint is not in the folder of a training run, so its task is unknown; give the "
            "task with --cfg"
        )
    return found


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
        return _info_of(self.model)


def _info_of(model: Mapping[str, Any]) -> PolicyInfo | None:
    """Return the description of a policy from its `model_config`; None if that does not contain it."""
    texts = model.get(INFO) or {}
    return PolicyInfo.of(texts) if "observation" in texts else None


def known_info(model: Mapping[str, Any], title: str) -> PolicyInfo:
    """Return the description of a policy, see `Weights.info`.

    Raises:
        CheckpointError: There is none.
    """
    found = _info_of(model)
    if found is None:
        raise CheckpointError(
            f"{title}: the checkpoint does not describe its policy's observation and action, so it cannot be used; "
            "train again"
        )
    return found


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
    path = folder / WEIGHTS
    if not path.is_file():
        checkpoint = folder.parents[len(MODULES.parts)]
        raise CheckpointError(
            f"{checkpoint}: the checkpoint contains the policy {folder.name!r} only as a pickle, which may run any "
            "code, so it is not loaded. It was written by an earlier version, or it is your own RLModule. Train again"
        )
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
        _info_of(model)  # checks the metadata now and not when it is first used
        return Weights(arrays, _space(net["observation_space"]), _space(net["action_space"]), model)
    except (SafetensorError, OSError, KeyError, TypeError, ValueError, AttributeError, AssertionError) as error:
        raise CheckpointError(f"{path}: the weights are damaged ({error}); use another checkpoint") from None


def frozen_folder(policy: PolicySpec) -> Path:
    """Return the folder of a policy that is not trained, in its checkpoint; see `policy_folder` for the errors."""
    return policy_folder(policy.checkpoint or "", policy.source_policy, policy.name)


def check_frozen(policy: PolicySpec, agents: Mapping[str, AgentSpec]) -> None:
    """Check that the checkpoint of a policy that is not trained exists and matches its agents.

    Args:
        policy: The policy; one that is trained has no checkpoint to check.
        agents: The agents by name.

    Raises:
        CheckpointError: The checkpoint is missing, damaged or of another task.
    """
    if policy.trains:
        return
    weights = read_weights(frozen_folder(policy))
    if {CHOICES, TWIN_Q} & weights.model.keys():
        raise CheckpointError(
            f"{policy.checkpoint}: policies of SAC and DQN cannot be combined with policies that learn; give one of PPO"
        )
    for name in policy.agents:
        agent = agents[name]
        for what, space, layout in (
            ("observation", weights.observation_space, observation_layout(agent)),
            ("action", weights.action_space, action_layout(agent)),
        ):
            if space.shape != (layout.size,) or isinstance(space, MultiDiscrete) != bool(layout.choices):
                raise CheckpointError(
                    f"{policy.checkpoint}: the policy of {name} has {space.shape[0]} elements of {what}, but the "
                    f"agent has {layout.size}; give a checkpoint with the same glues"
                )
        if weights.info is not None:
            check_layout(str(policy.checkpoint), weights.info, replace(agent, name=name))


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
    theirs, mine = weights.info, _info_of(model)
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
