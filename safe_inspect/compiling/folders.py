"""Folders for machine code: in the package or, if that cannot be written, a folder of the user."""

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
#: Number of versions of the sources whose machine code is stored, including the present one.
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
    """Return a digest of all files of a package that define compiled functions, and of those that they import.

    They may import constants, which become part of the machine code.
    """
    sources = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package.parent).with_suffix("").parts
        if "__pycache__" not in parts:  # generated sources, which another process may remove
            sources[".".join(parts).removesuffix(".__init__")] = path.read_bytes()
    imports = re.compile(rf"^from ({re.escape(package.name)}[\w.]*) import \(?([\w, \n]*)", re.MULTILINE)
    found: set[str] = set()
    waiting = [name for name, source in sources.items() if b"@njit" in source]
    while waiting:
        name = waiting.pop()
        if name in sources and name not in found:
            found.add(name)
            for module, members in imports.findall(sources[name].decode()):
                waiting += [module, *(f"{module}.{member}" for member in re.findall(r"\w+", members))]
    digest = hashlib.sha256()
    for name in sorted(found):
        digest.update(name.encode() + b"\0" + sources[name])
    return digest.hexdigest()


def installed_folder(digest: str, package: Path | None = None) -> Path:
    """Return the folder in a package for the machine code of sources with a digest."""
    return (package or PACKAGE) / "__pycache__" / "machine_code" / digest[:16]


@functools.cache
def machine_code_folder(digest: str, given: str = "") -> Path | None:
    """Return the folder for machine code of the present sources of the package, or None if none can be written.

    It is the folder that the user has set, otherwise one in the package, otherwise one in the user's home. Existing
    machine code in a package that cannot be written, such as that of a container image, is copied to the user's folder.

    Args:
        digest: Digest of the sources, see `digest_of`.
        given: The folder that the user has set with ``NUMBA_CACHE_DIR``; empty if there is none.
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
        os.utime(folder)  # records the time of the last use
    except OSError:
        return False
    return True


def _remove_old(parent: Path) -> None:
    """Remove all folders of machine code except those that were used most recently."""
    with suppress(OSError):
        own = [path for path in parent.iterdir() if path.is_dir() and re.fullmatch("[0-9a-f]{16}", path.name)]
        used = sorted(own, key=lambda path: path.stat().st_mtime)
        for path in used[:-_STATES]:
            shutil.rmtree(path, ignore_errors=True)


def digest_of_files(paths: Iterable[str]) -> str:
    """Return a digest of the names and contents of files, such as those that define the kernels that a kernel calls."""
    digest = hashlib.sha256()
    for path in sorted(set(paths)):
        linecache.checkcache(path)
        digest.update("".join((os.path.basename(path), "\0", *linecache.getlines(path))).encode())
    return digest.hexdigest()
