"""Overrides on the command line: ``key=value`` with a dotted path into the tree.

A component of the path is a key or, for the items of a list, an index (``list.0`` or ``list[0]``) or a name:
the item's ``name``, its class, or its controller or sensor. A path whose first component is not at the root is the
end of a path, which must match exactly one position. Components after the first may leave out ``config``. If no file
contains the last component, the path must match the one position that may contain it
(`safe_inspect.config.fields`); words of other libraries are not accepted as keys. ``~path`` removes a key or an
item.
"""

from __future__ import annotations

import re
import shlex
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from pydantic import BaseModel

from safe_inspect.config.fields import (
    in_plugin,
    known_keys,
    learning_keys,
    may_have,
    spellings,
    with_configs,
    with_empty_mappings,
)
from safe_inspect.config.keys.old_keys import OTHER_WORDS, key_hint
from safe_inspect.config.loading.loader import parse
from safe_inspect.config.loading.located import locate, marked, rewritten, value_at, with_marks, with_value
from safe_inspect.config.loading.merge import APPEND, append, items_named, names_of
from safe_inspect.config.models import ExperimentConfig
from safe_inspect.errors import ConfigError, Location, Problem

#: An index in the form of messages: ``agent_config[0].policy``.
_INDEX = re.compile(r"\[(\d+)\]")

Found = tuple[Any, ...]


def apply_overrides(tree: Any, overrides: Iterable[str], model: type[BaseModel] = ExperimentConfig) -> Any:
    """Override values of a tree by those of the command line, in the given order.

    Args:
        tree: A loaded configuration.
        overrides: Strings such as ``rllib_config.lr=1e-4`` or ``ObservedPointsReward.config.scale=0.02``;
            the value is YAML.
        model: The model of the configuration, with the keys that are permitted although no file contains them.

    Returns:
        A new tree; the given one is not changed.

    Raises:
        ConfigError: Overrides are malformed, or match no or several positions; all are listed.
    """
    problems: list[Problem] = []
    for override in overrides:
        if not isinstance(override, str):
            problems.append(Problem(f"overrides: {override!r:.60} is not a string", hint="write 'path.of.keys=value'"))
            continue
        location = Location("command line", 0, text=override)
        try:
            tree = _apply(tree, override, location, model)
        except ConfigError as error:
            problems += error.problems
    if problems:
        raise ConfigError(problems)
    return tree


def _apply(tree: Any, override: str, location: Location, model: type[BaseModel]) -> Any:
    removes = override.startswith("~")
    dotted, equals, text = override.removeprefix("~").partition("=")
    parts = _INDEX.sub(r".\1", dotted.strip()).split(".")
    if bool(equals) == removes or not all(parts):
        hint = "write it as `path.of.keys=value`, or as `~path.of.keys` to remove them"
        raise ConfigError(Problem("not an override", location=location, hint=hint))
    if not removes and not text.strip():  # often an unset variable of a shell, not a null that is meant
        hint = f"give a value, write `{dotted}=null`, or `~{dotted.removesuffix(APPEND)}` to remove it"
        raise ConfigError(Problem("the value is empty", location=location, hint=hint))
    parts = _with_platform(tree, parts)
    if parts[-1].endswith(APPEND) and not removes:
        return _appended(tree, parts, text, location, model)
    found = _existing(tree, parts)
    if len(parts) == 1:  # a reference is only the name of a key; the override is for its value
        found = [path for path in found if path[-2:-1] != ("references",)] or found
    if removes:
        if len(found) == 1:
            return _removed(tree, found[0])
    elif not found:
        if dotted in OTHER_WORDS and model is ExperimentConfig:
            hint = f"did you mean `{OTHER_WORDS[dotted]}={text}`?"
            raise ConfigError(Problem(f"`{dotted}` is not a key here", location=location, hint=hint))
        holders = _walk(tree, parts[:-1]) if parts[1:] else []
        found = [(*path, parts[-1]) for path in holders if isinstance(value_at(tree, path), Mapping)]
        found = found or _missing(tree, parts, model)
        if not found and parts[1:]:  # a mapping that no file gives: its other values keep their defaults
            places = [path for path in _missing(tree, parts[:-1], model) if value_at(tree, path) is None]
            found = [(*path, parts[-1]) for path in places]
        if len(found) == len(parts) == 1 and in_plugin(tree, found[0]):
            note = f"`{override}` sets {'.'.join(map(str, found[0]))}, which no file gives"
            warnings.warn(note, stacklevel=2)
    if len(found) == 1:
        return with_value(tree, found[0], parse(text, location), location)
    if found:
        raise ConfigError(_several(with_configs(with_empty_mappings(tree)), parts, found, text, location))
    raise ConfigError(_unknown(tree, parts, location, model))


