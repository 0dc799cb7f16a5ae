"""JSON schemas of whole configuration files, for editors."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from safe_inspect.config.messages.schema import functor_schemas
from safe_inspect.config.models.experiment import (
    AgentConfig,
    EnvironmentConfig,
    ExperimentConfig,
    PlatformConfig,
    PolicyConfig,
    TaskConfig,
)
from safe_inspect.plugins.functor import SCHEMA_KIND
from safe_inspect.plugins.registry import registry

#: The model of every kind of file.
FILES: dict[str, type[BaseModel]] = {
    "experiment": ExperimentConfig,
    "task": TaskConfig,
    "environment": EnvironmentConfig,
    "platform": PlatformConfig,
    "agent": AgentConfig,
    "policy": PolicyConfig,
}


def file_schema(name: str) -> dict[str, Any]:
    """Return the schema of a kind of file, every registered plugin spelt out in ``$defs``.

    Args:
        name: One of `FILES`.
    """
    return model_schema(FILES[name])


def model_schema(model: type[BaseModel]) -> dict[str, Any]:
    """Return the schema of a file that a model describes, every registered plugin spelt out in ``$defs``."""
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
