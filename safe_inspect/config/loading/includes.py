"""Paths at which an included file is searched, and hints for files that are not found."""

from __future__ import annotations

import difflib
import os
from pathlib import Path

from safe_inspect.config.data import configs_root


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


def hint(name: str, tried: list[Path], including: Path | None) -> str:
    """Return a suggestion for the name of a file that was not found; empty if no name is similar."""
    if including is not None and not name.startswith(".") and os.path.isfile(including.parent / name):
        return f"to include the file next to this one, write `./{name}`"
    for place in tried:
        near = _near(place, including)
        if near is not None:
            rest = len(place.parts) - len(near.parts)
            written = Path(name).parts
            start = len(written) - rest - 1
            if start >= 0:
                lead = "./" if name.startswith("./") else ""
                spelled = Path(*written[:start], near.name, *written[start + 1 :]).as_posix()
                return f"did you mean `{lead}{spelled}`?"
    return ""


def _near(place: Path, but: Path | None) -> Path | None:
    """Return the existing file or folder, other than a given one, whose name is most similar to what is missing."""
    missing = place
    while not os.path.isdir(missing.parent):  # also for names that are too long
        if missing.parent == missing:
            return None
        missing = missing.parent
    last = missing == place
    try:
        names = [entry.name for entry in os.scandir(missing.parent) if entry.is_file() == last and Path(entry) != but]
    except OSError:
        return None
    near = difflib.get_close_matches(missing.name, names, n=1, cutoff=0.6)
    return missing.parent / near[0] if near else None


def display_path(path: Path) -> str:
    """Return a path as messages print it: relative to the working directory if it is inside it."""
    below = path.is_relative_to(Path.cwd())
    return (path.relative_to(Path.cwd()) if below else path).as_posix()
