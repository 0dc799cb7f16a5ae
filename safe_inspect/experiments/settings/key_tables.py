"""Tables of the known keys of a mapping, checks of their values, and the translation of a mapping with them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

from pydantic import TypeAdapter, ValidationError

from safe_inspect.config.keys.old_keys import key_hint
from safe_inspect.config.report import problems_of
from safe_inspect.errors import Problem

GRID = "grid_search"
#: Tune's names of the random searches: from a list, or between two numbers (`randint` excludes the second).
CHOICE, UNIFORM, LOGUNIFORM, RANDINT = DRAWN = ("choice", "uniform", "loguniform", "randint")


def _checked_value(kind: Any, value: Any) -> tuple[Any, str]:
    """Return the value converted to a type, and a message about what is wrong with it (empty if it is valid).

    A string that can be read as a number is converted, because YAML reads ``5e-5`` as a string. In a search, such as
    ``{grid_search: [...]}``, ``{choice: [...]}`` or ``{uniform: [low, high]}``, each listed value is checked.
    """
    try:
        if is_searched(value) and "object" not in _json_types(kind):
            return _searched(kind, *next(iter(value.items()))), ""
        return _checker(kind).validate_python(value), ""
    except ValidationError as error:
        problem = problems_of(error, value)[0]
        return value, "; ".join(filter(None, (str(replace(problem, location=None, hint="")), problem.hint)))
    except ValueError as error:
        return value, str(error)


@lru_cache
def _checker(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


@lru_cache
def _json_types(kind: Any) -> frozenset[str]:
    """Return the names in JSON schemas of the types of values that a key accepts."""
    schema = _checker(kind).json_schema()
    return frozenset(part.get("type", "") for part in schema.get("anyOf", [schema]))


def is_searched(value: Any) -> bool:
    """Return whether the value is a search over several values."""
    return isinstance(value, Mapping) and len(value) == 1 and next(iter(value)) in (GRID, *DRAWN)


def _searched(kind: Any, word: str, values: Any) -> dict[str, Any]:
    ranged = word in (UNIFORM, LOGUNIFORM, RANDINT)
    if not isinstance(values, list | tuple) or not values or (ranged and len(values) != 2):
        raise ValueError(f"`{word}` takes a list of {'two numbers' if ranged else 'values'}")
    found = [_checker(kind).validate_python(value) for value in values]
    if ranged:
        _check_range(_json_types(kind), word, *found)
    return {word: found}


def _check_range(types: Collection[str], word: str, low: Any, high: Any) -> None:
    if not {"number", "integer"} & set(types) or not all(isinstance(x, int | float) for x in (low, high)):
        raise ValueError(f"`{word}` samples numbers; use `{CHOICE}`")
    whole = "number" not in types
    if whole != (word == RANDINT):
        wanted = f"whole numbers are required; use `{RANDINT}`" if whole else f"use `{UNIFORM}`"
        raise ValueError(f"`{word}` is not possible here: {wanted} or `{CHOICE}`")
    if not low < high:
        raise ValueError(f"`{word}` goes from {low} to {high}; the second number must be larger")
    if word == LOGUNIFORM and low <= 0:
        raise ValueError("`loguniform` requires numbers above 0")


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

    def nest(self, key: str, found: TranslatedSettings) -> None:
        """Take the settings of a nested mapping as the value of a key, with their notes and problems."""
        self.settings[key] = found.settings
        self.notes += found.notes
        self.problems += found.problems


@dataclass(frozen=True)
class KeyTables:
    """Tables of the keys of one mapping.

    Attributes:
        known: The keys whose values are checked here, with their types.
        renamed: Old names with the current ones.
        dropped: Names without effect, with the reason.
        only_at: Names that are accepted only with certain values, with these values and the reason.
        refused: Names that cannot be set, with the reason.
        spellings: Alternative spellings with the usual ones.
        unchecked: Names of further keys, whose values can only be checked once Ray is loaded.
        searchable: Whether values may be searched.
        defaults: Whether a null means the default of a key; otherwise it is a mistake.
        unknown: Message about a key that is in no table, with `{}` for its name.
    """

    known: Mapping[str, Any]
    renamed: Mapping[str, str]
    dropped: Mapping[str, str]
    only_at: Mapping[str, tuple[tuple[object, ...], str]]
    refused: Mapping[str, str] = field(default_factory=dict)
    spellings: Mapping[str, str] = field(default_factory=dict)
    unchecked: Collection[str] = ()
    searchable: bool = False
    defaults: bool = True
    unknown: str = "there is no key `{}`"

    def translate(self, mapping: Mapping[str, Any], path: str) -> TranslatedSettings:
        """Return the settings translated from a mapping.

        Args:
            mapping: Values by name, current or old.
            path: Name of the mapping, with which the paths of problems begin.
        """
        found = TranslatedSettings()
        settings, notes, problems = found.settings, found.notes, found.problems
        source: dict[str, str] = {}
        for given, value in mapping.items():
            where = f"{path}.{given}"
            name = self.spellings.get(str(given), str(given))
            if name in self.only_at:
                harmless, reason = self.only_at[name]
                if value not in harmless:
                    problems.append(Problem(f"`{given}: {value}` cannot be honoured: {reason}", where))
                continue
            if name in self.dropped:
                notes.append(f"`{given}` has no effect: {self.dropped[name]}")
                continue
            if name in self.renamed:
                name = self.renamed[name]
                notes.append(f"`{given}` is now `{name}`")
            target = name.partition(".")[0]
            if target not in self.known:
                if name in self.refused:
                    problems.append(Problem(f"`{given}` cannot be set here: {self.refused[name]}", where))
                elif name in self.unchecked:
                    settings[name] = value
                else:
                    former = [old for old, new in self.renamed.items() if new.partition(".")[0] in self.known]
                    names = [*self.known, *former, *self.unchecked]
                    problems.append(Problem(self.unknown.format(given), where, hint=key_hint(str(given), names)))
                continue
            if name in source:
                problems.append(Problem(f"`{given}` and `{source[name]}` are the same key, given twice", where))
                continue
            source[name] = str(given)
            if self.defaults and value is None and "null" not in _json_types(self.known[target]):
                notes.append(f"`{given}` is null, so its default is used")
                continue
            if "." in name:
                settings[target] = {**settings.get(target, {}), name.partition(".")[2]: value}
                continue
            if is_searched(value) and not self.searchable:
                word = next(iter(value))
                problems.append(
                    Problem(f"`{word}` is only supported for the keys of `rllib_configs` themselves", where)
                )
                continue
            value, mistake = _checked_value(self.known[name], value)
            if mistake:
                problems.append(Problem(mistake, where))
            elif isinstance(value, Mapping) and isinstance(settings.get(name), Mapping):
                settings[name] = {**settings[name], **value}
            else:
                settings[name] = value
        found.given = frozenset(settings)
        return found
