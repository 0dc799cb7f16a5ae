"""Files and folders that a user names: written next to their place, and moved there when they are complete.

A command that is stopped, fails or finds the disk full leaves what was there before, and nothing half-written. A folder
that exists is refused, unless the same command wrote it and may replace it; nothing else is ever removed.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from safe_inspect.errors import OutputError

#: The errors of a place that is full: of the disk, of the user's share, and of the process's limit.
NO_SPACE = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
#: Name of the file by which a folder is locked.
LOCK = ".lock"
#: Name of the file that says which command wrote a folder, and which files in it.
MARKER = ".safe_inspect.json"
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
        with _parent(target):
            try:
                _check_access(target)
                yield work
                if not special:
                    os.replace(work, target)
            finally:
                if not special:
                    with suppress(OSError):
                        work.unlink()
    except OutputError:
        raise
    except OSError as error:
        raise cannot_write(path, error, hint) from None


@contextmanager
def new_folder(
    path: str | os.PathLike[str], command: str, *, force: bool = False, hint: str = "give another folder"
) -> Iterator[Path]:
    """Give a folder to write into, which is moved to `path` when the block ends well, and is removed otherwise.

    The folder gets the file `MARKER`, which names the command and lists the files that it wrote. Nothing else is ever
    replaced or removed.

    Args:
        path: Where it will be; nothing may exist there.
        command: What writes the folder, such as ``evaluate``.
        force: Whether `path` may be a folder that the same command wrote; it is replaced when the new one is complete.
        hint: What to do when it cannot be written.

    Raises:
        OutputError: Something exists at `path` that may not be replaced, or the folder cannot be written.
    """
    target = Path(path).expanduser().absolute()
    work = None
    try:
        check_new_folder(path, command, force=force, hint=hint)
        with _parent(target):
            try:
                work = Path(tempfile.mkdtemp(prefix=f".{target.name}.", suffix=".new", dir=target.parent))
                os.chmod(work, 0o777 & ~_umask())
                yield work
                mark_folder(work, command, _files(work))
                try:
                    check_new_folder(path, command, force=force, hint=hint)
                except OutputError as error:
                    kept, work = work, None
                    raise OutputError(f"{error}; what was written is in {kept}") from None
                _put(work, target)
            finally:
                if work is not None:
                    shutil.rmtree(work, ignore_errors=True)
    except OutputError:
        raise
    except OSError as error:
        raise cannot_write(path, error, hint, "folder") from None


def check_new_folder(
    path: str | os.PathLike[str], command: str, *, force: bool = False, hint: str = "give another folder"
) -> None:
    """Check that `new_folder` may write a folder, before there is anything to write; see there for the arguments.

    Raises:
        OutputError: Something exists at `path` that may not be replaced.
    """
    target = Path(path).expanduser().absolute()
    if not os.path.lexists(target):
        return
    if target.is_symlink() or not target.is_dir():
        raise OutputError(f"{path}: this is a file or a link, so no folder can be written there; {hint}")
    if Path.cwd().is_relative_to(target.resolve()):
        raise OutputError(f"{path}: the working directory is in this folder, so it is not replaced; {hint}")
    if not force:
        raise OutputError(f"{path}: the folder exists already; {hint}, or replace what this command wrote: --force")
    marker = read_marker(target)
    if marker["command"] != command:
        raise OutputError(
            f"{path}: nothing in this folder says that `{command}` wrote it, so it is not replaced; {hint}"
        )
    foreign = next((name for name in _files(target) if name not in marker["files"] | {MARKER}), None)
    if foreign is not None:
        raise OutputError(f"{path}: {foreign!r} in it is of another origin, so the folder is not replaced; {hint}")


def mark_folder(folder: Path, command: str, files: Iterable[str], **about: Any) -> None:
    """Write the file that says which command wrote a folder, and which files.

    Args:
        folder: The folder.
        command: The command.
        files: Their paths in the folder.
        about: What else is noted, as JSON knows it.

    Raises:
        OSError: It cannot be written.
    """
    work = folder / f"{MARKER}.new"
    work.write_text(json.dumps({"command": command, "files": sorted(files), **about}, default=str) + "\n", "utf-8")
    os.replace(work, folder / MARKER)


def read_marker(folder: Path) -> Mapping[str, Any]:
    """Return what `mark_folder` wrote; the command is empty where there is no such file."""
    try:
        content = json.loads((folder / MARKER).read_text(encoding="utf-8"))
        return {**content, "command": str(content["command"]), "files": {str(name) for name in content["files"]}}
    except (OSError, ValueError, KeyError, TypeError):
        return {"command": "", "files": set()}


def remove_written(folder: Path, leave: Iterable[str] = ()) -> None:
    """Remove the files of a folder that its marker lists, and the folder unless something else is in it.

    Args:
        folder: The folder.
        leave: Files that are not removed.
    """
    written = (read_marker(folder)["files"] | {MARKER, f"{MARKER}.new", LOCK}) - set(leave)
    for name in _files(folder):
        if name in written:
            with suppress(OSError):
                (folder / name).unlink()
    for place, _, _ in os.walk(folder, topdown=False):
        with suppress(OSError):
            os.rmdir(place)


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


def check_writable(path: Path, endings: Collection[str] = ()) -> None:
    """Check that `new_file` will be able to write a file that a user names, before there is anything to write.

    Args:
        path: The file.
        endings: Those of the format that is written: an existing file with another ending is not replaced.

    Raises:
        OutputError: It cannot be written, or is not replaced.
    """
    if endings and path.is_file() and path.suffix.lower() not in endings:
        raise OutputError(
            f"{path}: the file exists already, and only a file that ends in {' or '.join(endings)} is replaced; give "
            "another file"
        )
    if path.is_dir():
        raise OutputError(f"{path}: the file cannot be written (it is a folder); give a file")
    target = path.expanduser()
    try:
        with _parent(target, keep=False):
            _check_access(target)
            if target.is_file() or not target.exists():
                with tempfile.NamedTemporaryFile(dir=target.absolute().parent, prefix=f".{target.name}."):
                    pass
    except OSError as error:
        raise cannot_write(path, error) from None


def check_parent(folder: Path, hint: str = "give another with --output") -> None:
    """Check that a folder can be made, or written into, before there is anything to write; nothing is left.

    Raises:
        OutputError: It cannot.
    """
    place = folder.expanduser().absolute()
    while not os.path.lexists(place):
        place = place.parent
    try:
        with tempfile.TemporaryDirectory(dir=place, prefix=".safe_inspect."):
            pass
    except OSError as error:
        raise cannot_write(folder, error, hint, "output folder") from None


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


@contextmanager
def _parent(target: Path, *, keep: bool = True) -> Iterator[None]:
    """Create the missing parent folders of a path; remove them when the block fails, or without `keep` in any case."""
    missing = [folder for folder in target.absolute().parents if not folder.exists()]
    complete = False
    try:
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
        except FileExistsError:
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR)) from None
        yield
        complete = keep
    finally:
        for folder in [] if complete else missing:
            with suppress(OSError):  # not made, or no longer empty
                folder.rmdir()


def _check_access(target: Path) -> None:
    """Refuse to replace a file that is read-only."""
    if target.exists() and not os.access(target, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


def _files(folder: Path) -> list[str]:
    """Return the paths in a folder of all that is no folder, and of all empty folders."""
    found = []
    for place, folders, files in os.walk(folder):
        names = files + [name for name in folders if os.path.islink(os.path.join(place, name))]
        if not folders and not files and place != str(folder):
            names = ["."]
        found += [os.path.relpath(os.path.join(place, name), folder) for name in names]
    return sorted(found)


def _put(work: Path, target: Path) -> None:
    """Move a complete folder to its place; what the command wrote there before goes when the new one is in it."""
    old = work.with_suffix(".old")
    try:
        if os.path.lexists(target):
            os.replace(target, old)
        os.replace(work, target)
    finally:
        if not os.path.lexists(target) and old.exists():
            os.replace(old, target)
        if old.exists():
            remove_written(old)


def _umask() -> int:
    """Return the mask of new files, which can only be read by setting it."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


def check_ending(path: Path, endings: Sequence[str], what: str, option: str = "--output") -> None:
    """Refuse a file that cannot be written in the format of its name, before there is anything to write.

    Args:
        path: The file.
        endings: Those of the formats that can be written, such as ``.png``.
        what: What is written, such as ``figure``.
        option: The option that names the file.

    Raises:
        OutputError: The name has another ending, or the file cannot be written.
    """
    if path.suffix.lower() not in endings:
        raise OutputError(
            f"{path}: the name of the {what} ends in {', '.join(endings)}; give such a file with {option}"
        )
    check_writable(path)
