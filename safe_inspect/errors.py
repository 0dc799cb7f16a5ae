"""Named errors. Each one says where, what is wrong and what to do.

Commands print them without a traceback and exit with code 2; a program that
imports the package catches `SafeInspectError`.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass


class SafeInspectError(Exception):
    """Base of every error that a user can cause and mend."""


@dataclass(frozen=True)
class Location:
    """A place in a configuration file; lines and columns count from 1.

    Attributes:
        file: The file, or what stands for one, such as ``command line``.
        line: The line; 0 where `text` says the place instead.
        column: The column.
        text: What was given there, for a place without lines.
    """

    file: str
    line: int
    column: int = 1
    text: str = ""

    def __str__(self) -> str:
        return f"{self.file}:{self.line}" if self.line else f"{self.file}: {self.text}"


@dataclass(frozen=True)
class Problem:
    """One mistake of a configuration.

    Attributes:
        message: What is wrong.
        path: The path of keys, such as ``rewards[0].config.scael``; empty for a whole file.
        location: Where it stands, when it stands in a file.
        hint: What to do; empty when the message says it.
    """

    message: str
    path: str = ""
    location: Location | None = None
    hint: str = ""

    def __str__(self) -> str:
        where = " ".join(part for part in (f"{self.location}" if self.location else "", self.path) if part)
        text = f"{where}: {self.message}" if where else self.message
        return f"{text}; {self.hint}" if self.hint else text


#: How many mistakes are printed.
_SHOWN = 50


class ConfigError(SafeInspectError):
    """One or more mistakes in a configuration, reported together."""

    def __init__(self, problems: Sequence[Problem] | Problem | str) -> None:
        if isinstance(problems, str):
            problems = Problem(problems)
        if isinstance(problems, Problem):
            problems = [problems]
        self.problems: tuple[Problem, ...] = tuple(problems)
        lines = [str(problem) for problem in self.problems[:_SHOWN]]
        more = len(self.problems) - len(lines)
        super().__init__("\n".join([*lines, f"and {more} more"] if more else lines))


class RegistryError(SafeInspectError, LookupError):
    """A plugin name that is unknown, ambiguous or taken."""


class UnitError(SafeInspectError, ValueError):
    """A unit that is unknown or of another dimension."""


class UnsafeInitialStateWarning(UserWarning):
    """A safety filter is enabled, and promises nothing from an initial state."""


class SafetyFilterWarning(UserWarning):
    """A safety filter is enabled where it promises less than elsewhere."""


class InitialStateError(SafeInspectError, RuntimeError):
    """No safe initial state was found; the message counts the refusals by constraint."""


class PluginValueError(SafeInspectError, ArithmeticError):
    """A plugin returned NaN or infinity, or an array of the wrong shape, or wrote into an array that it was given."""


class MissingNameError(SafeInspectError, AttributeError):
    """A plugin reads what the task does not offer; the message names what it does offer."""


class ArgumentError(SafeInspectError, ValueError):
    """An action outside of its space, or an argument that an environment or its `reset` does not take."""


class KeywordError(ArgumentError, TypeError):
    """A keyword that an environment does not take; a `TypeError`, as Python raises one and as clients expect it."""


class AgentError(SafeInspectError, LookupError):
    """An agent that the environment does not have."""


class CheckpointError(SafeInspectError, RuntimeError):
    """A checkpoint that is missing, damaged or of another experiment."""


class MissingLibraryError(SafeInspectError, ImportError):
    """A library of an extra that is not installed."""


class OutputError(SafeInspectError, OSError):
    """An output folder that cannot be written."""


def not_named(kind: str, name: str, known: Iterable[str]) -> str:
    """Return that nothing of a kind has a name, and what has."""
    known = set(known)
    what = {"points": "body with inspection points"}.get(kind, kind)
    if not known:
        return f"no {what} is named {name!r}: this task has none"
    return f"no {what} is named {name!r}; {did_you_mean(name, known)}"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``did you mean `x`?`` for the nearest known name or one that starts alike, else a list of what is known.

    The list is cut at twelve names; where nothing is known, the text says that there is none.
    """
    names = sorted({str(item) for item in known})
    lowered = {item.lower(): item for item in names}
    cutoff = 0.75 if len(name) > 3 else 0.6  # one wrong letter of three
    near = difflib.get_close_matches(name.lower(), list(lowered), n=1, cutoff=cutoff)
    if not near and len(name) > 2:
        near = [item for item in lowered if item.startswith(name.lower())]
        near = near or [item for item in lowered if len(item) > 2 and name.lower().startswith(item)]
    if near:
        return f"did you mean `{lowered[near[0]]}`?"
    if not names:
        return "there is none"
    shown = ", ".join(f"`{item}`" for item in names[:12])
    return f"known: {shown}" + (", ..." if len(names) > 12 else "")