def _appended(tree: Any, parts: list[str], text: str, location: Location, model: type[BaseModel]) -> Any:
    """Return the tree with more items at the end of a list."""
    whole = [*parts[:-1], parts[-1].removesuffix(APPEND)]
    lists = [path for path in _existing(tree, whole) if isinstance(value_at(tree, path), list)]
    if not lists:
        if stored := _stored(tree, whole):
            hint = f"write `reference_store.{stored}{APPEND}=...`"
            raise ConfigError(Problem(f"`{whole[-1]}` is given by a reference", location=location, hint=hint))
        problem = _unknown(tree, whole, location, model)
        raise ConfigError(replace(problem, hint=problem.hint.replace("=...", f"{APPEND}=...")))
    if len(lists) > 1:
        raise ConfigError(_several(tree, whole, lists, "", location))
    path = lists[0]
    holder = rewritten(value_at(tree, path[:-1]))
    append(holder, path[-1], parse(text, location), location)
    return with_value(tree, path[:-1], holder, None)


def _stored(tree: Any, parts: list[str]) -> str | None:
    """Return the key of the reference store from which the last component of a path is taken, or None."""
    for path in _existing(tree, parts[:-1]) if len(parts) > 1 else []:
        functor = value_at(tree, path[:-1] if path[-1] == "config" else path)
        references = functor.get("references") if isinstance(functor, Mapping) else None
        if isinstance(references, Mapping) and isinstance(references.get(parts[-1]), str):
            return str(references[parts[-1]])
    return None


def _several(tree: Any, parts: list[str], found: list[Found], text: str, location: Location) -> Problem:
    """Return the problem of a path with several matches; the hint lists an override of each if all values are equal."""
    names = [_shortest(tree, path, parts) for path in found[:12]]
    more = f" and {len(found) - 12} more" if len(found) > 12 else ""
    hint = f"write one of {', '.join(f'`{name}`' for name in names)}{more}"
    numbers = {_number(tree, path) for path in found}
    if not more and text and len(numbers) == 1 and None not in numbers:
        hint = f"all are {numbers.pop():g} now; to replace each, write {shlex.join(f'{name}={text}' for name in names)}"
    message = f"`{'.'.join(parts)}` fits {len(found)} places"
    return Problem(message, location=location, hint=hint, ambiguous=True)


def _existing(tree: Any, parts: list[str]) -> list[Found]:
    """Return every position in the tree that a path matches, from the root or as the end of a path."""
    if any(True for _ in _steps(tree, parts[0])):
        return _walk(tree, parts)
    return list(dict.fromkeys(path + end for path in _containers(tree) for end in _walk(value_at(tree, path), parts)))


def _shortest(tree: Any, path: Found, parts: list[str]) -> str:
    """Return the path from the innermost named item of a list if it is unique, otherwise the whole path."""
    for depth in range(len(path) - len(parts), 0, -1):
        holder = value_at(tree, path[:depth])
        for name in names_of(holder[path[depth]]) if isinstance(holder, list) else ():
            end = [name, *map(str, path[depth + 1 :])]
            if "." not in name and not any(part.isdecimal() for part in end) and _fits_alone(tree, end, path):
                return ".".join(end)
    return ".".join(map(str, path))


def _fits_alone(tree: Any, parts: list[str], path: Found) -> bool:
    """Return whether a path has one match; a key that no file has is matched by the mapping that may contain it."""
    found = _existing(tree, parts)
    return found == [path] if found else _existing(tree, parts[:-1]) == [path[:-1]]


def _missing(tree: Any, parts: list[str], model: type[BaseModel]) -> list[Found]:
    """Return every match of a path whose key no file has, or has by another of its names."""
    for name in spellings(parts[-1]):
        found = _existing(tree, [*parts[:-1], name])
        if found:
            return found
    filled = with_empty_mappings(tree)
    return _accepting(filled, parts, model) or _accepting(with_configs(filled), parts, model)


def _accepting(filled: Any, parts: list[str], model: type[BaseModel]) -> list[Found]:
    """Return the matches of a path whose last mapping is in a tree, if that mapping may have the key."""
    holders = [path for path in _containers(filled) if isinstance(value_at(filled, path), Mapping)]
    if len(parts) > 1:
        fitting = set(_existing(filled, parts[:-1]))
        holders = [path for path in holders if path in fitting or (path[-1:] == ("config",) and path[:-1] in fitting)]
    for name in spellings(parts[-1]):
        found = _existing(filled, [*parts[:-1], name])
        found = found or [(*path, name) for path in holders if may_have(filled, path, name, model)]
        if found:
            return found
    return []


