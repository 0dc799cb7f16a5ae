"""Output files and folders: written to a temporary path in the same folder, and moved to their place when complete.

If a command is stopped, fails or finds the disk full, the previous output is unchanged and nothing incomplete is left.
An existing folder is an error unless the same command wrote it and may replace it; nothing else is ever removed.
"""

from __future__ import annotations

import errno
import json
import os
import secrets
import shutil
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from safe_inspect.errors import OutputError

#: Error numbers for a full disk, an exceeded quota, and the file size limit of the process.
NO_SPACE = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
#: Name of the lock file of a folder.
LOCK = ".lock"
#: Name of the file with the command that wrote a folder, and the files that it wrote.
MARKER = ".safe_inspect.json"
#: Size of a small file [bytes].
_SMALL = 2**20


@contextmanager
def new_file(path: str | os.PathLike[str], hint: str = "give another file") -> Iterator[Path]:
    """Yield a temporary path; its file replaces `path` when the block succeeds, and is removed otherwise.

    The temporary path has the suffix of `path`. Missing folders are created. Anything other than a regular file, such
    as ``/dev/stdout`` or a pipe, is written directly.

    Args:
        path: Path of the file; a symbolic link is followed.
        hint: Advice for the error message.

    Raises:
        OutputError: The file cannot be written.
    """
    target = Path(path).expanduser()
    special = target.exists() and not target.is_file()
    target = target if special else Path(os.path.realpath(target))
    work = target if special else target.with_name(f".{target.stem}.{os.getpid()}.new{target.suffix}")
    with _explained(path, hint), _parent(target):
        try:
            _check_access(target)
            yield work
            if not special:
                os.replace(work, target)
        finally:
            if not special:
                with suppress(OSError):
                    work.unlink()


@contextmanager
def new_folder(path: str | os.PathLike[str], command: str, *, force: bool = False) -> Iterator[Path]:
    """Yield a temporary folder, which is moved to `path` when the block succeeds, and is removed otherwise.

    The folder gets the file `MARKER`, which contains the command and lists the files that it wrote. No other files are
    replaced or removed.

    Args:
        path: Path of the folder, which must not exist.
        command: The command that writes the folder, such as ``evaluate``.
        force: Whether `path` may be a folder of the same command; it is replaced when the new one is complete.

    Raises:
        OutputError: `path` exists and may not be replaced, or the folder cannot be written.
    """
    target = Path(path).expanduser().absolute()
    work, kept = target.parent / f".{target.name}.{secrets.token_hex(4)}.new", False
    with _explained(path, "give another folder", "folder"):
        check_new_folder(path, command, force=force)
        with _parent(target):
            try:
                work.mkdir()
                yield work
                mark_folder(work, command, _files(work))
                try:
                    check_new_folder(path, command, force=force)
                except OutputError as error:
                    kept = True
                    raise OutputError(f"{error}; what was written is in {work}") from None
                _put(work, target)
            finally:
                if not kept:
                    shutil.rmtree(work, ignore_errors=True)


def check_new_folder(path: str | os.PathLike[str], command: str, *, force: bool = False) -> None:
    """Check in advance that `new_folder` can write a folder; the arguments are the same.

    Raises:
        OutputError: `path` exists and may not be replaced.
    """
    target, hint = Path(path).expanduser().absolute(), "give another folder"
    if not os.path.lexists(target):
        return
    if target.is_symlink() or not target.is_dir():
        raise OutputError(f"{path}: this is a file or a symbolic link, so no folder can be written there; {hint}")
    if Path.cwd().is_relative_to(target.resolve()):
        raise OutputError(f"{path}: the working directory is in this folder, so it is not replaced; {hint}")
    if not force:
        raise OutputError(f"{path}: the folder exists already; {hint}, or replace what this command wrote: --force")
    marker = read_marker(target)
    if marker["command"] != command:
        raise OutputError(f"{path}: this folder is not marked as written by `{command}`, so it is not replaced; {hint}")
    foreign = next((name for name in _files(target) if name not in marker["files"] | {MARKER}), None)
    if foreign is not None:
        raise OutputError(f"{path}: it contains {foreign!r} of another origin, so it is not replaced; {hint}")


def mark_folder(folder: Path, command: str, files: Iterable[str], **about: Any) -> None:
    """Write the file that states which command wrote a folder, and which files in it.

    Args:
        folder: The folder.
        command: The command.
        files: Paths of the files in the folder.
        about: Additional entries, which must be valid JSON.

    Raises:
        OSError: The file cannot be written.
    """
    work = folder / f"{MARKER}.new"
    work.write_text(json.dumps({"command": command, "files": sorted(files), **about}, default=str) + "\n", "utf-8")
    os.replace(work, folder / MARKER)


