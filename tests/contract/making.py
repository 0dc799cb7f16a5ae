"""Small plugins for the test kit, each made of a base and the members by which it differs."""

from __future__ import annotations

from typing import Any

from safe_inspect.plugins import Plugin


def made(base: type[Plugin], doc: str = "Do something.", /, **members: Any) -> type[Plugin]:
    """Return a subclass, registered under a name that contains its base, with a docstring and further members."""
    name = f"Made{base.__name__}"
    own = {"__doc__": doc, "__module__": __name__, "__qualname__": name, **members}
    return type(base)(name, (base,), own)
