"""Import of the libraries that only rendezvous needs, when a function first uses one."""

from __future__ import annotations

import importlib
from typing import Any

from safe_inspect.errors import MissingLibraryError


def require(name: str) -> Any:
    """Return an optional library.

    Args:
        name: Name of its module, such as ``piqp``.

    Raises:
        MissingLibraryError: The library is not installed.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name != name.partition(".")[0]:
            raise
        raise MissingLibraryError(
            f"rendezvous needs {name!r}, which is not installed; install the extra: pip install .[rendezvous]"
        ) from error
