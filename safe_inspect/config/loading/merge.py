"""Deep merge of mappings: a variant is a base and what differs from it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from safe_inspect.config.loading.located import LocatedDict, LocatedList, Removal, locate
from safe_inspect.errors import ConfigError, Location, Problem, did_you_mean

#: What a key ends in whose list is appended.
APPEND = "+"


def merge(items: Any) -> LocatedDict:
    """Merge a list of mappings from left to right; a single mapping is itself.

    An item that is a list itself, such as an included file, is merged first. An empty item, such as an anchor without a
    value, adds nothing.
    Mappings merge key by key to any depth; of everything else, lists included,
    the later value wins. A key that ends in ``+`` appends its list to the list
    of the key without it: ``rewards+`` adds to ``rewards``. The value ``!remove``
    leaves a key out. Marks follow the
    winning value. Nothing is changed in place.

    Raises:
        ConfigError: An item is no mapping, or a list is appended to something else.
    """
    if isinstance(items, Mapping):
        return _located(items)
    if not isinstance(items, (list, tuple)):
        location = locate(items, ())
        raise ConfigError(Problem(f"a mapping or a list of mappings is wanted here, got {items!r}", location=location))
    problems = [
        Problem(f"item {index} of a list to be merged is no mapping but {item!r}", location=locate(items, (index,)))
        for index, item in enumerate(items)
        if item is not None and not isinstance(item, (Mapping, list, tuple))
    ]
    if problems:
        raise ConfigError(problems)
    mappings = [merge(item) for item in items if item is not None]
    if len(mappings) == 1:
        return mappings[0]
    merged = LocatedDict()
    for item in mappings:
        merged = _pair(merged, item)
    merged.location = getattr(items, "location", None) or merged.location
    return merged


def _pair(first: Mapping[Any, Any], second: Mapping[Any, Any]) -> LocatedDict:
    merged = _located(first).copy()
    merged.location = getattr(second, "location", None) or merged.location
    marks = getattr(second, "marks", {})
    for key, value in second.items():
        if isinstance(key, str) and key.endswith(APPEND):
            _append(merged, key.removesuffix(APPEND), value, locate(second, (key,)))
            continue
        if isinstance(value, Removal):
            if key not in merged:
                hint = did_you_mean(str(key), merged)
                raise ConfigError(Problem("there is no such key to remove", str(key), marks.get(key), hint))
            del merged[key]
            merged.marks.pop(key, None)
            continue
        old = merged.get(key)
        merged[key] = _pair(old, value) if isinstance(old, Mapping) and isinstance(value, Mapping) else value
        merged.marks.pop(key, None)  # the newest comes last
        if key in marks:
            merged.marks[key] = marks[key]
    return merged


def _append(merged: LocatedDict, key: str, items: Any, location: Location | None) -> None:
    """Append a list to the one under a key."""
    base = merged.get(key)
    for value, what in ((items, f"`{key}{APPEND}`"), (base, f"`{key}`, to which it adds,")):
        if not isinstance(value, list):
            lists = [name for name, old in merged.items() if isinstance(old, list)]
            hint = "" if key in merged else did_you_mean(key, lists)
            raise ConfigError(Problem(f"{what} is no list but {value!r}", key + APPEND, location, hint))
    assert isinstance(base, list)
    marks = {index: mark for index in range(len(base)) if (mark := locate(base, (index,))) is not None}
    marks |= {len(base) + index: mark for index in range(len(items)) if (mark := locate(items, (index,))) is not None}
    merged[key] = LocatedList([*base, *items], marks, getattr(base, "location", None))


def _located(mapping: Mapping[Any, Any]) -> LocatedDict:
    return mapping if isinstance(mapping, LocatedDict) else LocatedDict(mapping)
