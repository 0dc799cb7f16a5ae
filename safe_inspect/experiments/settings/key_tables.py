"""Tables of the known keys of a mapping, checks of their values, and the translation of a mapping with them."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from safe_inspect.config.keys.old_keys import key_hint
from safe_inspect.config.keys.rllib_keys import Key
from safe_inspect.errors import Problem

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
    try:
        return _checked(key, value), ""
    except ValueError as error:
        return value, str(error)


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


def _checked(key: Key, value: Any) -> Any:
    """Return the value converted to the key's type.

    Raises:
        ValueError: The value is not possible; the message says why. So do the functions below.
    """
    if is_searched(value) and key.kind != "mapping":
        return _searched(key, *next(iter(value.items())))
    if value is None:
        if not key.optional:
            raise ValueError("a value is required")
        return None
    if isinstance(value, str) and value in key.choices:
        return value
    return _KINDS[key.kind][0](key, value)


def _unexpected(key: Key, value: Any) -> ValueError:
    words = "".join(f" or `{word}`" for word in key.choices)
    return ValueError(f"{_KINDS[key.kind][1]}{words} is expected, not {value!r}")


def _is_list(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _searched(key: Key, word: str, values: Any) -> dict[str, Any]:
    ranged = word in (UNIFORM, LOGUNIFORM, RANDINT)
    if not _is_list(values) or not values or (ranged and len(values) != 2):
        raise ValueError(f"`{word}` takes a list of {'two numbers' if ranged else 'values'}")
    found = [_checked(key, value) for value in values]
    if ranged:
        _check_range(key, word, *found)
    return {word: found}


def _check_range(key: Key, word: str, low: Any, high: Any) -> None:
    if key.kind not in ("number", "integer", "schedule") or not all(isinstance(x, int | float) for x in (low, high)):
        raise ValueError(f"`{word}` samples numbers; use `{CHOICE}`")
    if (key.kind == "integer") != (word == RANDINT):
        wanted = f"whole numbers are required; use `{RANDINT}`" if key.kind == "integer" else f"use `{UNIFORM}`"
        raise ValueError(f"`{word}` is not possible here: {wanted} or `{CHOICE}`")
    if not low < high:
        raise ValueError(f"`{word}` goes from {low} to {high}; the second number must be larger")
    if word == LOGUNIFORM and low <= 0:
        raise ValueError("`loguniform` requires numbers above 0")


def _number(key: Key, value: Any) -> Any:
    number = value
    if isinstance(value, str):
        try:
            number = float(value)
        except ValueError:
            raise _unexpected(key, value) from None
    if isinstance(number, bool) or not isinstance(number, int | float) or math.isnan(number):
        raise _unexpected(key, number)
    if key.low is not None and number < key.low:
        raise ValueError(f"{number} is too small; the least is {key.low:g}")
    high = _GREATEST[key.kind] if key.high is None else key.high
    if number > high:
        raise ValueError(f"{number} is too large; the greatest is {high:.10g}")
    return number


def _integer(key: Key, value: Any) -> int:
    number = _number(key, value)
    if not float(number).is_integer():
        raise ValueError(f"{number} is not a whole number")
    return int(number)


def _instance(key: Key, value: Any) -> Any:
    if not isinstance(value, {"boolean": bool, "mapping": Mapping, "text": str}[key.kind]):
        raise _unexpected(key, value)
    if key.kind == "text" and key.choices:
        possible = ", ".join(f"`{each}`" for each in key.choices)
        raise ValueError(f"`{value}` is not possible; use one of {possible}")
    return value


def _integers(key: Key, value: Any) -> list[int]:
    if not _is_list(value):
        raise _unexpected(key, value)
    return [_integer(key, item) for item in value]


def _schedule(key: Key, value: Any) -> Any:
    if not _is_list(value):
        return _number(key, value)
    if not all(_is_list(pair) and len(pair) == 2 for pair in value):
        raise ValueError("a schedule is a list of pairs [step, value]")
    steps = Key("integer", low=0, high=2**63 - 1)
    pairs = [[_integer(steps, step), _number(key, number)] for step, number in value]
    if not pairs or pairs[0][0] != 0:
        raise ValueError("a schedule must begin with step 0")
    return pairs


def _names(key: Key, value: Any) -> list[str]:
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, Sequence) or not all(isinstance(name, str) and "." in name for name in names):
        raise _unexpected(key, value)
    return list(names)


def _object(key: Key, value: Any) -> dict[str, Any]:
    made = {"functor": value} if isinstance(value, str) else value
    if not isinstance(made, Mapping) or set(made) - {"functor", "config"} or "." not in str(made.get("functor")):
        raise _unexpected(key, value)
    return {"functor": str(made["functor"]), "config": _checked(Key("mapping"), made.get("config") or {})}


def _objects(key: Key, value: Any) -> list[dict[str, Any]]:
    return [_object(key, item) for item in (value if isinstance(value, list | tuple) else [value])]


#: The check of each kind of key, and the name of the kind in messages.
_KINDS: dict[str, tuple[Callable[[Key, Any], Any], str]] = {
    "number": (_number, "a number"),
    "integer": (_integer, "a whole number"),
    "boolean": (_instance, "true or false"),
    "text": (_instance, "a text"),
    "mapping": (_instance, "a mapping"),
    "integers": (_integers, "a list of whole numbers"),
    "schedule": (_schedule, "a number, or a list of pairs [step, value]"),
    "names": (_names, "a dotted path `module.Class`, or a list of them,"),
    "object": (_object, "`{functor: module.Class, config: {...}}`, or a dotted path,"),
    "objects": (_objects, "`{functor: module.Class, config: {...}}`, a dotted path, or a list of these,"),
}


@dataclass
class TranslatedSettings:
    """Settings translated from a mapping of an experiment.

    Attributes:
        settings: Values by current name; `model_config` is a nested mapping.
        notes: One sentence for each key that was translated or dropped.
        problems: The problems found; their paths begin with the name of the mapping.
        given: The current names of the keys that the experiment gives; the other settings are defaults.
    """

    settings: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    given: frozenset[str] = frozenset()


@dataclass(frozen=True)
class KeyTables:
    """Tables of the keys of one mapping.

    Attributes:
        known: The keys whose values are checked here.
        renamed: Old names with the current ones.
        dropped: Names without effect, with the reason.
        only_at: Names that are accepted only with certain values, with these values and the reason.
        refused: Names that cannot be set, with the reason.
        spellings: Alternative spellings with the usual ones.
        unchecked: Names of further keys, whose values can only be checked once Ray is loaded.
        searchable: Whether values may be searched.
    """

    known: Mapping[str, Key]
    renamed: Mapping[str, str]
    dropped: Mapping[str, str]
    only_at: Mapping[str, tuple[tuple[object, ...], str]]
    refused: Mapping[str, str] = field(default_factory=dict)
    spellings: Mapping[str, str] = field(default_factory=dict)
    unchecked: Collection[str] = ()
    searchable: bool = False


def translate_keys(mapping: Mapping[str, Any], path: str, tables: KeyTables) -> TranslatedSettings:
    """Return the settings translated from a mapping.

    Args:
        mapping: Values by name, current or old.
        path: Name of the mapping, with which the paths of problems begin.
        tables: The tables of its keys.
    """
    found = TranslatedSettings()
    settings, notes, problems = found.settings, found.notes, found.problems
    source: dict[str, str] = {}
    for given, value in mapping.items():
        where = f"{path}.{given}"
        name = tables.spellings.get(str(given), str(given))
        if name in tables.only_at:
            harmless, reason = tables.only_at[name]
            if value not in harmless:
                problems.append(Problem(f"`{given}: {value}` cannot be honoured: {reason}", where))
            continue
        if name in tables.dropped:
            notes.append(f"`{given}` has no effect: {tables.dropped[name]}")
            continue
        if name in tables.renamed:
            name = tables.renamed[name]
            notes.append(f"`{given}` is now `{name}`")
        target = name.partition(".")[0]
        if target not in tables.known:
            if name in tables.refused:
                problems.append(Problem(f"`{given}` cannot be set here: {tables.refused[name]}", where))
            elif name in tables.unchecked:
                settings[name] = value
            else:
                names = [*tables.known, *tables.renamed, *tables.unchecked]
                problems.append(Problem(f"there is no key `{given}`", where, hint=key_hint(str(given), names)))
            continue
        if name in source:
            problems.append(Problem(f"`{given}` and `{source[name]}` are the same key, given twice", where))
            continue
        source[name] = str(given)
        if value is None and not tables.known[target].optional:
            notes.append(f"`{given}` is null, so its default is used")
            continue
        if "." in name:
            settings[target] = {**settings.get(target, {}), name.partition(".")[2]: value}
            continue
        if is_searched(value) and not tables.searchable:
            word = next(iter(value))
            problems.append(Problem(f"`{word}` is only supported for the keys of `rllib_configs` themselves", where))
            continue
        value, mistake = check_value(tables.known[name], value)
        if mistake:
            problems.append(Problem(mistake, where))
        elif isinstance(value, Mapping) and isinstance(settings.get(name), Mapping):
            settings[name] = {**settings[name], **value}
        else:
            settings[name] = value
    found.given = frozenset(settings)
    return found
