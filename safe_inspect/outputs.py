"""Files and folders that a user names: written beside their place, and moved there when they are complete.

A command that is stopped, fails or finds the disk full leaves what stood there before, and nothing half-written.
"""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from safe_inspect.errors import OutputError

#: The errors of a place that is full: of the disk, of the user's share, and of the process's limit.
NO_SPACE = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
#: Name of the file by which a folder is locked.
LOCK = ".lock"
#: Size of a small file [bytes].
_SMALL = 2**20


@contextmanager
def new_file(path: str | os.PathLike[str], hint: str = "give another file") -> Iterator[Path]:
    """Give a path to write to; its file takes the place of `path` when the block ends well, and is removed otherwise.

    The path has the suffix of `path`. Missing folders are made. What is no regular file, such as ``/dev/stdout`` or a
    pipe, is written to itself.

    Args:
        path: Where the file will be; a symbolic link is followed.
        hint: What to do when it cannot be written.

    Raises:
        OutputError: It cannot be written.
    """
    target = Path(path).expanduser()
    special = target.exists() and not target.is_file()
    target = target if special else Path(os.path.realpath(target))
    work = target if special else target.with_name(f".{target.stem}.{os.getpid()}.new{target.suffix}")
    try:
        _make_parent(target)
        _check_access(target)
        yield work
        if not special:
            os.replace(work, target)
    except OutputError:
        raise
    except OSError as error:
        raise cannot_write(path, error, hint) from None
    finally:
        if not special:
            with suppress(OSError):
                work.unlink()


@contextmanager
def new_folder(path: str | os.PathLike[str], hint: str = "give another with --output") -> Iterator[Path]:
    """Give a folder to write into, which takes the place of `path` when the block ends well, and is removed otherwise.

    Args:
        path: Where it will be; a folder that stands there is replaced.
        hint: What to do when it cannot be written.

    Raises:
        OutputError: It cannot be written.
    """
    target = Path(path).expanduser().absolute()
    work = None
    try:
        _make_parent(target)
        work = Path(tempfile.mkdtemp(prefix=f".{target.name}.", suffix=".new", dir=target.parent))
        os.chmod(work, 0o777 & ~_umask())
        yield work
        _put(work, target)
    except OutputError:
        raise
    except OSError as error:
        raise cannot_write(path, error, hint, "folder") from None
    finally:
        if work is not None:
            shutil.rmtree(work, ignore_errors=True)


@contextmanager
def exclusive(folder: Path, use: str) -> Iterator[None]:
    """Keep other processes that ask for the same from a folder; the lock ends with the process.

    Args:
        folder: A folder that exists; the file ``.lock`` is made in it.
        use: What another process does there, as in "another process is ... this folder".

    Raises:
        OutputError: Another process has the lock.
    """
    try:
        import fcntl
    except ImportError:  # not on Windows
        yield
        return
    with open(folder / LOCK, "w", encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise OutputError(f"{folder}: another process is {use} this folder; wait for its end") from error
        yield


def check_writable(path: Path) -> None:
    """Check that `new_file` will be able to write a file, before there is anything to write.

    Raises:
        OutputError: It cannot.
    """
    if path.is_dir():
        raise OutputError(f"{path}: the file cannot be written (it is a folder); give a file")
    try:
        _make_parent(path)
        _check_access(path)
        if path.is_file() or not path.exists():
            with tempfile.NamedTemporaryFile(dir=path.expanduser().absolute().parent, prefix=f".{path.name}."):
                pass
    except OSError as error:
        raise cannot_write(path, error) from None


def cannot_write(
    path: str | os.PathLike[str], error: OSError, hint: str = "give another file", what: str = "file"
) -> OutputError:
    """Return the error of an output that cannot be written, with its cause and what to do."""
    reason = error.strerror or str(error)
    if error.errno in NO_SPACE:  # PyArrow words it otherwise
        reason, hint = os.strerror(error.errno), f"free some space, or {hint}"
    return OutputError(f"{os.fspath(path)}: the {what} cannot be written ({reason}); {hint}")


def is_full(folder: Path) -> bool:
    """Return whether not even a small file can be written into a folder for want of space."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(_SMALL))
            file.flush()
    except OSError as error:
        return error.errno in NO_SPACE
    return False


def _make_parent(target: Path) -> None:
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR)) from None


def _check_access(target: Path) -> None:
    """Refuse to replace a file that is read-only."""
    if target.exists() and not os.access(target, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


def _put(work: Path, target: Path) -> None:
    """Move a complete folder to its place; what stands there goes when the new one is in it."""
    old = work.with_suffix(".old")
    try:
        if os.path.lexists(target):
            os.replace(target, old)
        os.replace(work, target)
    finally:
        if not os.path.lexists(target) and old.exists():
            os.replace(old, target)
        shutil.rmtree(old, ignore_errors=True)


def _umask() -> int:
    """Return the mask of new files, which can only be read by setting it."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
