"""Checkpoints with a seal, which shows that they are complete and undamaged.

A process that is killed while Tune writes a checkpoint leaves a folder that looks like a checkpoint. So each complete
checkpoint gets a file with the sizes and checksums of all its files, and a checkpoint without that file, or with other
sizes or checksums, is not loaded.
"""

from __future__ import annotations

import hashlib
import json
import os
import zlib
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from safe_inspect.errors import CheckpointError, did_you_mean
from safe_inspect.experiments.files.run_folder import PARAMETERS, RunFolder, parameters_text, read_parameters
from safe_inspect.outputs import new_file

SEAL = "safe_inspect.json"

#: The folder of the policies in a checkpoint, which contains one folder for each policy.
MODULES = Path("learner_group", "learner", "rl_module")

#: The file of the weights in the folder of a policy, see `weights`. RLlib's own files in that folder are pickles, which
#: may run any code when they are loaded: only a resumed run reads them.
WEIGHTS = "policy.safetensors"


@dataclass(frozen=True)
class Checkpoint:
    """A complete checkpoint.

    Attributes:
        path: Its folder.
        iteration: The iteration after which it was saved.
        steps: Number of environment steps sampled up to that iteration.
        seconds: Training time up to that iteration [s].
        digest: Hash of the configuration, see `learning_configuration.digest`.
    """

    path: Path
    iteration: int
    steps: int = 0
    seconds: float = 0.0
    digest: str = ""


@dataclass
class FoundCheckpoint:
    """The newest complete checkpoint of a run, and the newer folders that were skipped.

    Attributes:
        newest: The checkpoint; None if there is none.
        refused: One sentence for each newer folder that is not a complete checkpoint of the run.
    """

    newest: Checkpoint | None = None
    refused: list[str] = field(default_factory=list)


def seal_checkpoint(checkpoint: Checkpoint) -> None:
    """Mark a checkpoint as complete by writing its seal."""
    content = {**asdict(checkpoint), "path": None, "files": _sums(checkpoint.path)}
    with new_file(checkpoint.path / SEAL) as work:
        work.write_text(json.dumps(content, indent=1), encoding="utf-8")


def read_checkpoint(path: str | os.PathLike[str]) -> Checkpoint:
    """Return a checkpoint after comparing all its files with its seal.

    Raises:
        CheckpointError: The checkpoint is missing, incomplete or damaged.
    """
    path = Path(path)
    if not path.is_dir():
        raise CheckpointError(f"{path}: there is no such checkpoint")
    try:
        seal: dict[str, Any] = json.loads((path / SEAL).read_text(encoding="utf-8"))
        checkpoint = Checkpoint(
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


def checkpoint_hash(checkpoint: Path) -> str:
    """Return the hash of a checkpoint's files, by name and content, without its seal."""
    found = hashlib.sha256()
    for path in sorted(checkpoint.rglob("*")):
        if path.is_file() and not path.name.startswith(SEAL):
            found.update(path.relative_to(checkpoint).as_posix().encode())
            found.update(path.read_bytes())
    return found.hexdigest()


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
    names = sorted(folder.name for folder in (read_checkpoint(path).path / MODULES).glob("*") if folder.is_dir())
    if not names:
        raise CheckpointError(f"{path}: the checkpoint contains no policy")
    return names


def weights_path(folder: Path) -> Path:
    """Return the file with the weights of a policy.

    Args:
        folder: Folder of the policy, from `policy_folder`.

    Raises:
        CheckpointError: The checkpoint has no such file.
    """
    path = folder / WEIGHTS
    if not path.is_file():
        checkpoint = folder.parents[len(MODULES.parts)]
        raise CheckpointError(
            f"{checkpoint}: the checkpoint contains the policy {folder.name!r} only as a pickle, which may run any "
            "code, so it is not loaded. It was written by an earlier version or by an algorithm other than PPO, APPO, "
            "IMPALA, SAC and DQN, or it is your own RLModule. Train again"
        )
    return path


def find_newest(folder: Path, digest: str = "") -> FoundCheckpoint:
    """Return the complete checkpoint with the highest iteration in `folder`, at any depth.

    Args:
        folder: The folder of a run or of a trial, or a folder inside it.
        digest: Hash of the configuration that the checkpoint must have; empty accepts any configuration.

    Raises:
        CheckpointError: The folder is that of a search with several trials.
    """
    _check_one_trial(folder)
    found = FoundCheckpoint()
    for path in sorted(folder.glob("**/checkpoint_*"), key=_order, reverse=True):
        if not path.is_dir():
            continue
        try:
            checkpoint = read_checkpoint(path)
        except CheckpointError as error:
            found.refused.append(str(error))
            continue
        if digest and checkpoint.digest != digest:
            found.refused.append(f"{path}: the checkpoint has another configuration")
            continue
        found.newest = checkpoint
        break
    return found


def _check_one_trial(folder: Path) -> None:
    """Raise CheckpointError for a folder with several trials, as its newest checkpoint could be that of any trial."""
    if (folder / PARAMETERS).is_file():
        return
    trials = sorted(path.parent for path in folder.glob(f"**/{PARAMETERS}"))
    if not trials:  # Tune's own folder, which contains a folder of one trial for each attempt if there is no search
        found = {path.parent.name: path.parent for path in sorted(folder.glob("**/checkpoint_*")) if path.is_dir()}
        trials = [found[name] for name in sorted(found)]
    if len(trials) < 2:
        return
    lines = [
        f"  {path}" + (f"  {parameters_text(read_parameters(path))}" if (path / PARAMETERS).is_file() else "")
        for path in trials
    ]
    raise CheckpointError(
        f"{folder}: this is a search with {len(trials)} trials; give the folder of one of them:\n" + "\n".join(lines)
    )


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
        raise CheckpointError(f"{path}: there is no such checkpoint")
    if (folder / SEAL).is_file() or folder.name.startswith("checkpoint_"):
        return folder
    if configuration_of(folder) is None:
        raise CheckpointError(
            f"{path}: this is neither a checkpoint nor the folder of a training run; give one of these"
        )
    found = find_newest(folder)
    if found.newest is None:
        why = found.refused[0] if found.refused else "wait for the first, or give another run"
        raise CheckpointError(f"{path}: the run has no complete checkpoint; {why}")
    return found.newest.path


def configuration_of(checkpoint: str | os.PathLike[str]) -> Path | None:
    """Return the file of the resolved configuration of a checkpoint's run; None if the checkpoint is not in a run."""
    path = Path(checkpoint).expanduser().absolute()
    for folder in (path, *path.parents):
        configuration = RunFolder(folder).configuration
        if configuration.is_file():
            return configuration
    return None
