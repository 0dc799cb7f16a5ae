"""The error for a name that a task does not provide."""

from __future__ import annotations

from collections.abc import Iterable

from safe_inspect.errors import MissingNameError, did_you_mean


def missing(what: str, name: str, offered: Iterable[str], always: Iterable[str] = ()) -> MissingNameError:
    """Return the error for a name that the task does not provide, with a suggestion.

    Args:
        what: The object without the name.
        name: The missing name.
        offered: Names that the task provides.
        always: Names that the object has in every task; one is suggested if it is similar, but they are not listed.
    """
    offered = list(offered)
    hint = did_you_mean(name, [*offered, *always])
    hint = hint if hint.startswith("did") else did_you_mean(name, offered)
    return MissingNameError(f"the {what} of this task has no {name!r}; {hint}", name=name)
