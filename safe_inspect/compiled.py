"""Numba's `njit` for this package, with a cache on disk that cannot be out of date.

Numba recompiles a cached function when its own file has changed, but not when a compiled function that it calls from
another file has: after an update of a checkout old machine code would go on running. So the cached machine code of the
whole package is removed when the source of any compiled function has changed.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from numba import njit

__all__ = ["njit"]

_PACKAGE = Path(__file__).parent
_STAMP = "compiled.stamp"


def remove_stale_cache(package: Path = _PACKAGE) -> bool:
    """Remove the cached machine code below a folder unless it belongs to the present sources.

    Args:
        package: The folder of a package.

    Returns:
        Whether the cache was out of date. A folder that cannot be written is left alone: an installed package has
        fresh files, and Numba then keeps its cache elsewhere.
    """
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        source = path.read_bytes()
        if b"@njit" in source:
            digest.update(path.relative_to(package).as_posix().encode() + b"\0" + source)
    stamp = package / "__pycache__" / _STAMP
    try:
        if stamp.is_file() and stamp.read_text(encoding="ascii") == digest.hexdigest():
            return False
        for pattern in ("*.nbi", "*.nbc"):
            for path in package.rglob(f"__pycache__/{pattern}"):
                path.unlink(missing_ok=True)
        stamp.parent.mkdir(exist_ok=True)
        stamp.write_text(digest.hexdigest(), encoding="ascii")
    except OSError:
        return False
    return True


remove_stale_cache()
