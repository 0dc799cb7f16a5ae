"""JSON schemas of configuration files and plugins, for completion and checks in editors."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from safe_inspect.config.models import (
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


def model_schema(model: type[BaseModel]) -> dict[str, Any]:
    """Return the schema of a kind of file from its model, with the schemas of all registered plugins in ``$defs``."""
    plugins = {kind: [cls for _, cls in registry.items(kind)] for kind in registry.kinds()}
    classes: list[type[BaseModel]] = [model, *(cls for found in plugins.values() for cls in found)]
    references, schema = models_json_schema([(cls, "validation") for cls in classes])
    definitions = schema["$defs"]
    named = {cls: str(reference["$ref"]).rpartition("/")[2] for (cls, _), reference in references.items()}
    for kind, found in plugins.items():
        definitions[f"functor.{kind}"] = {"anyOf": [_functor_schema(cls, definitions[named[cls]]) for cls in found]}
    own = definitions.pop(named[model])
    spelt: dict[str, Any] = _spell_out({**own, "$defs": definitions})
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **spelt}


def _spell_out(node: Any) -> Any:
    if isinstance(node, dict):
        if SCHEMA_KIND in node:
            return {"$ref": f"#/$defs/functor.{node[SCHEMA_KIND]}"}
        return {key: _spell_out(value) for key, value in node.items()}
    return [_spell_out(item) for item in node] if isinstance(node, list) else node


def _functor_schema(cls: type[Plugin], fields: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of one plugin's mapping: its name, its fields with their units, and its wrapped plugins.

    Args:
        cls: The class of the plugin.
        fields: The schema of its fields.
    """
    fields = {**fields, "properties": {**fields.get("properties", {})}}
    needed = fields.pop("required", [])
    wrapped = fields["properties"].pop("wrapped", None)
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
