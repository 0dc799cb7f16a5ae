"""The options of every plugin, file and command: names, defaults and ranges, one a line."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from typing import Any

from safe_inspect.cli.main import Parser, command_parser
from safe_inspect.config.schema import FILES, model_schema
from safe_inspect.plugins.registry import registry
from safe_inspect.policies.open_loop import OpenLoopPlan  # noqa: F401 - which no configuration names
from safe_inspect.rendezvous.experiment import RendezvousConfig

_WORDS = ("title", "description")
#: What a number with a unit may be written as.
_QUANTITY = [{"type": "number"}, {"type": "string"}, {"additionalProperties": True, "type": "object"}]


def lines() -> list[str]:
    """Return a line for each option: what it belongs to, its name, and its schema."""
    found, plugins, own = set(), set(), _own()
    for kind in registry.kinds():
        for name, plugin in registry.items(kind):
            package, room, *_ = *plugin.__module__.split("."), ""
            if package == "safe_inspect" and room != "testing":  # which contains further examples
                plugins.add(plugin.__name__)
                schema = plugin.model_json_schema()
                found |= set(_fields(f"{kind} {name}", schema))
                for part, inner in schema.get("$defs", {}).items():
                    found |= set(_fields(f"part {part}", inner))
    for file, model in {**FILES, "rendezvous": RendezvousConfig}.items():
        schema = model_schema(model)
        found |= set(_fields(f"file {file}", schema))
        for part in (schema.get("$defs", {}).keys() & own) - plugins:
            found |= set(_fields(f"part {part}", schema["$defs"][part]))
    return sorted(found | set(_arguments("", command_parser())))


def _own() -> set[str]:
    """Return the names in the package's modules; a process may have models of tests too."""
    modules = {name: module for name, module in sys.modules.items() if name.startswith("safe_inspect.")}
    return {own for name, module in modules.items() if ".testing" not in name for own in vars(module)}


def _arguments(command: str, parser: Parser) -> Iterator[str]:
    parser.load()
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, inner in action.choices.items():
                yield from _arguments(f"{command} {name}", inner)
            continue
        told = {
            "choices": None if action.choices is None else [str(choice) for choice in action.choices],
            "default": str(action.default), "nargs": action.nargs, "required": action.required,
            "type": getattr(action.type, "__name__", None), "metavar": action.metavar, "const": action.const,
            "kind": type(action).__name__.strip("_"),
        }  # fmt: skip
        known = {name: value for name, value in told.items() if value not in (None, False, "None")}
        yield f"command{command} {'/'.join(action.option_strings) or action.dest}: {json.dumps(known, sort_keys=True)}"


def _fields(owner: str, schema: dict[str, Any]) -> Iterator[str]:
    required = schema.get("required", [])
    for name, field in schema.get("properties", {}).items():
        mark = " (required)" if name in required else ""
        yield f"{owner}.{name}{mark}: {json.dumps(_plain(field), sort_keys=True)}"


def _plain(value: Any) -> Any:
    """Return a schema without the words for people."""
    if isinstance(value, dict) and value.get("anyOf") == _QUANTITY:
        return {"type": "quantity", **_plain({key: item for key, item in value.items() if key != "anyOf"})}
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items() if key not in _WORDS or not isinstance(item, str)}
    return [_plain(item) for item in value] if isinstance(value, list) else value
