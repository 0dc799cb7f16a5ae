"""Report of all breaches of the contract by a plugin."""

from __future__ import annotations

import os
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from safe_inspect.environments.finite_checks import writes_read_only
from safe_inspect.errors import PluginValueError, SafeInspectError

#: Remedy if a plugin writes into its inputs.
WRITES = "compute on copies: no assignment, `+=` or `out=` on what the plugin is given"

#: Parts of the paths of code that is not the user's.
_LIBRARIES = (f"{Path(__file__).parents[1]}{os.sep}", "site-packages")


@dataclass(frozen=True)
class Breach:
    """One rule of the contract that a plugin breaks.

    Attributes:
        rule: Name of the rule, such as ``row-wise``.
        message: Description of the mistake.
        remedy: How to fix it.
    """

    rule: str
    message: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.rule}: {self.message}; {self.remedy}"


class ContractError(SafeInspectError, AssertionError):
    """Error that lists all rules of the contract that a plugin breaks.

    Attributes:
        plugin: Name of the plugin.
        breaches: All breaches of the plugin.
    """

    def __init__(self, plugin: str, breaches: Sequence[Breach]) -> None:
        self.plugin = plugin
        self.breaches = tuple(breaches)
        count = "1 rule" if len(self.breaches) == 1 else f"{len(self.breaches)} rules"
        lines = "\n".join(f"  - {breach}" for breach in self.breaches)
        super().__init__(f"{plugin} breaks {count} of the plugin contract:\n{lines}")


@dataclass
class Report:
    """Collection of breaches; a rule with the same message is reported once."""

    breaches: list[Breach] = field(default_factory=list)

    def add(self, rule: str, message: str, remedy: str) -> None:
        """Add a breach."""
        breach = Breach(rule, message, remedy)
        if breach not in self.breaches:
            self.breaches.append(breach)

    def expect(self, condition: object, rule: str, message: str, remedy: str) -> bool:
        """Add a breach unless the condition is true; return the condition."""
        if not condition:
            self.add(rule, message, remedy)
        return bool(condition)

    @contextmanager
    def attempt(self, what: str, remedy: str = "it must work for every row of the sample world") -> Iterator[None]:
        """Convert an exception of the plugin to a breach that names the line of the exception."""
        try:
            yield
        except Exception as error:
            cause = error.__cause__ if isinstance(error, PluginValueError) and error.__cause__ else error
            calls = traceback.extract_tb(cause.__traceback__)
            own = [call for call in calls if not any(place in call.filename for place in _LIBRARIES)]
            last = (own or calls)[-1]
            text = f"{type(cause).__name__}: {cause}".splitlines()[0]
            message = f"{what} raised {text} ({last.filename}:{last.lineno}: {last.line})"
            if writes_read_only(cause):
                self.add("inputs unchanged", message, WRITES)
            else:
                self.add("runs", message, remedy)