def read_marker(folder: Path) -> Mapping[str, Any]:
    """Return the content of the file that `mark_folder` writes; without one, the command is empty."""
    try:
        content = json.loads((folder / MARKER).read_text(encoding="utf-8"))
        return {**content, "command": str(content["command"]), "files": {str(name) for name in content["files"]}}
    except (OSError, ValueError, KeyError, TypeError):
        return {"command": "", "files": set()}


def remove_written(folder: Path, leave: Iterable[str] = ()) -> None:
    """Remove the files of a folder that its marker lists, and the folder itself if it is empty then.

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
    """Lock a folder against other processes; the lock ends with the process.

    Args:
        folder: An existing folder; the file ``.lock`` is created in it.
        use: Verb for the message "another process is ... this folder".

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
    """Check in advance that `new_file` can write a file.

    Args:
        path: The file.
        endings: Suffixes of the format; an existing file with another suffix is not replaced.

    Raises:
        OutputError: The file cannot be written or is not replaced.
    """
    if endings and path.is_file() and path.suffix.lower() not in endings:
        raise OutputError(
            f"{path}: the file exists, and only files that end in {' or '.join(endings)} are replaced; give "
            "another file"
        )
    if path.is_dir():
        raise OutputError(f"{path}: the file cannot be written (it is a folder); give a file")
    target = path.expanduser()
    with _explained(path), _parent(target, keep=False):
        _check_access(target)
        if target.is_file() or not target.exists():
            tempfile.NamedTemporaryFile(dir=target.absolute().parent, prefix=f".{target.name}.").close()


def check_parent(folder: Path) -> None:
    """Check in advance that a folder can be created or written to; the check leaves nothing behind.

    Raises:
        OutputError: The folder cannot be created or written to.
    """
    place = folder.expanduser().absolute()
    while not os.path.lexists(place):
        place = place.parent
    with _explained(folder, "give another with --output", "output folder"):
        tempfile.TemporaryDirectory(dir=place, prefix=".safe_inspect.").cleanup()


def cannot_write(
    path: str | os.PathLike[str], error: OSError, hint: str = "give another file", what: str = "file"
) -> OutputError:
    """Return the error of an output that cannot be written, with its cause and a hint."""
    reason = error.strerror or str(error)
    if error.errno in NO_SPACE:  # PyArrow has another text for it
        reason, hint = os.strerror(error.errno), f"free some space, or {hint}"
    return OutputError(f"{os.fspath(path)}: the {what} cannot be written ({reason}); {hint}")


def is_full(folder: Path) -> bool:
    """Return whether there is no space for even a small file in a folder."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(_SMALL))
            file.flush()
    except OSError as error:
        return error.errno in NO_SPACE
    return False


@contextmanager
def _explained(path: str | os.PathLike[str], hint: str = "give another file", what: str = "file") -> Iterator[None]:
    """Raise `cannot_write` in place of errors of the operating system in a block."""
    try:
        yield
    except OutputError:
        raise
    except OSError as error:
        raise cannot_write(path, error, hint, what) from None


@contextmanager
def _parent(target: Path, *, keep: bool = True) -> Iterator[None]:
    """Create the missing parent folders of a path; remove them if the block fails, or always without `keep`."""
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
            with suppress(OSError):  # not created, or no longer empty
                folder.rmdir()


def _check_access(target: Path) -> None:
    """Raise PermissionError if the file is read-only."""
    if target.exists() and not os.access(target, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


def _files(folder: Path) -> list[str]:
    """Return the paths in a folder of everything that is not a folder, and of all empty folders."""
    found = []
    for place, folders, files in os.walk(folder):
        names = files + [name for name in folders if os.path.islink(os.path.join(place, name))]
        if not folders and not files and place != str(folder):
            names = ["."]
        found += [os.path.relpath(os.path.join(place, name), folder) for name in names]
    return sorted(found)


def _put(work: Path, target: Path) -> None:
    """Move a complete folder to its place; earlier files of the command are removed after that."""
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


def check_ending(path: Path, endings: Sequence[str], what: str, option: str = "--output") -> None:
    """Check in advance that a file can be written in the format of its suffix.

    Args:
        path: The file.
        endings: Suffixes of the formats that can be written, such as ``.png``.
        what: Kind of content, such as ``figure``.
        option: The command line option of the file.

    Raises:
        OutputError: The name has another suffix, or the file cannot be written.
    """
    if path.suffix.lower() not in endings:
        raise OutputError(
            f"{path}: the name of the {what} must end in {', '.join(endings)}; give such a name with {option}"
        )
    check_writable(path)
