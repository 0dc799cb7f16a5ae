"""Where machine code is kept: beside the package, or in a folder of the user's where that cannot be written."""

from __future__ import annotations

import functools
import hashlib
import os
import sys
from pathlib import Path

PACKAGE = Path(__file__).parents[1]


def user_folder(sources: str) -> Path:
    """Return the user's folder for machine code of these sources, by the conventions of the platform.

    Args:
        sources: Their digest, see `digest_of`.
    """
    if sys.platform == "win32":
        root = os.environ.get("LOCALAPPDATA", "~/AppData/Local")
    elif sys.platform == "darwin":
        root = "~/Library/Caches"
    else:
        root = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(root).expanduser() / "safe_inspect" / sources[:16]


@functools.cache
def digest_of(package: Path = PACKAGE) -> str:
    """Return a digest of all files of a package that define compiled functions."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        source = path.read_bytes()
        if b"@njit" in source:
            digest.update(path.relative_to(package).as_posix().encode() + b"\0" + source)
    return digest.hexdigest()
