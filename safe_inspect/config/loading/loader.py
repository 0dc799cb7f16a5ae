"""The configuration loader, which converts YAML files to a tree with the location of each key.

The language is YAML 1.1 with safe types; no tag evaluates code. There are three
additional tags. ``!include FILE`` is replaced by the contents of the file: ``./FILE`` is next to
the including file; any other name is searched in the working directory, in the folder above
the including file that contains ``configs``, and in the package's own configurations.
``!include-extend FILE``, an item of a list, is replaced by the items of the list in
that file. ``key: !remove`` in a mapping that is merged removes the key of an earlier one.
"""

from __future__ import annotations

import difflib
import os
from pathlib import Path
from typing import Any

from safe_inspect.config.data import configs_root
from safe_inspect.config.loading.construct import Constructor
from safe_inspect.config.loading.located import KeyPath, Place, locate, value_at
from safe_inspect.config.loading.syntax import compose, decode
from safe_inspect.errors import ConfigError, Location, Problem, RegistryError
from safe_inspect.plugins.registry import PEERS, import_user_module


def places(name: str, including: Path | None, outermost: Path | None) -> list[Path]:
    """Return the paths that the name of an included file can refer to, in the order in which they are tried.

    Args:
        name: The name as written.
        including: The file that includes it; None for the command line.
        outermost: The file whose loading started the includes.
    """
    path = Path(name)
    if path.is_absolute():
        return [path]
    if name.startswith(("./", "../")):
        return [(including.parent if including else Path.cwd()) / path]
    found = [Path.cwd() / path]
    for file in filter(None, (outermost, including)):  # the nearest folder above the file that contains `configs`
        found += [folder / path for folder in file.parents if (folder / "configs").is_dir()][:1]
    inside = path.relative_to("configs") if path.parts[:1] == ("configs",) else path
    found.append(configs_root() / inside)
    return list(dict.fromkeys(Path(os.path.normpath(place)) for place in found))


def _similar_file(name: str, tried: list[Path], including: Path | None) -> str:
    """Return a suggestion for the name of a file that was not found; empty if no name is similar."""
    if including is not None and not name.startswith(".") and os.path.isfile(including.parent / name):
        return f"to include the file next to this one, write `./{name}`"
    written = Path(name).parts
    for place in tried:
        missing = place
        while missing != missing.parent and not os.path.isdir(missing.parent):  # also for names that are too long
            missing = missing.parent
        try:
            entries = [entry for entry in os.scandir(missing.parent) if entry.is_file() == (missing == place)]
        except OSError:
            continue
        names = [entry.name for entry in entries if Path(entry) != including]
        near = difflib.get_close_matches(missing.name, names, n=1)
        start = len(written) - 1 - len(place.parts) + len(missing.parts)
        if near and start >= 0:
            lead = "./" if name.startswith("./") else ""
            spelled = Path(*written[:start], near[0], *written[start + 1 :]).as_posix()
            return f"did you mean `{lead}{spelled}`?"
    return ""


def _display_path(path: Path) -> str:
    """Return a path as messages print it: relative to the working directory if it is inside it."""
    below = path.is_relative_to(Path.cwd())
    return (path.relative_to(Path.cwd()) if below else path).as_posix()


#: The largest file that is parsed [bytes], and the largest number of values in a tree, where aliases and includes count
#: every time they are used. The shipped experiments are files of a few kilobytes and have 500 to 2,000 values.
MAX_BYTES, MAX_VALUES = 1_000_000, 200_000


def load(path: str | os.PathLike[str]) -> Any:
    """Load a configuration file and everything that it includes.

    A name that starts with ``configs/`` and is not in the working directory is
    searched in the package's own configurations.

    Returns:
        The tree: `LocatedDict`, `LocatedList` and plain values.

    Raises:
        ConfigError: With all mistakes of all files, each with its file and line.
    """
    if not isinstance(path, str | os.PathLike):
        raise ConfigError(Problem(f"a configuration must be the path of a file, not {path!r:.60}"))
    return _finish(loading := _Loading(), loading.include(os.fspath(path), None))


def load_if_path(value: Any, location: Location | None = None) -> Any:
    """Load the file that a value names, if the value is a string that ends with ``.yml`` or ``.yaml``.

    Published configurations of safe-autonomy-sims contain plain paths in place of ``!include``.

    Args:
        value: Any value; it is returned unchanged if it does not name a file.
        location: Location of the value, for ``./`` and for messages.

    Raises:
        ConfigError: As for `load`.
    """
    if not isinstance(value, str) or not value.endswith((".yml", ".yaml")):
        return value
    return _finish(loading := _Loading(), loading.include(value, location))


