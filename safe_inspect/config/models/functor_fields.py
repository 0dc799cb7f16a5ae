"""Field types of the experiment models: named functors, and parameters that may be plain numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, InstanceOf, WithJsonSchema

from safe_inspect.plugins.functor import SCHEMA_KIND, Named, build, functor_field
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators.resets.parameters import ConstantParameter


def named_field(kind: str) -> Any:
    """Return a field type for ``{name: ..., functor: ..., config: ...}``: the plugin with its name.

    The name is the registered name of the plugin unless given.
    """

    def convert(value: Any) -> Named[Plugin]:
        if isinstance(value, Named):
            return value
        plugin = build(kind, value)
        name = value.get("name") if isinstance(value, Mapping) else None
        return Named(str(name) if name else plugin.registered_name, plugin)

    return Annotated[
        InstanceOf[Named[Any]], BeforeValidator(convert), WithJsonSchema({"type": "object", SCHEMA_KIND: kind})
    ]


def _number(value: Any) -> Any:
    """Turn a plain number into a constant."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return ConstantParameter(value=value)
    return value


#: A reset parameter, or a plain number for a constant.
ParameterField: Any = Annotated[
    functor_field("parameter"),
    BeforeValidator(_number),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "object", SCHEMA_KIND: "parameter"}]}),
]
