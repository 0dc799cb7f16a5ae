"""`StrictNumbers`: base of models that do not accept a boolean for a number."""

from __future__ import annotations

import types
import typing
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel, BeforeValidator, ValidationInfo, field_validator
from pydantic_core import PydanticKnownError


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
