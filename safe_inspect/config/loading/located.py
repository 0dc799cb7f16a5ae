"""Containers that store the location of each of their keys and items in the configuration files.

They are dicts and lists in all other respects. Code that transforms a configuration
creates new containers: a location belongs to a key or an index, and a list that is changed
in place would get wrong locations.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import yaml

from safe_inspect.errors import Location, Problem
from safe_inspect.version import __version__

#: The key of a list's `marks` with the location of the list that it replaced in a merge.
REPLACED = "replaced"

#: Path of a value in a tree: keys and indices.
KeyPath = Sequence[Any]


class _Located:
    """Common base of the two containers."""

    location: Location | None
    marks: dict[Any, Location]

    def __init__(
        self, items: Iterable[Any] = (), marks: Mapping[Any, Location] | None = None, location: Location | None = None
    ) -> None:
        super().__init__(items)  # type: ignore[call-arg]
        self.location = location
        self.marks = dict(marks or {})

    def copy(self) -> Self:
        """Return a shallow copy with the same locations."""
        return type(self)(self, self.marks, self.location)  # type: ignore[arg-type]

    __copy__ = copy


class LocatedDict(_Located, dict[Any, Any]):
    """A dict with its own location and that of each key.

    Attributes:
        location: Where the mapping begins.
        marks: Location of each key.
    """


class LocatedList(_Located, list[Any]):
    """A list with its own location and that of each item.

    Attributes:
        location: Where the list begins.
        marks: Location of each item, by index; and by `REPLACED` that of the list which this one replaced.
    """


class Removal:
    """The value of ``!remove``: a merge removes the key from the result."""

    def __repr__(self) -> str:
        return "`!remove`, which removes a key of an earlier mapping of a merged list"


def locate(tree: Any, path: KeyPath) -> Location | None:
    """Return the deepest known location on the path.

    The path is followed as far as it exists. The location of a key is where it is written, except
    for a container that an include reads from another file: its location is where it begins
    in that file, because that is the place to correct.
    """
    found: Location | None = getattr(tree, "location", None)
    for key in path:
        if not has(tree, key):
            break
        mark = getattr(tree, "marks", {}).get(key)
        tree = tree[key]
        found = mark or found
        own: Location | None = getattr(tree, "location", None)
        if own is not None and (found is None or own.file != found.file):
            found = own
    return found


def has(tree: Any, key: Any) -> bool:
    """Return whether the tree is a mapping with that key, or a list with that index."""
    if isinstance(tree, Mapping):
        return key in tree
    return isinstance(tree, list) and isinstance(key, int) and 0 <= key < len(tree)


def value_at(tree: Any, path: KeyPath) -> Any:
    """Return the value at a path of a tree; None if the path does not exist."""
    for key in path:
        tree = tree[key] if has(tree, key) else None
    return tree


def rewritten(source: Any, items: Any = None) -> Any:
    """Return a copy of a mapping or a list with its locations.

    Args:
        source: The mapping or list, with or without locations.
        items: The contents of the copy. Default: those of `source`.
    """
    kind = LocatedDict if isinstance(source, Mapping) else LocatedList
    found = source if items is None else items
    return kind(found, getattr(source, "marks", None), getattr(source, "location", None))


def with_marks(pairs: Iterable[tuple[Any, Location | None]], location: Location | None) -> LocatedList:
    """Return the list of some items, each with its location."""
    items = list(pairs)
    marks = {index: mark for index, (_, mark) in enumerate(items) if mark is not None}
    return LocatedList([item for item, _ in items], marks, location)


def marked(items: Sequence[Any]) -> list[tuple[Any, Location | None]]:
    """Return each item of a list with its location."""
    return [(item, locate(items, (index,))) for index, item in enumerate(items)]


def with_value(tree: Any, path: KeyPath, value: Any, location: Location | None) -> Any:
    """Return the tree with another value at a path; missing mappings are added, containers on the path are copied."""
    if not path:
        return value
    key, rest = path[0], path[1:]
    copied = rewritten(LocatedDict() if tree is None else tree)
    copied[key] = with_value(tree[key] if has(tree, key) else None, rest, value, location)
    if not rest and location is not None:
        copied.marks.pop(key, None)  # so that the newest key comes last
        copied.marks[key] = location
    return copied


def plain(tree: Any) -> Any:
    """Return the tree as plain dicts and lists, for writers of YAML and JSON."""
    if isinstance(tree, Mapping):
        return {key: plain(value) for key, value in tree.items()}
    if isinstance(tree, list):
        return [plain(value) for value in tree]
    return tree


def path_text(path: KeyPath) -> str:
    """Return a path as messages print it: ``rewards[0].config.scale``."""
    text = ""
    for key in path:
        if isinstance(key, int) and not isinstance(key, bool):
            text += f"[{key}]"
        else:
            text += f".{key}" if text else str(key)
    return text


@dataclass(frozen=True)
class Place:
    """A position in a configuration, at which mistakes are reported.

    Attributes:
        tree: The whole configuration, with the locations of its values.
        problems: List to which the mistakes are added.
        path: The path of the position.
    """

    tree: Any
    problems: list[Problem]
    path: tuple[Any, ...] = ()

    def at(self, *keys: Any) -> Place:
        """Return a position inside this one."""
        return Place(self.tree, self.problems, (*self.path, *keys))

    def report(self, message: str, *keys: Any, hint: str = "") -> None:
        """Report a mistake here, or at a position inside this one."""
        path = (*self.path, *keys)
        self.problems.append(Problem(message, path_text(path), locate(self.tree, path), hint))


@dataclass(frozen=True)
class ResolvedExperiment:
    """A resolved configuration.

    Attributes:
        source: The file from which it was loaded.
        tree: The whole resolved configuration with the location of every value: files are included, lists merged and
            overrides applied; references are still names. Loading it again results in the same experiment.
    """

    source: str
    tree: LocatedDict

    @property
    def resolved(self) -> dict[str, Any]:
        """The resolved configuration as plain dictionaries, lists and values."""
        return dict(plain(self.tree))

    @property
    def text(self) -> str:
        """The resolved configuration as YAML."""
        dumped: str = yaml.safe_dump(self.resolved, sort_keys=False, width=120)
        return f"# Resolved from {self.source} by safe_inspect {__version__}\n{dumped}"
