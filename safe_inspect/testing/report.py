"""What a plugin does wrong, reported at once."""

from __future__ import annotations

import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from safe_inspect.environments.writers import writes_read_only
from safe_inspect.errors import PluginValueError, SafeInspectError

#: What to do where a plugin writes into what it is given.
WRITES = "compute on copies: no assignment, `+=` or `out=` on what the plugin is given"


@dataclass(frozen=True)
class Breach:
    """One rule of the contract that a plugin breaks.

    Attributes:
        rule: Name of the rule, such as ``row-wise``.
        message: What is wrong.
        remedy: What to do.
    """

    rule: str
    message: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.rule}: {self.message}; {self.remedy}"


class ContractError(SafeInspectError, AssertionError):
    """A plugin breaks the contract.

    Attributes:
        plugin: Name of the plugin.
        breaches: All that it breaks.
    """

    def __init__(self, plugin: str, breaches: Sequence[Breach]) -> None:
        self.plugin = plugin
        self.breaches = tuple(breaches)
        count = "1 rule" if len(self.breaches) == 1 else f"{len(self.breaches)} rules"
        lines = "\n".join(f"  - {breach}" for breach in self.breaches)
        super().__init__(f"{plugin} breaks {count} of the plugin contract:\n{lines}")


@dataclass
class Report:
    """Gathers breaches; a rule with the same message is reported once."""

    breaches: list[Breach] = field(default_factory=list)

    def add(self, rule: str, message: str, remedy: str) -> None:
        """Take note of a breach."""
        breach = Breach(rule, message, remedy)
        if breach not in self.breaches:
            self.breaches.append(breach)

    def expect(self, condition: object, rule: str, message: str, remedy: str) -> bool:
        """Take note of a breach unless the condition holds; return whether it does."""
        if not condition:
            self.add(rule, message, remedy)
        return bool(condition)

    @contextmanager
    def attempt(self, what: str, remedy: str = "it must work for every row of the sample world") -> Iterator[None]:
        """Turn an exception of the plugin's into a breach that names its line."""
        try:
            yield
        except Exception as error:
            cause = error.__cause__ if isinstance(error, PluginValueError) and error.__cause__ else error
            last = traceback.extract_tb(cause.__traceback__)[-1]
            text = f"{type(cause).__name__}: {cause}".splitlines()[0]
            message = f"{what} raised {text} ({last.filename}:{last.lineno}: {last.line})"
            if writes_read_only(cause):
                self.add("inputs unchanged", message, WRITES)
            else:
                self.add("runs", message, remedy)
