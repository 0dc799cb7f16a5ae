"""`load_rendezvous`: load an experiment file with overrides, check it, and report all mistakes at once."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError

from safe_inspect.config.loading.includes import places
from safe_inspect.config.loading.loader import import_plugins, load
from safe_inspect.config.loading.located import LocatedDict, LocatedList, locate, plain
from safe_inspect.config.loading.merge import merge
from safe_inspect.config.messages.report import problems_of
from safe_inspect.config.models.experiment import ExperimentConfig
from safe_inspect.config.models.fields import written_values
from safe_inspect.config.overrides import apply_overrides, with_value
from safe_inspect.errors import ConfigError, Location, Problem
from safe_inspect.rendezvous.models import RendezvousConfig
from safe_inspect.version import __version__

#: Keys whose value may be a list of mappings, which are then merged from left to right.
_MERGED = ("mission", "chaser")


@dataclass(frozen=True)
class Rendezvous:
    """A checked rendezvous experiment.

    Attributes:
        source: The file that it was loaded from.
        tree: The resolved configuration with the location of every value; loading it again gives the same experiment.
        config: The validated models.
    """

    source: str
    tree: LocatedDict
    config: RendezvousConfig

    @property
    def resolved(self) -> dict[str, Any]:
        """The resolved configuration as plain dictionaries, lists and values."""
        return dict(plain(self.tree))

    @property
    def text(self) -> str:
        """The resolved configuration as YAML."""
        dumped: str = yaml.safe_dump(self.resolved, sort_keys=False, width=120)
        return f"# Resolved from {self.source} by safe_inspect {__version__}\n{dumped}"


def load_rendezvous(path: str | os.PathLike[str], overrides: Iterable[str] = ()) -> Rendezvous:
    """Load and check an experiment file.

    Args:
        path: The experiment file.
        overrides: One ``path.of.keys=value`` for each value of the file to replace.

    Raises:
        ConfigError: The experiment is not valid; the error lists every mistake with its file, line and path of keys.
    """
    if isinstance(overrides, str):
        raise ConfigError(Problem("overrides must be a list of strings", hint=f"write [{overrides!r}]"))
    texts = list(overrides)
    tree = apply_overrides(_with_named(_mapping(load(path), path), texts), texts)
    return build_rendezvous(with_absolute_files(tree), os.fspath(path))


def with_absolute_files(tree: LocatedDict) -> LocatedDict:
    """Return a tree in which the names of the files that plugins read are absolute.

    A relative name is looked up next to the configuration file that contains it, then where an included file would be;
    a name from the command line is relative to the working directory. A stored configuration can therefore be loaded
    from any working directory.
    """
    import_plugins(tree, ("plugin_paths",))
    for path, value, _ in list(written_values("file", tree, RendezvousConfig)):
        if isinstance(value, str) and value:
            tree = with_value(tree, path, _absolute(value, locate(tree, path)), None)
    return tree


def _absolute(name: str, location: Location | None) -> str:
    own = Path(os.path.abspath(location.file)) if location is not None and location.line else None
    path = Path(name).expanduser()
    tried = [(Path.cwd() if own is None else own.parent) / path, *places(os.fspath(path), own, own)]
    return os.path.normpath(next((place for place in tried if place.exists()), tried[0]))


def _with_named(tree: LocatedDict, overrides: Iterable[str]) -> LocatedDict:
    """Return a tree with every top-level key that an override changes; keys missing in the file have their defaults."""
    heads = [text.partition("=")[0].partition(".")[0] for text in overrides]
    for name, info in RendezvousConfig.model_fields.items():
        if name in heads and name not in tree:
            default = info.default
            if isinstance(default, str):
                default = LocatedDict({"functor": default, "config": LocatedDict()})
            elif isinstance(default, (BaseModel, tuple)):
                default = LocatedDict() if isinstance(default, BaseModel) else LocatedList()
            tree = with_value(tree, (name,), default, None)
    return tree


def is_rendezvous(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is a rendezvous experiment: it has keys of one, and none of an inspection experiment."""
    try:
        tree = load(path)
    except ConfigError:
        return False
    keys = set(tree) if isinstance(tree, LocatedDict) else set()
    parts = set(RendezvousConfig.model_fields) - {"seed", "plugin_paths"}
    return bool(keys & parts) and not keys & set(ExperimentConfig.model_fields)


def build_rendezvous(tree: Any, source: str = "") -> Rendezvous:
    """Check a resolved configuration and return its experiment.

    Args:
        tree: The resolved configuration.
        source: Name of the file that it was loaded from.

    Raises:
        ConfigError: The configuration is not valid; the error lists every mistake.
    """
    if not isinstance(tree, Mapping):
        raise ConfigError(Problem(f"a configuration must be a mapping of keys to values, not {tree!r:.60}"))
    if not isinstance(tree, LocatedDict):
        tree = LocatedDict(tree)
    import_plugins(tree, ("plugin_paths",))
    try:
        config = RendezvousConfig.model_validate(tree)
    except ValidationError as error:
        raise ConfigError(problems_of(error, tree, model=RendezvousConfig)) from None
    return Rendezvous(source, tree, config)


def _mapping(tree: Any, path: str | os.PathLike[str]) -> LocatedDict:
    known = set(RendezvousConfig.model_fields)
    if not isinstance(tree, LocatedDict) or not known & set(tree):
        raise ConfigError(
            Problem(
                "not a rendezvous experiment: the file has none of the keys "
                + ", ".join(f"`{key}`" for key in sorted(known)),
                location=locate(tree, ()) if isinstance(tree, LocatedDict) else None,
                hint=f"give the experiment file, not {os.path.basename(path)!r}",
            )
        )
    merged = tree.copy()
    for key in _MERGED:
        if isinstance(tree.get(key), list):
            merged[key] = merge(tree[key])
    return merged
