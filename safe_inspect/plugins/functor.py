"""Functors: mappings ``{functor: NAME, name: ..., config: {...}}`` in a configuration that describe plugins.

`functor_field(kind)` returns a Pydantic field type that accepts such a mapping
(or a plugin that is already built) and validates to the plugin. Plugins may be
nested to any depth; each error has the full path of its key.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from functools import partial
from typing import Annotated, Any, Generic, TypeVar

from pydantic import BeforeValidator, PlainSerializer, ValidationError, WithJsonSchema
from pydantic.dataclasses import dataclass
from pydantic_core import PydanticCustomError

from safe_inspect.errors import RegistryError, did_you_mean
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.plugins.registry import cause_of, registry, with_article

#: The key of the plugin's name, for the kinds whose key is not ``functor``.
NAME_KEYS = {"part": "part", "parameter": "type", "simulator": "type", "platform": "platform_class"}

#: The key that marks a functor's kind in a JSON schema; `safe_inspect.config.schema` replaces the mark with
#: the full schema.
SCHEMA_KIND = "x-functor"

T = TypeVar("T")


@dataclass(frozen=True)
class Named(Generic[T]):
    """A functor with its name in metrics and messages."""

    name: str
    functor: T


def name_key(kind: str, given: Container[Any] = ()) -> str:
    """Return the key that contains the name of a plugin of that kind; ``functor`` may be given instead of any other."""
    key = NAME_KEYS.get(kind, "functor")
    return "functor" if "functor" in given and key not in given else key


def build(kind: str, value: Any) -> Plugin:
    """Build a plugin from its description.

    Args:
        kind: The expected kind.
        value: A mapping with the plugin's name, ``config`` and, for plugins that contain others, ``wrapped``;
            or the name alone; or a plugin of that kind.

    Raises:
        PydanticCustomError: The description is wrong. `errors_of` lists the errors inside it.
    """
    if isinstance(value, Plugin):
        if value.kind != kind:
            raise misplaced([((), f"expected {with_article(kind)}, got the {value.kind} {value.registered_name}")])
        return value
    is_name = isinstance(value, str)
    if is_name:
        value = {name_key(kind): value}
    if not isinstance(value, Mapping):
        raise misplaced(
            [((), f"{with_article(kind)} must be a mapping with the key `{name_key(kind)}`, not {value!r}")]
        )
    key = name_key(kind, value)
    known = {key, "name", "config", "wrapped"}
    problems = []
    cls: type[Plugin] | None = None
    if key not in value:
        problems.append(_problem((), f"{with_article(kind)} needs the key `{key}`, the name of its class"))
    elif not isinstance(value[key], str):
        problems.append(_problem((key,), f"the name of {with_article(kind)} must be a string, not {value[key]!r}"))
    else:
        try:
            cls = registry.get(kind, value[key])
        except RegistryError as error:
            problems.append(_problem(() if is_name else (key,), str(error)))
    unknown = []
    for other in (str(given) for given in value if given not in known):
        hint = did_you_mean(other, known | {"references"})
        if cls is not None and other in cls.model_fields:
            hint = f"it is a field of {cls.registered_name}: write `config: {{{other}: ...}}`"
        unknown.append(_problem((other,), f"unknown key; {hint}"))
    problems = unknown + problems
    config = value.get("config") or {}
    if not isinstance(config, Mapping):
        problems.append(_problem(("config",), f"`config` must be a mapping of the {kind}'s fields, not {config!r}"))
        config, cls = {}, None
    plugin: Plugin | None = None
    if cls is not None:
        fields = dict(config)
        takes_name = "name" in value and "name" in cls.model_fields
        if takes_name and fields.setdefault("name", value["name"]) != value["name"]:
            problems.append(_problem(("name",), f"`config` has another name, {fields['name']!r}; remove one of them"))
        if "wrapped" in value:
            if "wrapped" in cls.model_fields:
                fields["wrapped"] = value["wrapped"]
            else:
                problems.append(_problem(("wrapped",), f"{cls.registered_name} takes no `wrapped`; remove the key"))
        try:
            plugin = cls.model_validate(fields)
        except ValidationError as error:
            problems += [_located(problem, cls) for problem in errors_of(error)]
        except (Exception, SystemExit) as error:  # raised by a plugin's code; Pydantic's own errors are handled above
            problems.append(_problem((), f"{cls.registered_name} cannot be built: {cause_of(error)}"))
    if problems or plugin is None:
        raise PydanticCustomError("functor", "the functor is wrong", {"errors": problems})
    return plugin


def misplaced(problems: Iterable[tuple[tuple[int | str, ...], str]]) -> PydanticCustomError:
    """Return an error for a validator that knows which fields are wrong, with each message at the path of its field.

    Args:
        problems: The path of each mistake, relative to the model that is validated, and its message.
    """
    problems = list(problems)
    text = "; ".join(said for _, said in problems).replace("{", "{{").replace("}", "}}")
    return PydanticCustomError("functor", text, {"errors": [_problem(place, said) for place, said in problems]})  # type: ignore[arg-type]


def describe(plugin: Plugin) -> dict[str, Any]:
    """Return the mapping from which `build` creates the plugin."""
    config = plugin.model_dump(mode="json")
    wrapped = config.pop("wrapped", None)
    mapping: dict[str, Any] = {name_key(plugin.kind): plugin.registered_name, "config": config}
    if wrapped is not None:
        mapping["wrapped"] = wrapped
    return mapping


def errors_of(error: ValidationError) -> list[dict[str, Any]]:
    """Return all errors, including those inside functors, each with its full path (``loc``)."""
    return list(_unfold(error.errors(include_url=False), ()))


def functor_field(kind: str) -> Any:
    """Return a field type for one plugin of that kind."""
    return Annotated[
        Plugin,
        BeforeValidator(partial(build, kind), json_schema_input_type=dict[str, Any]),
        PlainSerializer(describe, return_type=dict[str, Any]),
        WithJsonSchema({"type": "object", SCHEMA_KIND: kind}),
    ]


def functors_field(kind: str) -> Any:
    """Return a field type for a tuple of plugins of that kind, which a configuration gives as one, a list, or null."""

    def convert(value: Any) -> Any:
        if value is None:
            return ()
        return value if isinstance(value, list | tuple) else (build(kind, value),)

    def dump(plugins: tuple[Plugin, ...]) -> Any:
        described = [describe(plugin) for plugin in plugins]
        return described if len(described) > 1 else next(iter(described), None)

    element, one = functor_field(kind), {"type": "object", SCHEMA_KIND: kind}
    return Annotated[
        tuple[element, ...],  # type: ignore[valid-type]
        BeforeValidator(convert),
        PlainSerializer(dump),
        WithJsonSchema({"anyOf": [one, {"type": "array", "items": one}, {"type": "null"}]}),
    ]


def _unfold(errors: Any, prefix: tuple[int | str, ...]) -> Any:
    for error in errors:
        loc = prefix + tuple(error["loc"])
        if error["type"] == "functor":
            yield from _unfold(error["ctx"]["errors"], loc)
        else:
            yield {**error, "loc": loc}


def _located(problem: Any, cls: type[Plugin]) -> dict[str, Any]:
    """Return an error of a plugin's field with the path that the field has in the configuration."""
    loc = tuple(problem["loc"])
    where = loc if loc[:1] == ("wrapped",) else ("config", *loc)
    located = {**problem, "loc": where}
    if problem["type"] == "extra_forbidden" and len(loc) == 1:
        located["msg"] = (
            f"{cls.registered_name} has no field `{loc[-1]}`; {did_you_mean(str(loc[-1]), cls.model_fields)}"
        )
    return located


def _problem(loc: tuple[int | str, ...], message: str) -> dict[str, Any]:
    return {"type": "functor_key", "loc": loc, "msg": message}
