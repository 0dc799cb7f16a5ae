"""Deep merge of mappings: a variant is a base plus the differences from it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from safe_inspect.config.loading.located import REPLACED, LocatedDict, LocatedList, Removal, locate, marked, with_marks
from safe_inspect.errors import ConfigError, Location, Problem, did_you_mean

#: Suffix of a key whose list is appended.
APPEND = "+"
#: The keys with the class of a list's item, or its controller or sensor; of a dotted name the last part counts.
_CLASS_KEYS = ("functor", "type", "part", "controller", "sensor")


def merge(items: Any) -> LocatedDict:
    """Merge a list of mappings from left to right; a single mapping is returned as it is.

    An item that is a list itself, such as an included file, is merged first. An empty item, such as an anchor without a
    value, is ignored. Mappings are merged key by key to any depth; for all other values, including lists, the later
    value replaces the earlier one. A key with the suffix ``+`` appends its list to the list of the key without it:
    ``rewards+`` adds to ``rewards``. A mapping over a list of named items is merged into the items that its keys name,
    by ``name``, class, controller or sensor. The value ``!remove`` removes a key or an item. Locations are those of the
    values in the result. Nothing is changed in place.

    Raises:
        ConfigError: An item is not a mapping, a list is appended to something else, or a key matches no item.
    """
    if isinstance(items, Mapping):
        return _located(items)
    if not isinstance(items, (list, tuple)):
        location = locate(items, ())
        raise ConfigError(Problem(f"expected a mapping or a list of mappings, got {items!r}", location=location))
    problems = [
        Problem(f"item {index} of a merged list must be a mapping, not {item!r}", location=locate(items, (index,)))
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
    problems: list[Problem] = []
    for key, value in second.items():
        try:
            _merge_key(merged, key, value, locate(second, (key,)), getattr(second, "marks", {}).get(key))
        except ConfigError as error:
            problems += error.problems
    if problems:
        raise ConfigError(problems)
    return merged


def _merge_key(merged: LocatedDict, key: Any, value: Any, location: Location | None, mark: Location | None) -> None:
    """Merge the value of a key into a mapping, in place."""
    if isinstance(key, str) and key.endswith(APPEND):
        append(merged, key.removesuffix(APPEND), value, location)
        return
    if key == "config" and isinstance(value, Mapping):
        _refuse_to_append_to_references(merged.get("references"), value)
    if isinstance(value, Removal):
        if key not in merged:
            hint = did_you_mean(str(key), merged)
            raise ConfigError(Problem("there is no such key to remove", str(key), mark, hint))
        del merged[key]
        return
    merged[key] = _over(merged.get(key), value)
    merged.marks.pop(key, None)  # so that the newest key comes last
    if mark is not None:
        merged.marks[key] = mark


def _over(old: Any, value: Any) -> Any:
    """Return the result of a value that overrides an older one."""
    if isinstance(value, Mapping) and isinstance(old, Mapping):
        return _pair(old, value)
    if isinstance(value, Mapping) and isinstance(old, list) and old and all(map(_has_name, old)):
        problems: list[Problem] = []
        for key in value:
            try:
                old = _with_item(old, str(key), value[key], locate(value, (key,)))
            except ConfigError as error:
                problems += error.problems
        if problems:
            raise ConfigError(problems)
        return old
    if isinstance(value, LocatedList) and isinstance(old, list) and old and (before := locate(old, ())) is not None:
        value = value.copy()
        value.marks[REPLACED] = before
    return value


def _with_item(items: list[Any], name: str, value: Any, location: Location | None) -> LocatedList:
    """Return a list of named items in which a value overrides or removes the item of a name."""
    found = items_named(items, name) or [index for index, item in enumerate(items) if item == name]
    if len(found) != 1:
        known = {other for item in items for other in (names_of(item) or [str(item)])}
        text, hint = f"the list has no item named {name!r}", did_you_mean(name, known)
        if name in ("functor", "part", "config"):
            hint = "a mapping changes items by their names; to add one, write `KEY+:` and a list"
        if found:
            text, hint = f"{len(found)} items of the list are named {name!r}", "give them unique names"
        raise ConfigError(Problem(text, location=location, hint=hint))
    pairs = marked(items)
    item, mark = pairs[found[0]]
    where = mark if isinstance(value, Mapping) else location
    over = [] if isinstance(value, Removal) else [(_over(item, value), where)]
    return with_marks([*pairs[: found[0]], *over, *pairs[found[0] + 1 :]], getattr(items, "location", None))


def items_named(items: list[Any], name: str) -> list[int]:
    """Return the indices of the items with a name: a name from the user, otherwise that of a class."""
    given = [index for index, item in enumerate(items) if name in _given_names(item)]
    return given or [index for index, item in enumerate(items) if name in _class_names(item)]


def _has_name(item: Any) -> bool:
    return isinstance(item, str) or bool(names_of(item))


def names_of(item: Any) -> list[str]:
    """Return all names of an item of a list."""
    return [*_given_names(item), *_class_names(item)]


def _given_names(item: Any) -> list[str]:
    """Return the names that the user gave to an item of a list."""
    if isinstance(item, list):
        return [item[0]] if item and isinstance(item[0], str) else []
    return [source["name"] for source in _sources(item) if isinstance(source.get("name"), str)]


def _class_names(item: Any) -> list[str]:
    """Return the names of an item's class, and of its controller or sensor."""
    texts = [source[key] for source in _sources(item) for key in _CLASS_KEYS if key in source]
    return [text.rpartition(".")[2] for text in texts if isinstance(text, str)]


