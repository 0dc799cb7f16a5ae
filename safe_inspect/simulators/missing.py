"""The error for a name that a task does not provide."""

from __future__ import annotations

from collections.abc import Iterable

from safe_inspect.errors import MissingNameError, did_you_mean


def missing(what: str, name: str, offered: Iterable[str]) -> MissingNameError:
    """Return the error for a name that the task does not provide, with a suggestion."""
    return MissingNameError(f"the {what} of this task has no {name!r}; {did_you_mean(name, offered)}", name=name)
