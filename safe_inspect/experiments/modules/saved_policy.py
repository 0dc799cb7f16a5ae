"""`SavedPolicy`: an RLlib module that also saves its weights without pickle. Importing it loads Ray and Torch."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from pyarrow.fs import FileSystem, LocalFileSystem  # type: ignore[import-untyped]
from ray.rllib.core.rl_module.rl_module import RLModule

from safe_inspect.errors import CheckpointError
from safe_inspect.experiments.files.checkpoints import WEIGHTS
from safe_inspect.experiments.files.weights import pack
from safe_inspect.types import AnyArray


class SavedPolicy(RLModule):  # type: ignore[misc]
    """Base class of the package's policies, which adds a weights file (see `WEIGHTS`) to RLlib's files of a checkpoint.

    Attributes:
        flown_space: The action space of the task, if it differs from the module's; otherwise None.
    """

    flown_space: Any = None

    def save_to_path(
        self,
        path: str | Path | None = None,
        *,
        state: Mapping[str, Any] | None = None,
        filesystem: Any = None,
        use_msgpack: bool = False,
    ) -> str:
        """Save the module into a folder, as RLlib does, and its weights file too."""
        if path is not None and filesystem is None:
            filesystem, path = FileSystem.from_uri(str(path))
        more = {"state": state, "filesystem": filesystem, "use_msgpack": use_msgpack}
        saved: str = super().save_to_path(path, **more)
        if not self.inference_only:  # a runner's copy has no value function and is not saved
            content = pack(self, state or self.get_state())
            with (filesystem or LocalFileSystem()).open_output_stream(f"{saved}/{WEIGHTS}") as file:
                file.write(content)
        return saved


def load_arrays(module: Any, arrays: Mapping[str, AnyArray], title: str) -> None:
    """Load the arrays of a weights file into a module.

    Raises:
        CheckpointError: The arrays do not match the nets of the module.
    """
    try:
        module.load_state_dict({name: torch.as_tensor(value) for name, value in arrays.items()})
    except (RuntimeError, ValueError) as error:
        reason = str(error).strip().splitlines()[-1].strip()
        raise CheckpointError(f"{title}: its weights do not match this policy ({reason})") from None
