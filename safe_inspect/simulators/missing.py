"""The error for a name that a task does not provide."""

from __future__ import annotations

from collections.abc import Iterable

from safe_inspect.errors import MissingNameError, did_you_mean


def missing(what: str, name: str, offered: Iterable[str], thing: object = None) -> MissingNameError:
    """Return the error for a name that the task does not provide, with a suggestion.

    Args:
        what: What was read, such as ``view``.
        name: The name.
        offered: Names that the task provides.
        thing: The object that was read; its own public names are suggested too, if they are similar.
    """
    hint = did_you_mean(name, offered)
    if thing is not None and "?" not in hint:
        own = did_you_mean(name, [known for known in dir(type(thing)) if not known.startswith("_")])
        hint = own if "?" in own else hint
    return MissingNameError(f"the {what} of this task has no {name!r}; {hint}", name=name)
