"""The base class of all plugins: each plugin is one frozen Pydantic class with a ``__call__`` method.

The fields of the class are its configuration, and unknown keys are forbidden.
Defining a class registers it under its class name. A concrete plugin is final:
wrap it instead of subclassing it.
"""

from __future__ import annotations

import inspect
import re
import types
import typing
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationInfo, field_validator
from pydantic_core import PydanticKnownError

from safe_inspect.plugins.registry import registry

#: A field and its description in the "Attributes:" of a docstring.
_ENTRY = re.compile(r"^ {4}(\w+)(?: \([^)]*\))?: *(.*(?:\n {5,}.*)*)", re.MULTILINE)


class StrictNumbers(BaseModel):
    """Base of models that reject ``true`` for a number. YAML also reads ``yes`` and ``on`` as ``true``."""

    @field_validator("*", mode="before")
    @classmethod
    def _no_truth_value(cls, value: Any, info: ValidationInfo) -> Any:
        if isinstance(value, bool) or (isinstance(value, list | tuple) and any(isinstance(x, bool) for x in value)):
            field = cls.model_fields[str(info.field_name)]
            converts = any(isinstance(mark, BeforeValidator) for mark in field.metadata)
            found = set() if converts else set(_scalars(field.annotation))
            if bool not in found and found & {int, float}:
                raise PydanticKnownError("float_type" if float in found else "int_type")
        return value


def _scalars(annotation: Any) -> Iterator[Any]:
    """Yield the types of the values that an annotation accepts, including those of items."""
    origin = typing.get_origin(annotation)
    if origin is typing.Annotated:
        base, *marks = typing.get_args(annotation)
        if not any(isinstance(mark, BeforeValidator) for mark in marks):  # such a type checks its values itself
            yield from _scalars(base)
    elif origin in (typing.Union, types.UnionType, tuple, list):
        for member in typing.get_args(annotation):
            yield from _scalars(member)
    else:
        yield annotation


_PACKAGE = "safe_inspect."
_BY_PLACE = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)


@dataclass(frozen=True)
class _Reference:
    """Marker of a field that refers to an object of the environment by name.

    It lets a wrong name be reported before the first step.

    Attributes:
        kind: ``sensor``, ``controller``, ``entity``, ``platform``, ``points`` or ``done``.
    """

    kind: str


SensorName = Annotated[str, _Reference("sensor")]
ControllerName = Annotated[str, _Reference("controller")]
EntityName = Annotated[str, _Reference("entity")]
PlatformName = Annotated[str, _Reference("platform")]
PointsName = Annotated[str, _Reference("points")]
DoneName = Annotated[str, _Reference("done")]


class Plugin(StrictNumbers):
    """Base class of all plugins; each kind has one abstract subclass that sets `kind`.

    Class keywords:
        name: Name in the registry. Default: the class name.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", validate_default=True, allow_inf_nan=False, ser_json_inf_nan="strings"
    )

    kind: ClassVar[str] = ""
    registered_name: ClassVar[str] = ""

    def __init_subclass__(cls, *, name: str = "", **kwargs: Any) -> None:
        """Accept the class keyword `name`, which `__pydantic_init_subclass__` reads when all fields are defined."""
        super().__init_subclass__(**kwargs)

    @classmethod
    def __pydantic_init_subclass__(cls, *, name: str = "", **kwargs: Any) -> None:
        """Register a concrete class.

        Raises:
            TypeError: The class extends a concrete plugin, or one of its methods cannot be called with the arguments
                of the method that it overrides.
        """
        super().__pydantic_init_subclass__(**kwargs)
        _check_methods(cls)
        for parent in cls.__mro__[1:]:
            if isinstance(parent, type) and issubclass(parent, Plugin) and parent.registered_name:
                raise TypeError(
                    f"{cls.__qualname__} extends the plugin {parent.__qualname__}, which is final; "
                    f"put an instance in a field and call it instead"
                )
        calls = any("__call__" in vars(parent) for parent in cls.__mro__)
        if cls.kind and calls and not inspect.isabstract(cls):
            cls.registered_name = name or cls.__name__
            registry.add(cls.kind, cls.registered_name, cls)

    def __eq__(self, other: object) -> bool:
        """Return whether class and fields are equal; cached values, which may be arrays, are not compared."""
        if not isinstance(other, Plugin):
            return NotImplemented
        return type(self) is type(other) and all(
            getattr(self, field) == getattr(other, field) for field in type(self).model_fields
        )

    def __deepcopy__(self, memo: dict[int, Any] | None = None) -> Self:
        """Return the plugin itself, which is safe because it is frozen."""
        return self

    def __getstate__(self) -> dict[Any, Any]:
        """Return the state to pickle without cached properties; they are computed again when needed."""
        state = super().__getstate__()
        fields = type(self).model_fields
        return state | {"__dict__": {name: value for name, value in state["__dict__"].items() if name in fields}}

    @classmethod
    def references(cls) -> dict[str, str]:
        """Return the fields that refer to objects of the environment: field name to kind of object."""
        return {field: mark.kind for field, info in cls.model_fields.items() for mark in _marks(info)}


def _check_methods(cls: type) -> None:
    """Raise TypeError when an overriding method cannot be called with the arguments of the method it overrides."""
    for name, own in vars(cls).items():
        declared = next((vars(parent)[name] for parent in cls.__mro__[1:] if name in vars(parent)), None)
        if not (inspect.isfunction(own) and inspect.isfunction(declared) and declared.__module__.startswith(_PACKAGE)):
            continue
        wanted = inspect.signature(declared)
        named = {each.name: each for each in wanted.parameters.values() if each.kind is each.KEYWORD_ONLY}
        places = [each for each in wanted.parameters.values() if each.kind in _BY_PLACE]
        try:
            inspect.signature(own).bind(*places, **named)
        except TypeError as error:
            arguments = ", ".join([each.name for each in places] + [f"{each}=..." for each in named])
            raise TypeError(f"{cls.__qualname__}.{name} cannot be called as ({arguments}): {error}") from None


def _marks(info: Any) -> list[_Reference]:
    found = [mark for mark in info.metadata if isinstance(mark, _Reference)]
    for argument in getattr(info.annotation, "__args__", ()):  # SensorName | None
        found += [mark for mark in getattr(argument, "__metadata__", ()) if isinstance(mark, _Reference)]
    return found


def documented_fields(cls: type[BaseModel]) -> dict[str, str]:
    """Return each field's description in the "Attributes:" of a class and its bases; the class itself has priority."""
    documented: dict[str, str] = {}
    for parent in cls.__mro__:
        text = inspect.cleandoc(vars(parent).get("__doc__") or "")
        section = text.partition("\nAttributes:\n")[2].partition("\n\n")[0]
        for field, about in _ENTRY.findall(section):
            documented.setdefault(field, " ".join(about.split()))
    return documented
