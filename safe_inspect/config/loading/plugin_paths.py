"""The modules of plugins that a configuration names, imported before any of its names is looked up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from safe_inspect.config.loading.located import KeyPath, locate, path_text
from safe_inspect.errors import ConfigError, Problem, RegistryError
from safe_inspect.plugins.registry import import_user_module


def import_plugins(tree: Any, where: KeyPath) -> None:
    """Import the modules of the list at a path of a tree; the peer's own are this package's already.

    Raises:
        ConfigError: With every module that is missing or cannot be imported.
    """
    paths: Any = tree
    for key in where:
        paths = paths.get(key) if isinstance(paths, Mapping) else None
    problems = []
    for index, name in enumerate(paths if isinstance(paths, list) else ()):
        if str(name).split(".")[0] in ("corl", "safe_autonomy_sims", "safe_autonomy_simulation"):
            continue
        try:
            import_user_module(str(name))
        except RegistryError as error:
            place = (*where, index)
            problems.append(Problem(str(error), path_text(place), locate(tree, place)))
    if problems:
        raise ConfigError(problems)