def parse(text: str, location: Location) -> Any:
    """Parse YAML that is not in a file, such as a value on the command line; all of it gets the given location.

    Raises:
        ConfigError: As for `load`.
    """
    loading = _Loading()
    try:
        node = compose(text, location.file)
    except ConfigError as error:
        raise ConfigError([Problem(problem.message, location=location) for problem in error.problems]) from None
    constructor = Constructor(lambda mark: location, loading.include, loading.problems)
    return _finish(loading, None if node is None else constructor.document(node))


def import_plugins(tree: Any, where: KeyPath) -> None:
    """Import the modules in the list at a path of a tree, except those of safe-autonomy-sims, which are built in.

    Raises:
        ConfigError: Modules are missing or cannot be imported; all are listed.
    """
    paths, problems = value_at(tree, where), list[Problem]()
    for index, name in enumerate(paths if isinstance(paths, list) else ()):
        if str(name).split(".")[0] in PEERS:
            continue
        try:
            import_user_module(str(name))
        except RegistryError as error:
            Place(tree, problems, tuple(where)).report(str(error), index)
    if problems:
        raise ConfigError(problems)


def _finish(loading: _Loading, tree: Any) -> Any:
    if loading.problems:
        raise ConfigError(loading.problems)
    count = _count(tree, {})
    if count > MAX_VALUES:
        message = f"with its aliases and includes it has {count:.3g} values; at most {MAX_VALUES:,} are allowed"
        hint = "use fewer aliases, or a template (`count`)"
        raise ConfigError(Problem(message, location=locate(tree, ()), hint=hint))
    return tree


def _count(tree: Any, known: dict[int, int]) -> int:
    """Return the number of values of a tree with all aliases expanded; each shared container is visited once."""
    if not isinstance(tree, (dict, list)):
        return 1
    if id(tree) not in known:
        known[id(tree)] = 1 + sum(_count(value, known) for value in (tree.values() if isinstance(tree, dict) else tree))
    return known[id(tree)]


def _open_at_once(path: str, flags: int) -> int:
    """Open a file for reading; a named pipe without a writer is read as empty instead of waiting for one."""
    descriptor = os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
    if hasattr(os, "O_NONBLOCK"):
        os.set_blocking(descriptor, True)
    return descriptor


class _Loading:
    """State of one call of the loader: every file is read once, and all mistakes are collected."""

    def __init__(self) -> None:
        self.problems: list[Problem] = []
        self._trees: dict[Path, Any] = {}
        self._chain: list[Path] = []

    def include(self, name: str, location: Location | None) -> Any:
        """Return the tree of a file, or None if there was a mistake."""
        including = Path(os.path.abspath(location.file)) if location is not None and location.line else None
        outermost = self._chain[0] if self._chain else including
        tried = places(name, including, outermost)
        path = next((place for place in tried if os.path.lexists(place)), None)
        if path is None:
            what = "no file" if location is None else "the included file does not exist:"
            looked = ", ".join(_display_path(place) for place in tried)
            return self._wrong(f"{what} {name!r} (searched: {looked})", location, _similar_file(name, tried, including))
        if path in self._chain:
            chain = [*self._chain[self._chain.index(path) :], path]
            arrows = " -> ".join(_display_path(file) for file in chain)
            return self._wrong(f"circular `!include`: {arrows}", location, "remove one `!include`")
        if path not in self._trees:
            self._chain.append(path)
            try:
                self._trees[path] = self._read(path, location)
            finally:
                self._chain.pop()
        return self._trees[path]

    def _read(self, path: Path, location: Location | None) -> Any:
        file = _display_path(path)
        if path.is_dir():
            names = sorted(entry.name for entry in path.iterdir() if entry.suffix in (".yml", ".yaml"))
            files = f"name one of its files: {', '.join(names)}" if names else "name a file"
            return self._wrong(f"{file!r} is a directory", location, files)
        try:
            with open(path, "rb", opener=_open_at_once) as stream:
                data = stream.read(MAX_BYTES + 1)
        except OSError as error:
            link = f", a symbolic link to {os.readlink(path)!r}" if path.is_symlink() else ""
            return self._wrong(f"cannot read {file!r}{link}: {error.strerror or error}", location, "")
        if len(data) > MAX_BYTES:
            hint = "if it is a configuration, split it and `!include` the parts"
            return self._wrong(f"{file!r} is larger than {MAX_BYTES / 1e6:g} MB", location, hint)
        try:
            node = compose(decode(data, file), file)
        except ConfigError as error:
            self.problems += error.problems
            return None
        if node is None:
            return self._wrong("the file is empty", Location(file, 1), "write a mapping, or `{}` for an empty one")

        def place(mark: Any) -> Location:
            return Location(file, mark.line + 1)

        return Constructor(place, self.include, self.problems).document(node)

    def _wrong(self, message: str, location: Location | None, hint: str) -> None:
        self.problems.append(Problem(message, location=location, hint=hint))
