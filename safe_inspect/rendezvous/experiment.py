"""`load_rendezvous`: from a file and overrides to a checked experiment; all mistakes are reported at once."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import yaml
from pydantic import ValidationError

from safe_inspect.config.loading.loader import load
from safe_inspect.config.loading.located import LocatedDict, locate, plain
from safe_inspect.config.loading.merge import merge
from safe_inspect.config.loading.overrides import apply_overrides
from safe_inspect.config.messages.report import problems_of
from safe_inspect.config.models.experiment import ExperimentConfig
from safe_inspect.errors import ConfigError, Problem
from safe_inspect.rendezvous.models import RendezvousConfig
from safe_inspect.version import __version__

#: Keys whose value may be a list of mappings, which are merged from left to right.
_MERGED = ("mission", "chaser")


@dataclass(frozen=True)
class Rendezvous:
    """A checked rendezvous experiment.

    Attributes:
        source: The file that it was loaded from.
        tree: The resolved configuration with the place of every value; loading it again gives the same experiment.
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
        path: The file.
        overrides: ``path.of.keys=value`` for each value that replaces one of the file's.

    Raises:
        ConfigError: With every mistake, each with its file, line and path of keys.
    """
    return build_rendezvous(apply_overrides(_mapping(load(path), path), overrides), os.fspath(path))


def is_rendezvous(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is that of a rendezvous: it names some of its parts, and none of an inspection's."""
    try:
        tree = load(path)
    except ConfigError:
        return False
    keys = set(tree) if isinstance(tree, LocatedDict) else set()
    return bool(keys & set(RendezvousConfig.model_fields) - {"seed"}) and not keys & set(ExperimentConfig.model_fields)


def build_rendezvous(tree: Any, source: str = "") -> Rendezvous:
    """Check a resolved configuration.

    Raises:
        ConfigError: With every mistake.
    """
    if not isinstance(tree, LocatedDict):
        tree = LocatedDict(tree)
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
                "no rendezvous experiment: it has the keys " + ", ".join(f"`{key}`" for key in sorted(known)),
                location=locate(tree, ()) if isinstance(tree, LocatedDict) else None,
                hint=f"give the experiment file, not {os.path.basename(path)!r}",
            )
        )
    merged = tree.copy()
    for key in _MERGED:
        if isinstance(tree.get(key), list):
            merged[key] = merge(tree[key])
    return merged
