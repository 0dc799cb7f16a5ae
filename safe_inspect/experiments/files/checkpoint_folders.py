"""Search for the checkpoint that a path denotes, and for the run that contains it."""

from __future__ import annotations

import os
from pathlib import Path

from safe_inspect.errors import CheckpointError
from safe_inspect.experiments.files.checkpoints import SEAL, find_newest
from safe_inspect.experiments.files.run_folder import RunFolder


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
