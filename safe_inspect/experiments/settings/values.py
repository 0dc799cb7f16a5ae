"""Checks of the value of one key against its entry in the tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from safe_inspect.config.keys.rllib_keys import Key

GRID = "grid_search"
#: Tune's names of the random searches: from a list, or between two numbers (`randint` excludes the second).
CHOICE, UNIFORM, LOGUNIFORM, RANDINT = DRAWN = ("choice", "uniform", "loguniform", "randint")
#: Largest value of a key without an upper limit, within the range of C's integers and floats.
_GREATEST = {"integer": 2**31 - 1, "integers": 2**31 - 1, "number": 1e300, "schedule": 1e300}
EVAL = "eval"


def check_value(key: Key, value: Any) -> tuple[Any, str]:
    """Return the value converted to the key's type, and a message about what is wrong with it (empty if it is valid).

    A string that can be read as a number is converted, because YAML reads ``5e-5`` as a string. In a search, such as
    ``{grid_search: [...]}``, ``{choice: [...]}`` or ``{uniform: [low, high]}``, each listed value is checked.
    """
    if is_searched(value) and key.kind != "mapping":
        return _check_searched(key, *next(iter(value.items())))
    if value is None:
        return None, "" if key.optional else "a value is required"
    if isinstance(value, str) and value in key.choices:
        return value, ""
    return _CHECKS[key.kind](key, value)


def is_searched(value: Any) -> bool:
    """Return whether the value is a search over several values."""
    return isinstance(value, Mapping) and len(value) == 1 and next(iter(value)) in (GRID, *DRAWN)


def named_values(value: Any) -> list[Any]:
    """Return the values listed in a search, including the ends of a range; a list of the value itself if it is none."""
    given = next(iter(value.values())) if is_searched(value) else [value]
    return list(given) if isinstance(given, list | tuple) else [given]


def resolved_by_tune(value: Any) -> str:
    """Return the first keyword that Tune would resolve at any depth of a value (a search or `eval`); empty if none."""
    if isinstance(value, Mapping):
        if is_searched(value) or set(value) == {EVAL}:
            return str(next(iter(value)))
        value = value.values()
    elif not isinstance(value, list | tuple):
        return ""
    return next(filter(None, map(resolved_by_tune, value)), "")


def _check_searched(key: Key, word: str, values: Any) -> tuple[Any, str]:
    ranged = word in (UNIFORM, LOGUNIFORM, RANDINT)
    if not isinstance(values, Sequence) or isinstance(values, str) or not values or (ranged and len(values) != 2):
        return {word: [values]}, f"`{word}` takes a list of {'two numbers' if ranged else 'values'}"
    checked = [check_value(key, value) for value in values]
    found = [value for value, _ in checked]
    mistake = next((mistake for _, mistake in checked if mistake), "")
    if ranged and not mistake:
        mistake = _check_range(key, word, *found)
    return {word: found}, mistake


def _check_range(key: Key, word: str, low: Any, high: Any) -> str:
    if key.kind not in ("number", "integer", "schedule") or not all(isinstance(x, int | float) for x in (low, high)):
        return f"`{word}` samples numbers; use `{CHOICE}`"
    if (key.kind == "integer") != (word == RANDINT):
        wanted = f"whole numbers are required; use `{RANDINT}`" if key.kind == "integer" else f"use `{UNIFORM}`"
        return f"`{word}` is not possible here: {wanted} or `{CHOICE}`"
    if not low < high:
        return f"`{word}` goes from {low} to {high}; the second number must be larger"
    return "`loguniform` requires numbers above 0" if word == LOGUNIFORM and low <= 0 else ""


def _number(key: Key, value: Any) -> tuple[Any, str]:
    if isinstance(value, str):
        try:
            value = float(value)
        except ValueError:
            return value, _expected(key, value)
    if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
        return value, _expected(key, value)
    if key.low is not None and value < key.low:
        return value, f"{value} is too small; the least is {key.low:g}"
    high = _GREATEST[key.kind] if key.high is None else key.high
    if value > high:
        return value, f"{value} is too large; the greatest is {high:.10g}"
    return value, ""


def _integer(key: Key, value: Any) -> tuple[Any, str]:
    value, mistake = _number(key, value)
    if mistake:
        return value, mistake
    if not float(value).is_integer():
        return value, f"{value} is not a whole number"
    return int(value), ""


def _boolean(key: Key, value: Any) -> tuple[Any, str]:
    return value, "" if isinstance(value, bool) else _expected(key, value)


def _text(key: Key, value: Any) -> tuple[Any, str]:
    if not isinstance(value, str):
        return value, _expected(key, value)
    if not key.choices:
        return value, ""
    return value, f"`{value}` is not possible; use one of {', '.join(f'`{each}`' for each in key.choices)}"


def _mapping(key: Key, value: Any) -> tuple[Any, str]:
    return value, "" if isinstance(value, Mapping) else _expected(key, value)


def _integers(key: Key, value: Any) -> tuple[Any, str]:
    if not isinstance(value, Sequence) or isinstance(value, str):
        return value, _expected(key, value)
    items = [_integer(key, item) for item in value]
    return [item for item, _ in items], next((mistake for _, mistake in items if mistake), "")


def _schedule(key: Key, value: Any) -> tuple[Any, str]:
    if not isinstance(value, Sequence) or isinstance(value, str):
        return _number(key, value)
    pairs = []
    for pair in value:
        if not isinstance(pair, Sequence) or isinstance(pair, str) or len(pair) != 2:
            return value, "a schedule is a list of pairs [step, value]"
        step, late = _integer(Key("integer", low=0, high=2**63 - 1), pair[0])
        number, wrong = _number(key, pair[1])
        if late or wrong:
            return value, late or wrong
        pairs.append([step, number])
    if not pairs or pairs[0][0] != 0:
        return value, "a schedule must begin with step 0"
    return pairs, ""


def _names(key: Key, value: Any) -> tuple[Any, str]:
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, Sequence) or not all(isinstance(name, str) and "." in name for name in names):
        return value, _expected(key, value)
    return list(names), ""


def _object(key: Key, value: Any) -> tuple[Any, str]:
    made = {"functor": value} if isinstance(value, str) else value
    if not isinstance(made, Mapping) or set(made) - {"functor", "config"} or "." not in str(made.get("functor")):
        return value, _expected(key, value)
    config = made.get("config") or {}
    return {"functor": str(made["functor"]), "config": config}, _mapping(Key("mapping"), config)[1]


def _objects(key: Key, value: Any) -> tuple[Any, str]:
    items = [_object(key, item) for item in (value if isinstance(value, list | tuple) else [value])]
    return [item for item, _ in items], next((mistake for _, mistake in items if mistake), "")


_CHECKS = {
    "number": _number,
    "integer": _integer,
    "boolean": _boolean,
    "text": _text,
    "mapping": _mapping,
    "integers": _integers,
    "schedule": _schedule,
    "names": _names,
    "object": _object,
    "objects": _objects,
}

_NAMES = {
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "text": "a text",
    "mapping": "a mapping",
    "integers": "a list of whole numbers",
    "schedule": "a number, or a list of pairs [step, value]",
    "names": "a dotted path `module.Class`, or a list of them,",
    "object": "`{functor: module.Class, config: {...}}`, or a dotted path,",
    "objects": "`{functor: module.Class, config: {...}}`, a dotted path, or a list of these,",
}


def _expected(key: Key, value: Any) -> str:
    words = "".join(f" or `{word}`" for word in key.choices)
    return f"{_NAMES[key.kind]}{words} is expected, not {value!r}"
