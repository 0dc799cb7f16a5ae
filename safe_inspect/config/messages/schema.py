"""JSON schemas of configuration files and plugins, for completion and checks in editors."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from safe_inspect.config.models.experiment import (
    AgentConfig,
    EnvironmentConfig,
    ExperimentConfig,
    PlatformConfig,
    PolicyConfig,
    TaskConfig,
)
from safe_inspect.plugins.functor import SCHEMA_KIND, name_key
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.plugins.registry import registry

#: The model of each kind of file.
FILES: dict[str, type[BaseModel]] = {
    "experiment": ExperimentConfig,
    "task": TaskConfig,
    "environment": EnvironmentConfig,
    "platform": PlatformConfig,
    "agent": AgentConfig,
    "policy": PolicyConfig,
}

_REFERENCE = "#/$defs/"


def model_schema(model: type[BaseModel]) -> dict[str, Any]:
    """Return the schema of a kind of file from its model, with the schemas of all registered plugins in ``$defs``."""
    schema = model.model_json_schema(mode="validation")
    definitions = schema.setdefault("$defs", {})
    for kind in registry.kinds():
        definitions[f"functor.{kind}"] = {"anyOf": list(functor_schemas(kind).values())}
    spelt: dict[str, Any] = _spell_out(schema)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **spelt}


def _spell_out(node: Any) -> Any:
    if isinstance(node, dict):
        if SCHEMA_KIND in node:
            return {"$ref": f"#/$defs/functor.{node[SCHEMA_KIND]}"}
        return {key: _spell_out(value) for key, value in node.items()}
    return [_spell_out(item) for item in node] if isinstance(node, list) else node


def functor_schemas(kind: str) -> dict[str, dict[str, Any]]:
    """Return the schema of the mapping of every registered plugin of a kind, by the plugin's name.

    Each schema is self-contained (without ``$defs``), so that ``{"anyOf": [*functor_schemas(kind).values()]}``
    can be put anywhere into a larger one.
    """
    return {name: _functor_schema(cls) for name, cls in registry.items(kind)}


def _functor_schema(cls: type[Plugin]) -> dict[str, Any]:
    """Return the schema of one plugin's mapping: its name, its fields with their units, and its wrapped plugins."""
    fields = _inlined(cls.model_json_schema(mode="validation"))
    needed = fields.pop("required", [])
    wrapped = fields["properties"].pop("wrapped", None) if "properties" in fields else None
    description = fields.pop("description", "")
    fields.pop("title", None)
    key = name_key(cls.kind)
    schema: dict[str, Any] = {
        "type": "object",
        "title": cls.registered_name,
        "description": description,
        "properties": {
            key: {"anyOf": [{"const": cls.registered_name}, {"pattern": rf"\.{cls.__name__}$"}]},
            "name": {"type": "string", "description": "The name in metrics and messages."},
            "config": fields,
            "references": {
                "type": "object",
                "description": "Fields whose values are in the agent's `reference_store`, with their keys there.",
                "additionalProperties": {"type": "string"},
            },
        },
        "required": [],
        "additionalProperties": False,
    }
    if key == "functor":
        schema["required"].append(key)
    else:
        schema["properties"]["functor"] = schema["properties"][key]
        schema["oneOf"] = [{"required": [key]}, {"required": ["functor"]}]
    if wrapped is not None:
        schema["properties"]["wrapped"] = wrapped
        if "wrapped" in needed:
            schema["required"].append("wrapped")
    needed = [field for field in needed if field != "wrapped"]
    if needed:  # a reference can replace a field of `config`
        given = {"properties": {"config": {"required": needed}}, "required": ["config"]}
        schema["anyOf"] = [given, {"required": ["references"]}]
    return schema


def _inlined(schema: dict[str, Any]) -> dict[str, Any]:
    """Return a schema with its definitions inserted where they are used."""
    definitions = schema.pop("$defs", {})

    def walk(node: Any, within: tuple[str, ...]) -> Any:
        if isinstance(node, list):
            return [walk(item, within) for item in node]
        if not isinstance(node, dict):
            return node
        target = node.get("$ref")
        if isinstance(target, str) and target.startswith(_REFERENCE):
            name = target.removeprefix(_REFERENCE)
            rest = {key: value for key, value in node.items() if key != "$ref"}
            if name in within:  # a model that contains itself
                return {"type": "object", **rest}
            return walk({**definitions[name], **rest}, (*within, name))
        return {key: walk(value, within) for key, value in node.items()}

    inlined: dict[str, Any] = walk(schema, ())
    return inlined
