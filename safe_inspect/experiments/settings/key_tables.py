"""What is known about the keys of a mapping, and what the mapping means by them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from safe_inspect.config.keys.other_words import key_hint
from safe_inspect.config.keys.rllib_keys import Key
from safe_inspect.errors import Problem
from safe_inspect.experiments.settings.values import check_value, is_searched


@dataclass(frozen=True)
class TranslatedSettings:
    """What a mapping of an experiment means.

    Attributes:
        settings: Current names and their values; `model_config` is a mapping of its own.
        notes: One sentence for each key that was translated or dropped.
        problems: The mistakes; their paths begin with the name of the mapping.
        unchecked: Names of another algorithm than PPO, which only the loaded Ray can check.
        given: The current names that the experiment gives; the other settings are defaults.
    """

    settings: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    problems: tuple[Problem, ...] = ()
    unchecked: tuple[str, ...] = ()
    given: frozenset[str] = frozenset()


@dataclass(frozen=True)
class KeyTables:
    """What is known about the keys of one mapping.

    Attributes:
        known: The keys whose values are checked here.
        renamed: Old names.
        dropped: Names without effect, with the reason.
        only_at: Names that are harmless at some values only, with these and the reason.
        reserved: Names that cannot be set, with the reason.
        prefixes: The same by how names begin.
        parts: The same by a part of the name.
        spellings: Other spellings.
        open: Whether there are more keys, whose values only the loaded Ray can check.
        names: Names of these; None: every name, where only the loaded Ray knows them.
        searchable: Whether values may be searched.
    """

    known: Mapping[str, Key]
    renamed: Mapping[str, str]
    dropped: Mapping[str, str]
    only_at: Mapping[str, tuple[tuple[object, ...], str]]
    reserved: Mapping[str, str] = field(default_factory=dict)
    prefixes: Mapping[str, str] = field(default_factory=dict)
    parts: Mapping[str, str] = field(default_factory=dict)
    spellings: Mapping[str, str] = field(default_factory=dict)
    open: bool = False
    names: frozenset[str] | None = None
    searchable: bool = False


def translate_keys(mapping: Mapping[str, Any], path: str, tables: KeyTables) -> TranslatedSettings:
    """Return what a mapping means.

    Args:
        mapping: Names, current or old, and their values.
        path: Name of the mapping, for the places of mistakes.
        tables: What is known about its keys.
    """
    settings: dict[str, Any] = {}
    notes: list[str] = []
    problems: list[Problem] = []
    unchecked: list[str] = []
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
            reason = _refusal(name, tables)
            if reason:
                problems.append(Problem(f"`{given}` cannot be set here: {reason}", where))
            elif tables.open and (name.isidentifier() if tables.names is None else name in tables.names):
                settings[name] = value
                unchecked.append(name)
            else:
                names = [*tables.known, *tables.renamed, *(tables.names or ())]
                problems.append(Problem(f"there is no key `{given}`", where, hint=key_hint(str(given), names)))
            continue
        if name in source:
            problems.append(Problem(f"`{given}` and `{source[name]}` are one key, given twice", where))
            continue
        source[name] = str(given)
        if value is None and not tables.known[target].optional:
            notes.append(f"`{given}` is null, so its default holds")
            continue
        if "." in name:
            settings[target] = {**settings.get(target, {}), name.partition(".")[2]: value}
            continue
        if is_searched(value) and not tables.searchable:
            word = next(iter(value))
            problems.append(Problem(f"`{word}` is possible for the keys of `rllib_configs` themselves only", where))
            continue
        value, mistake = check_value(tables.known[name], value)
        if mistake:
            problems.append(Problem(mistake, where))
        elif isinstance(value, Mapping) and isinstance(settings.get(name), Mapping):
            settings[name] = {**settings[name], **value}
        else:
            settings[name] = value
    return TranslatedSettings(settings, tuple(notes), tuple(problems), tuple(unchecked), frozenset(settings))


def _refusal(name: str, tables: KeyTables) -> str:
    if name in tables.reserved:
        return tables.reserved[name]
    for prefix, reason in tables.prefixes.items():
        if name.startswith(prefix):
            return reason
    return next((reason for part, reason in tables.parts.items() if part in name), "")