def _with_platform(tree: Any, parts: list[str]) -> list[str]:
    """Return a path with the only compute platform inserted after `rllib_configs`, if it is missing."""
    for index, part in enumerate(parts[:-1]):
        for path in _existing(tree, ["rllib_configs"]) if part == "rllib_configs" else ():
            names = [str(name) for name in value_at(tree, path) or ()]
            if len(names) == 1 and parts[index + 1] not in names:
                return [*parts[: index + 1], *names, *parts[index + 1 :]]
    return parts


def _removed(tree: Any, path: Found) -> Any:
    """Return the tree without the value at a path."""
    holder = value_at(tree, path[:-1])
    if isinstance(holder, Mapping):
        rest = rewritten(holder)
        del rest[path[-1]]
        rest.marks.pop(path[-1], None)
    else:
        pairs = marked(holder)
        del pairs[path[-1]]
        rest = with_marks(pairs, getattr(holder, "location", None))
    return with_value(tree, path[:-1], rest, locate(tree, path[:-1]))


def _unknown(tree: Any, parts: list[str], location: Location, model: type[BaseModel]) -> Problem:
    """Return the problem of a path without a match: its first unknown component and similar names."""
    known: set[str] = set()
    if any(True for _ in _steps(tree, parts[0])):
        depth = next(count for count in range(len(parts) - 1, 0, -1) if _walk(tree, parts[:count]))
        holders = _walk(tree, parts[:depth])
    else:
        depth, ends = len(parts) - 1, _existing(tree, parts[:-1]) if parts[1:] else []
        holders = [path for path in ends if isinstance(value_at(tree, path), Mapping)]
        places = [*holders, *((*path, "config") for path in holders)]
        known = {key for path in places for key in known_keys(tree, path, model)}
    if holders:
        known = known.union(*(_names(value_at(tree, path)) for path in holders))
        message = f"there is no `{parts[depth]}` in `{'.'.join(parts[:depth])}`"
        hint = key_hint(parts[depth], known) if known else ""
        if parts[depth] in known:
            hint = "it is not given here; if a reference gives it, change it in the `reference_store`"
        if depth == len(parts) - 1 and len(only := _missing(tree, parts[-1:], model)) == 1:
            place = ".".join(map(str, only[0][:-1]))
            hint = f"the only `{parts[-1]}` is in {place}; if it is meant, write `{parts[-1]}=...`"
        return Problem(message if known else f"{message}, which contains no keys", "", location, hint)
    for path in _containers(tree):
        known |= _names(value_at(tree, path))
    first = next((part for part in parts if part not in known), None)
    known = known.union(learning_keys(tree), *(known_keys(tree, path, model) for path in _containers(tree)))
    if first is None:
        message = f"no path of the configuration ends in `{'.'.join(parts)}`"
        return Problem(message, "", location, "write it from the root")
    return Problem(f"there is no `{first}` in the configuration", "", location, key_hint(first, known))


def _walk(node: Any, parts: list[str], inner: bool = False) -> list[Found]:
    """Return all existing paths below a node that the components match; an inner one may leave out `config`."""
    if not parts:
        return [()]
    steps = list(_steps(node, parts[0]))
    if inner and not steps and isinstance(node, Mapping) and isinstance(node.get("config"), Mapping):
        return [("config", *path) for path in _walk(node["config"], parts, True)]
    return [step + rest for step in steps for rest in _walk(value_at(node, step), parts[1:], True)]


def _steps(node: Any, part: str) -> Iterator[Found]:
    """Yield the steps from a node that one component matches."""
    if isinstance(node, Mapping):
        yield from ((key,) for key in node if str(key) == part)
    elif isinstance(node, list):
        if part.isdecimal() and int(part) < len(node):
            yield (int(part),)
            return
        found = items_named(node, part)
        yield from ((index,) for index in found)
        if not found and node and isinstance(node[0], str):  # a record [name, ..., {...}]: look into its mappings
            for index, item in enumerate(node):
                if isinstance(item, Mapping):
                    yield from ((index, *step) for step in _steps(item, part))


def _names(node: Any) -> set[str]:
    """Return the names that can follow the path of a node."""
    if isinstance(node, Mapping):
        return {str(key) for key in node}
    names: set[str] = set()
    if isinstance(node, list):
        for item in node:
            names.update(names_of(item))
            if isinstance(item, Mapping) and isinstance(node[0], str):
                names |= _names(item)
    return names


def _containers(tree: Any, path: Found = ()) -> Iterator[Found]:
    """Yield the path of every mapping and list of a tree."""
    if isinstance(tree, (Mapping, list)):
        yield path
        items = tree.items() if isinstance(tree, Mapping) else enumerate(tree)
        for key, value in items:
            yield from _containers(value, (*path, key))


def _number(tree: Any, path: Found) -> float | None:
    """Return the number at a path, without its unit, or None if there is none."""
    try:
        return float(str(value_at(tree, path)).partition(" ")[0])
    except ValueError:
        return None
