"""Which checkpoint a path stands for, and the run in which it lies."""

from __future__ import annotations

import os
from pathlib import Path

from safe_inspect.errors import CheckpointError
from safe_inspect.experiments.files.checkpoints import SEAL, find_newest
from safe_inspect.experiments.files.run_folder import RunFolder


def newest_checkpoint(path: str | os.PathLike[str]) -> Path:
    """Return a checkpoint's folder; of a run's folder, or of one within it, the newest complete checkpoint.

    Raises:
        CheckpointError: There is none.
    """
    folder = Path(path).expanduser()
    if not folder.is_dir():
        raise CheckpointError(f"{path}: there is no such checkpoint")
    if (folder / SEAL).is_file() or folder.name.startswith("checkpoint_"):
        return folder
    if configuration_of(folder) is None:
        raise CheckpointError(
            f"{path}: this is neither a checkpoint nor the folder of a training run; give the folder of either"
        )
    found = find_newest(folder)
    if found.newest is None:
        why = found.refused[0] if found.refused else "wait for the first, or give another run"
        raise CheckpointError(f"{path}: the run has no complete checkpoint; {why}")
    return found.newest.path


def configuration_of(checkpoint: str | os.PathLike[str]) -> Path | None:
    """Return the resolved configuration of the run in which a checkpoint lies; None where it lies elsewhere."""
    path = Path(checkpoint).expanduser().absolute()
    for folder in (path, *path.parents):
        configuration = RunFolder(folder).configuration
        if configuration.is_file():
            return configuration
    return None
