"""Tables of the known keys of a mapping, and the translation of a mapping with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from safe_inspect.config.keys.old_keys import key_hint
from safe_inspect.config.keys.rllib_keys import Key
from safe_inspect.errors import Problem
from safe_inspect.experiments.settings.values import check_value, is_searched


@dataclass
class TranslatedSettings:
    """Settings translated from a mapping of an experiment.

    Attributes:
        settings: Values by current name; `model_config` is a nested mapping.
        notes: One sentence for each key that was translated or dropped.
        problems: The problems found; their paths begin with the name of the mapping.
        unchecked: Keys of an algorithm other than PPO, which can only be checked once Ray is loaded.
        given: The current names of the keys that the experiment gives; the other settings are defaults.
    """

    settings: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    unchecked: list[str] = field(default_factory=list)
    given: frozenset[str] = frozenset()


@dataclass(frozen=True)
class KeyTables:
    """Tables of the keys of one mapping.

    Attributes:
        known: The keys whose values are checked here.
        renamed: Old names with the current ones.
        dropped: Names without effect, with the reason.
        only_at: Names that are accepted only with certain values, with these values and the reason.
        reserved: Names that cannot be set, with the reason.
        prefixes: Prefixes of names that cannot be set, with the reason.
        parts: Substrings of names that cannot be set, with the reason.
        spellings: Alternative spellings with the usual ones.
        open: Whether further keys exist, whose values can only be checked once Ray is loaded.
        names: Names of these further keys; None accepts every name, where only the loaded Ray knows the names.
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
            reason = _refusal(name, tables)
            if reason:
                problems.append(Problem(f"`{given}` cannot be set here: {reason}", where))
            elif tables.open and (name.isidentifier() if tables.names is None else name in tables.names):
                settings[name] = value
                found.unchecked.append(name)
            else:
                names = [*tables.known, *tables.renamed, *(tables.names or ())]
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


def _refusal(name: str, tables: KeyTables) -> str:
    if name in tables.reserved:
        return tables.reserved[name]
    for prefix, reason in tables.prefixes.items():
        if name.startswith(prefix):
            return reason
    return next((reason for part, reason in tables.parts.items() if part in name), "")