def _sources(item: Any) -> list[Mapping[Any, Any]]:
    """Return the mappings that can name an item: itself and its `config`."""
    if not isinstance(item, Mapping):
        return []
    return [source for source in (item, item.get("config")) if isinstance(source, Mapping)]


def append(merged: LocatedDict, key: str, items: Any, location: Location | None) -> None:
    """Append a list to the one of a key, in place.

    Raises:
        ConfigError: There is no such list, or what is appended is not a list.
    """
    if key not in merged:
        hint = did_you_mean(key, _lists(merged))
        raise ConfigError(Problem(f"there is no list `{key}` to append to", key + APPEND, location, hint))
    base = merged.get(key)
    for value, what in ((items, f"`{key}{APPEND}`"), (base, f"`{key}`, to which it appends,")):
        if not isinstance(value, list):
            raise ConfigError(Problem(f"{what} must be a list, not {value!r}", key + APPEND, location))
    assert isinstance(base, list)
    merged[key] = with_marks([*marked(base), *marked(items)], getattr(base, "location", None))
    if location is not None:
        merged.marks.pop(key, None)  # so that the newest key comes last
        merged.marks[key] = location


def _refuse_to_append_to_references(references: Any, config: Mapping[Any, Any]) -> None:
    """Raise a `ConfigError` if a functor's `config` appends to a list that its `references` take from the store."""
    for key in config:
        field = str(key).removesuffix(APPEND)
        if field != key and isinstance(references, Mapping) and field in references:
            hint = f"append to the list itself: `reference_store: {{{references[field]}+: [...]}}`"
            raise ConfigError(Problem(f"`{field}` is given by a reference", str(key), locate(config, (key,)), hint))


def _lists(mapping: Mapping[Any, Any]) -> list[str]:
    """Return the names of the lists in a mapping and in the mappings that it contains."""
    found = [str(key) for key, value in mapping.items() if isinstance(value, list)]
    return found + [name for value in mapping.values() if isinstance(value, Mapping) for name in _lists(value)]


def _located(mapping: Mapping[Any, Any]) -> LocatedDict:
    return mapping if isinstance(mapping, LocatedDict) else LocatedDict(mapping)
