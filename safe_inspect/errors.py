"""The exceptions of the package. Each message states where the problem is, what is wrong and what to do.

Commands print them without a traceback and exit with code 2; programs that import the package can catch
`SafeInspectError`.
"""

from __future__ import annotations

import difflib
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from zipfile import BadZipFile

#: What NumPy raises for a damaged ``.npz`` file; a changed bit can make it encrypted, or of an unknown compression.
UNREADABLE_ARRAYS = (
    OSError, ValueError, KeyError, EOFError, BadZipFile, zlib.error, RuntimeError, OverflowError, MemoryError,
)  # fmt: skip
#: How the note of an error begins that a plugin has raised; see `safe_inspect.environments.finite_checks`.
RAISED_IN = "raised in "


class SafeInspectError(Exception):
    """Base class of all errors that a user can cause and fix."""


@dataclass(frozen=True)
class Location:
    """A position in a configuration file; lines count from 1.

    Attributes:
        file: The file, or another source such as ``command line``.
        line: The line; 0 if `text` describes the position.
        text: The text that was given, for a source without lines.
    """

    file: str
    line: int
    text: str = ""

    def __str__(self) -> str:
        return f"{self.file}:{self.line}" if self.line else f"{self.file}: {self.text}"


@dataclass(frozen=True)
class Problem:
    """One mistake of a configuration.

    Attributes:
        message: What is wrong.
        path: The path of keys, such as ``rewards[0].config.scael``; empty for a whole file.
        location: Its position, if it is in a file.
        hint: What to do; empty if the message contains it.
        ambiguous: Whether a name has several meanings, which the hint lists.
    """

    message: str
    path: str = ""
    location: Location | None = None
    hint: str = ""
    ambiguous: bool = False

    def __str__(self) -> str:
        after = ": " if self.location and self.location.text else " "  # an override needs a colon before the path
        where = after.join(part for part in (f"{self.location}" if self.location else "", self.path) if part)
        text = f"{where}: {self.message}" if where else self.message
        return f"{text}; {self.hint}" if self.hint else text


#: Largest number of mistakes that are printed.
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


class RegistryError(SafeInspectError, LookupError, ValueError):
    """A plugin name that is unknown, ambiguous or already registered."""


class UnitError(SafeInspectError, ValueError):
    """A unit that is unknown or has another dimension."""


class UnsafeInitialStateWarning(UserWarning):
    """A safety filter is enabled, but gives no guarantee from an initial state."""


class SafetyFilterWarning(UserWarning):
    """A safety filter is enabled, but its guarantee is limited in this experiment."""


class InitialStateError(SafeInspectError, RuntimeError):
    """No safe initial state was found; the message lists the number of rejections by constraint."""


class PluginValueError(SafeInspectError, ArithmeticError):
    """A plugin returned NaN, infinity or an array of the wrong shape, or modified an array that it was given."""


class MissingNameError(SafeInspectError, AttributeError):
    """A plugin reads something that the task does not provide; the message lists what it provides."""


class ArgumentError(SafeInspectError, ValueError):
    """An action outside its space, an invalid argument of an environment, or parts of a simulation that do not fit."""


class KeywordError(ArgumentError, TypeError):
    """An unknown keyword argument of an environment; also a `TypeError`, which Python raises and clients expect."""


class AgentError(SafeInspectError, LookupError):
    """An agent that the environment does not have."""


class CheckpointError(SafeInspectError, RuntimeError):
    """A checkpoint that is missing, damaged or from another experiment."""


class MissingLibraryError(SafeInspectError, ImportError):
    """A library that is not installed; it belongs to one of the package's extras."""


class OutputError(SafeInspectError, OSError):
    """An output folder that cannot be written."""


def not_named(kind: str, name: str, known: Iterable[str]) -> str:
    """Return a message that there is no object of a kind with this name, and the names that exist."""
    known = set(known)
    what = {"points": "body with inspection points"}.get(kind, kind)
    if not known:
        return f"no {what} is named {name!r}: this task has none"
    return f"no {what} is named {name!r}; {did_you_mean(name, known)}"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``did you mean `x`?`` for the most similar name or the shortest with the same start, else all names.

    The list has at most twelve names. If no name is known, the result is "there is none".
    """
    names = sorted({str(item) for item in known})
    lowered = {item.lower(): item for item in names}
    cutoff = 0.75 if len(name) > 3 else 0.6  # permits one wrong letter in three
    near = difflib.get_close_matches(name.lower(), list(lowered), n=1, cutoff=cutoff)
    if not near and len(name) > 2:
        near = sorted((item for item in lowered if item.startswith(name.lower())), key=len)
        near = near or [item for item in lowered if len(item) > 2 and name.lower().startswith(item)]
    if near:
        return f"did you mean `{lowered[near[0]]}`?"
    if not names:
        return "there is none"
    shown = ", ".join(f"`{item}`" for item in names[:12])
    return f"known: {shown}" + (", ..." if len(names) > 12 else "")
