"""Pydantic's messages in plain words: the expected value and the actual one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic_core import PydanticCustomError

from safe_inspect.config.keys import by_name
from safe_inspect.errors import did_you_mean

#: Expected values, each with the types of its errors; the names in braces are those of the error's context.
_WANTED = by_name(
    {
        "a whole number": "int_type int_parsing int_from_float",
        "a smaller whole number": "int_parsing_size",
        "a number": "float_type float_parsing",
        "a finite number": "finite_number",
        "`true` or `false`": "bool_type bool_parsing",
        "a string": "string_type",
        "nothing (`null`)": "none_required",
        "a list": "list_type tuple_type set_type iterable_type",
        "a mapping": "dict_type mapping_type model_type model_attributes_type dataclass_type",
        "a number above {gt}": "greater_than",
        "a number of {ge} or more": "greater_than_equal",
        "a number below {lt}": "less_than",
        "a number of {le} or less": "less_than_equal",
        "a multiple of {multiple_of}": "multiple_of",
        "at least {min_length} items": "too_short",
        "at most {max_length} items": "too_long",
        "a string of at least {min_length} characters": "string_too_short",
        "a string of at most {max_length} characters": "string_too_long",
        "{pattern}": "string_pattern_mismatch",
        "{expected}": "literal_error enum",
        "one of {expected_tags} as {discriminator}": "union_tag_invalid",
    }
)

#: Expected string by the pattern of its field.
_PATTERNS = {
    r"^[^/\s]+$": "a name without spaces and slashes",
    r"^[\w.-]+$": "a name of letters, digits, `_`, `.` and `-`",
    r"\S|^$": "a string that is not blank",
    "^(quick|normal|thorough)$": "quick, normal or thorough",
}

#: Suffixes of errors about a value of another type, which may match another member of a union.
_OTHER_KIND = ("_type", "_parsing", "_required", "int_from_float", "literal_error", "enum")


def is_of_other_kind(error: Mapping[str, Any]) -> bool:
    """Return whether an error is about a value of another type than that of the field."""
    return str(error["type"]).endswith(_OTHER_KIND)


def wanted(error: Mapping[str, Any]) -> str:
    """Return a description of the expected value; empty if the error does not contain one."""
    context = error.get("ctx", {})
    limits = {name: f"{limit:.15g}" if isinstance(limit, float) else limit for name, limit in context.items()}
    if "pattern" in limits:
        pattern = limits["pattern"]
        limits["pattern"] = _PATTERNS.get(pattern, f"a string that matches the regular expression `{pattern}`")
    return _WANTED.get(error["type"], "").format_map(limits)


def text_of(error: Mapping[str, Any]) -> str:
    """Return a description of the mistake, with the hint of `message`."""
    return "; ".join(filter(None, message(error)))


def message(error: Mapping[str, Any]) -> tuple[str, str]:
    """Return a description of the mistake and a hint, which is often empty."""
    kind, said = error["type"], str(error["msg"])
    if kind == "missing":
        item = error["loc"][-1] if error.get("loc") else ""
        return f"item {item} of the list is missing" if isinstance(item, int) else "the key is missing", ""
    if kind == "functor_key":
        return said, ""
    if kind == "value_error":
        return said.removeprefix("Value error, "), ""
    if kind == "assertion_error":
        return said.removeprefix("Assertion failed, "), ""
    given = error.get("input")
    want = wanted(error)
    if want:
        return f"expected {want}, got {shown(given)}", _nearest(error, given)
    return f"{said[:1].lower()}{said[1:]}, got {shown(given)}", ""


def functor_mistakes(error: PydanticCustomError) -> str:
    """Return the mistakes of a functor without a file, from the error of `safe_inspect.plugins.functor.build`."""
    texts = []
    for problem in (error.context or {})["errors"]:
        where = ".".join(map(str, problem["loc"]))
        texts.append(f"{where}: {text_of(problem)}" if where else text_of(problem))
    return "; ".join(texts)


def shown(value: Any) -> str:
    """Return a value as messages print it, shortened."""
    if value is None:
        return "nothing (`null`)"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    text = repr(value)
    if len(text) <= 60:
        return text
    if isinstance(value, Mapping):
        return f"a mapping with {len(value)} keys"
    return f"a list of {len(value)}" if isinstance(value, (list, tuple)) else f"{text[:57]}..."


def _nearest(error: Mapping[str, Any], given: Any) -> str:
    """Return a hint with the most similar permitted string."""
    if error["type"] not in ("literal_error", "enum") or not isinstance(given, str):
        return ""
    hint = did_you_mean(given, str(error["ctx"]["expected"]).split("'")[1::2])
    return hint if hint.startswith("did") else ""
