"""The types of the values of keys: numbers that stay as they are written, schedules, paths of classes, and objects."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any

from annotated_types import Ge, Le
from pydantic import AfterValidator, AllowInfNan, BaseModel, BeforeValidator, StringConstraints, WrapValidator

#: Pattern of the path of a class.
_DOTTED_PATH = r"^\w+(\.\w+)+$"


def _as_written(value: Any, check: Callable[[Any], Any]) -> Any:
    """Return a checked number. A whole number stays one, so that a resumed run has the configuration of its files."""
    found = check(str(value) if isinstance(value, bool) else value)  # `true` is not 1
    return value if isinstance(value, int) else found


def numeric(kind: type[int] | type[float], *limits: Any) -> Any:
    """Return the type of a number within limits."""
    return Annotated[(kind, *limits, WrapValidator(_as_written))]  # type: ignore[misc]


def _begins(pairs: list[tuple[int, float]]) -> list[list[float]]:
    if not pairs or pairs[0][0] != 0:
        raise ValueError("a schedule must begin with step 0")
    return [list(pair) for pair in pairs]


def schedule_of(number: Any) -> Any:
    """Return the type of a number, or of pairs of step and number."""
    pairs: Any = list[tuple[numeric(int, Ge(0)), number]]  # type: ignore[misc]
    return number | Annotated[pairs, AfterValidator(_begins)]


class _Entry(BaseModel, extra="forbid"):
    functor: Annotated[str, StringConstraints(pattern=_DOTTED_PATH)]
    config: dict[str, Any] = {}


def _written_out(value: Any) -> Any:
    entry = {"functor": value} if isinstance(value, str) else value
    if not isinstance(entry, Mapping):
        raise ValueError(f"expected `{{functor: module.Class, config: {{...}}}}` or a dotted path, got {value!r:.60}")
    if entry.get("config", {}) is None:
        return {**entry, "config": {}}
    return entry


def _listed(value: Any) -> Any:
    return value if isinstance(value, list | tuple) else [value]


_GREATEST, FINITE = Le(2**31 - 1), AllowInfNan(False)  # of C's integers
COUNT, POSITIVE = numeric(int, Ge(0), _GREATEST), numeric(int, Ge(1), _GREATEST)
UNLIMITED = numeric(float, Ge(0))
NUMBER = numeric(float, FINITE)
SHARE = numeric(float, Ge(0), Le(1))
AMOUNT = numeric(float, Ge(0), FINITE)
PATHS = Annotated[list[Annotated[str, StringConstraints(pattern=_DOTTED_PATH)]], BeforeValidator(_listed)]
#: `{functor: module.Class, config: {...}}` or a dotted path, and a list of these.
OBJECT = Annotated[_Entry, BeforeValidator(_written_out), AfterValidator(_Entry.model_dump)]
OBJECTS = Annotated[list[OBJECT], BeforeValidator(_listed)]
