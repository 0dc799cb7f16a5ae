from __future__ import annotations

import json
import re
from typing import Any, ClassVar

import pytest
from pydantic import BaseModel

from safe_inspect.config.schema import FILES, model_schema
from safe_inspect.plugins import Plugin
from safe_inspect.plugins.functor import functor_field
from safe_inspect.units import PositiveLength


class Kind(Plugin):
    """A kind of plugin for these tests."""

    kind: ClassVar[str] = "trial_schema"


class Inner(BaseModel):
    """A mapping inside a plugin, which may hold another."""

    depth: int = 0
    inner: Inner | None = None


class MeasuredTrial(Kind):
    """Measure a radius."""

    radius: PositiveLength
    inner: Inner = Inner()

    def __call__(self) -> float:
        return self.radius


class HoldingTrial(Kind):
    """Hold another plugin."""

    wrapped: functor_field("trial_schema")  # type: ignore[valid-type]

    def __call__(self) -> float:
        return 0.0


def functor_schemas(kind: str) -> dict[str, Any]:
    """Return the schema of the mapping of each plugin of a kind, by the plugin's name."""
    schema = model_schema(FILES["platform"])
    return {found["title"]: found for found in schema["$defs"][f"functor.{kind}"]["anyOf"]}


def test_every_plugin_of_the_kind_has_a_schema():
    assert list(functor_schemas("trial_schema")) == ["HoldingTrial", "MeasuredTrial"]


@pytest.mark.parametrize("file", FILES)
def test_every_reference_of_a_schema_is_defined(file: str) -> None:
    schema = model_schema(FILES[file])
    referenced = set(re.findall(r'"#/\$defs/([^"]+)"', json.dumps(schema)))
    assert referenced <= set(schema["$defs"])


def test_the_mapping_of_a_plugin():
    schema = functor_schemas("trial_schema")["MeasuredTrial"]
    assert schema["description"] == "Measure a radius."
    assert schema["required"] == ["functor"]
    assert schema["additionalProperties"] is False
    assert set(schema["properties"]) == {"functor", "name", "config", "references"}
    assert schema["properties"]["functor"]["anyOf"] == [{"const": "MeasuredTrial"}, {"pattern": r"\.MeasuredTrial$"}]


def test_fields_with_units_and_no_references_out_of_the_schema():
    schema = functor_schemas("trial_schema")["MeasuredTrial"]
    config = schema["properties"]["config"]
    assert config["additionalProperties"] is False
    assert config["properties"]["radius"]["units"] == "m"
    assert {option["type"] for option in config["properties"]["radius"]["anyOf"]} == {"number", "string", "object"}
    assert config["properties"]["inner"]["$ref"].startswith("#/$defs/")


def test_a_needed_field_may_come_from_a_reference():
    schema = functor_schemas("trial_schema")["MeasuredTrial"]
    assert schema["anyOf"] == [
        {"properties": {"config": {"required": ["radius"]}}, "required": ["config"]},
        {"required": ["references"]},
    ]


def test_what_is_wrapped_is_next_to_the_config():
    schema = functor_schemas("trial_schema")["HoldingTrial"]
    assert schema["required"] == ["functor", "wrapped"]
    assert schema["properties"]["wrapped"] == {"$ref": "#/$defs/functor.trial_schema"}
    assert "wrapped" not in schema["properties"]["config"].get("properties", {})
    assert "anyOf" not in schema
