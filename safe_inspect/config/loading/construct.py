"""Conversion of YAML nodes to located containers: safe types, anchors, merge keys and the tags for includes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import date
from typing import Any

import yaml

from safe_inspect.config.loading.located import LocatedDict, LocatedList, Removal, marked, with_marks
from safe_inspect.config.loading.syntax import OTHER_BASE
from safe_inspect.errors import Location, Problem

_STANDARD = "tag:yaml.org,2002:"
_SAFE = yaml.constructor.SafeConstructor()
#: Function that constructs the value of each type of scalar; ``=`` and ``<<`` are strings where they are values.
_SCALARS: dict[str, Callable[[Any], Any]] = {
    f"{_STANDARD}{name}": getattr(_SAFE, f"construct_yaml_{name}")
    for name in ("str", "int", "float", "bool", "null", "timestamp", "binary")
} | dict.fromkeys((f"{_STANDARD}value", f"{_STANDARD}merge"), _SAFE.construct_yaml_str)

#: The tag of a list's item that is replaced by the items of a file.
_EXTEND = "!include-extend"

_KINDS = {"int": "whole number", "float": "number", "bool": "truth value", "timestamp": "date"}


@dataclass
class Constructor:
    """Builder of one document's tree, which collects the mistakes.

    Attributes:
        place: Function from a mark to its location.
        include: Function from the name of an included file and the location of the tag to the file's tree.
        problems: List to which mistakes are added; a wrong value becomes None.
    """

    place: Callable[[Any], Location]
    include: Callable[[str, Location], Any]
    problems: list[Problem]
    _built: dict[int, Any] = field(default_factory=dict)
    _open: set[int] = field(default_factory=set)

    def document(self, root: Any) -> Any:
        """Return the tree of a document."""
        try:
            return self.build(root)
        except RecursionError:
            return self._wrong(root, "the values are nested too deeply", "put a part of them into a separate file")

    def build(self, node: Any) -> Any:
        """Return the value of a node; an alias returns the same object as its anchor."""
        known = id(node)
        if known in self._built:
            return self._built[known]
        if known in self._open:
            return self._wrong(node, "an alias inside this value refers to the value itself", "write it out")
        self._open.add(known)
        value = self._construct(node)
        self._open.discard(known)
        self._built[known] = value
        return value

    def _construct(self, node: Any) -> Any:
        tag = node.tag
        if isinstance(node, yaml.ScalarNode):
            if tag == "!include":
                if not node.value.strip():
                    return self._wrong(node, "`!include` names no file", "write `!include FILE`")
                return self.include(node.value.strip(), self.place(node.start_mark))
            if tag == "!remove" and not node.value:
                return Removal()
            if tag in _SCALARS:
                return self._scalar(node)
        elif isinstance(node, yaml.MappingNode) and tag == f"{_STANDARD}map":
            return self._mapping(node)
        elif isinstance(node, yaml.SequenceNode) and tag == f"{_STANDARD}seq":
            return self._sequence(node)
        if tag in ("!include", _EXTEND):
            if tag == _EXTEND and isinstance(node, yaml.ScalarNode):
                return self._wrong(node, f"`{_EXTEND}` can only be an item of a list", "write it as an item of a list")
            return self._wrong(node, f"`{tag}` takes the name of one file", f"write `{tag} FILE`")
        shown = tag.replace(_STANDARD, "!!")
        if shown in ("!!map", "!!seq") or tag in _SCALARS:
            return self._wrong(node, f"the tag `{shown}` is not valid for the value after it", "remove it")
        hint = "the tags are `!include FILE`, in lists `!include-extend FILE`, and in merged mappings `!remove`"
        return self._wrong(node, f"unknown tag `{shown}`", hint)

    def _sequence(self, node: Any) -> LocatedList:
        pairs: list[tuple[Any, Location | None]] = []
        for item in node.value:
            if isinstance(item, yaml.ScalarNode) and item.tag == _EXTEND:
                more = self.include(item.value.strip(), self.place(item.start_mark)) if item.value.strip() else None
                if isinstance(more, LocatedList):
                    pairs += marked(more)
                elif more is not None or not item.value.strip():
                    self._wrong(item, f"`{_EXTEND}` needs a file that contains a list", "use `!include` for any other")
            else:
                pairs.append((self.build(item), self.place(item.start_mark)))
        return with_marks(pairs, self.place(node.start_mark))

    def _scalar(self, node: Any) -> Any:
        try:
            value = _SCALARS[node.tag](node)
            if isinstance(value, int | float) and OTHER_BASE.fullmatch(node.value):
                hint = f"write {value} if that is intended, or quote it"
                return self._wrong(node, f"YAML reads `{node.value}` as {value}", hint)
            return node.value if isinstance(value, date) else value  # JSON and resolved files have no dates
        except (ValueError, KeyError, OverflowError, yaml.YAMLError):
            kind = _KINDS.get(node.tag.removeprefix(_STANDARD), "value of that tag")
            return self._wrong(node, f"{node.value!r} is not a valid {kind}", "quote it if it is a string")

    def _mapping(self, node: Any) -> LocatedDict:
        tree = LocatedDict(location=self.place(node.start_mark))
        merged: list[Any] = []
        lines: dict[Any, int] = {}
        for key_node, value_node in node.value:
            merging = key_node.tag == f"{_STANDARD}merge"
            key = "<<" if merging else self.build(key_node)
            value = self.build(value_node)
            place = self.place(key_node.start_mark)
            try:
                first = lines.setdefault(key, place.line)
            except TypeError:
                self._wrong(key_node, "a list or a mapping cannot be a key", "quote it if it is a string")
                continue
            if key in tree or (merging and merged):
                hint = f"the first is in line {first}; remove one of them"
                self._wrong(key_node, f"the key `{key}` is given twice", hint)
            elif merging:
                merged = self._sources(value_node, value)
            else:
                tree[key] = value
                tree.marks[key] = place
        for source in merged:
            tree.update({key: value for key, value in source.items() if key not in tree})
            tree.marks |= {key: mark for key, mark in source.marks.items() if key not in tree.marks}
        return tree

    def _sources(self, node: Any, value: Any) -> list[LocatedDict]:
        sources = list(value) if isinstance(value, LocatedList) else [value]
        if not all(isinstance(source, LocatedDict) for source in sources):
            if value is not None:  # None is a null, or a mistake that was already reported
                self._wrong(node, "`<<` needs a mapping or a list of mappings", "give it an alias `*name` of one")
            return []
        return sources

    def _wrong(self, node: Any, message: str, hint: str) -> None:
        self.problems.append(Problem(message, location=self.place(node.start_mark), hint=hint))
