"""Reading the known target of a sensor log from a file."""

from __future__ import annotations

import os
from pathlib import Path

from pydantic import ValidationError

from safe_inspect.config.loading.loader import load
from safe_inspect.config.loading.located import LocatedDict
from safe_inspect.config.messages.report import problems_of
from safe_inspect.errors import ConfigError
from safe_inspect.rendezvous.experiment import with_absolute_files
from safe_inspect.rendezvous.models import RendezvousConfig
from safe_inspect.rendezvous.plugins import MeshTarget
from safe_inspect.rendezvous.target.model import Target

_MESHES = (".stl", ".ply", ".obj")


def read_target(path: str | os.PathLike[str]) -> Target:
    """Read a target from a mesh of uniform density or from YAML with the key ``target``, such as an experiment.

    Raises:
        ConfigError: The file cannot be read, or has no target.
    """
    if Path(path).suffix.lower() in _MESHES:
        return MeshTarget(path=os.path.abspath(Path(path).expanduser()))()
    tree = load(path)
    if not isinstance(tree, LocatedDict) or "target" not in tree:
        raise ConfigError(
            f"{os.fspath(path)}: the file has no key `target`; give a rendezvous experiment, another YAML file with "
            "this key, or a mesh (.stl, .ply or .obj)"
        )
    part = with_absolute_files(
        LocatedDict({key: tree[key] for key in ("plugin_paths", "target") if key in tree}, tree.marks)
    )
    try:
        return RendezvousConfig.model_validate(part).target()  # type: ignore[no-any-return]
    except ValidationError as error:
        raise ConfigError(problems_of(error, tree, model=RendezvousConfig)) from None
