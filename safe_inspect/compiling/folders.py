"""Where machine code is kept: with the package, or in a folder of the user's where that cannot be written."""

from __future__ import annotations

import functools
import hashlib
import linecache
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
#: States of the sources whose machine code is kept: the present one and those before it.
_STATES = 3


def user_folder() -> Path:
    """Return the user's folder for machine code, by the conventions of the platform."""
    if sys.platform == "win32":
        root = os.environ.get("LOCALAPPDATA", "~/AppData/Local")
    elif sys.platform == "darwin":
        root = "~/Library/Caches"
    else:
        root = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(root).expanduser() / "safe_inspect"


@functools.cache
def digest_of(package: Path = PACKAGE) -> str:
    """Return a digest of all files of a package that define compiled functions."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        source = path.read_bytes()
        if b"@njit" in source:
            digest.update(path.relative_to(package).as_posix().encode() + b"\0" + source)
    return digest.hexdigest()


def installed_folder(digest: str, package: Path | None = None) -> Path:
    """Return the folder in a package for machine code of its sources, which have a digest."""
    return (package or PACKAGE) / "__pycache__" / "machine_code" / digest[:16]


@functools.cache
def machine_code_folder(digest: str, given: str = "") -> Path | None:
    """Return a folder for machine code of the package's present sources; None where none can be written.

    It is the folder that the user names, else one in the package, else one of the user's. What the package has and
    cannot be written, such as the machine code of a container image, is copied to that of the user's.

    Args:
        digest: Digest of the sources, see `digest_of`.
        given: The folder that the user names with ``NUMBA_CACHE_DIR``; empty if none.
    """
    if given:
        folder = Path(given) / "safe_inspect" / digest[:16]
        return folder if _can_be_written(folder) else None
    installed = installed_folder(digest)
    for folder in (installed, user_folder() / digest[:16]):
        fresh = not folder.is_dir()
        if _can_be_written(folder):
            if fresh and folder != installed and installed.is_dir():
                with suppress(OSError, shutil.Error):
                    shutil.copytree(installed, folder, dirs_exist_ok=True)
            _remove_old(folder.parent)
            return folder
    return None


def _can_be_written(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
        os.utime(folder)  # says when it was used last
    except OSError:
        return False
    return True


def _remove_old(parent: Path) -> None:
    """Remove all folders of machine code but those that were used last."""
    with suppress(OSError):
        own = [path for path in parent.iterdir() if path.is_dir() and re.fullmatch("[0-9a-f]{16}", path.name)]
        used = sorted(own, key=lambda path: path.stat().st_mtime)
        for path in used[:-_STATES]:
            shutil.rmtree(path, ignore_errors=True)


def digest_of_files(paths: Iterable[str]) -> str:
    """Return a digest of the names and lines of files, such as those that define the kernels that one calls."""
    digest = hashlib.sha256()
    for path in sorted(set(paths)):
        linecache.checkcache(path)
        digest.update("".join((os.path.basename(path), "\0", *linecache.getlines(path))).encode())
    return digest.hexdigest()
