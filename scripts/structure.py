"""Measures of the structure of the source: folders that import each other, hidden imports, options declared twice."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

#: Parts of Numba that its documentation describes, although they lie in ``numba.core``: its guide to extensions, and
#: its page "Event API".
_DOCUMENTED = {"types", "cgutils", "errors", "NumbaError", "TypingError", "event"}
#: A dataclass repeats the options of a plugin where so many of its fields with a default are fields of the plugin too.
_TWIN_FIELDS = 2


def place_of(module: str) -> str:
    """Return the folder, or the file next to the folders, to which a module belongs on the second level."""
    return ".".join(module.split(".")[:3])


def folder_graph(imports: dict[str, set[str]]) -> dict[str, set[str]]:
    """Return which places of the second level import which; packages that only pass names on do not count.

    Args:
        imports: The modules that each module imports.
    """
    found: dict[str, set[str]] = defaultdict(set)
    for name, others in imports.items():
        for other in others:
            ends = place_of(name), place_of(other)
            if ends[0] != ends[1] and all(end.count(".") == 2 for end in ends):
                found[ends[0]].add(ends[1])
                found[ends[1]] |= set()
    return dict(found)


def imports_by_string(trees: dict[str, ast.Module]) -> list[str]:
    """Return the calls of `import_module` that name a module of this package, or one that is only known at run time."""
    return [
        f"{module}:{node.lineno}"
        for module, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and _name(node.func) == "import_module" and node.args
    ]


def _name(node: ast.expr) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def private_names(trees: dict[str, ast.Module], library: str) -> set[str]:
    """Return the private names of a library that the source uses: of private modules, or with a leading underscore.

    Args:
        trees: The modules.
        library: "numba" or "ray".
    """
    found = set()
    for tree in trees.values():
        known = set()  # names that come from the library
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == library:
                hidden = f"{library}._" in node.module or node.module.startswith("numba.core")
                known |= {alias.asname or alias.name for alias in node.names}
                found |= {alias.name for alias in node.names if hidden or alias.name[0] == "_"} - _DOCUMENTED
            elif isinstance(node, ast.Import):
                known |= {alias.name.split(".")[0] for alias in node.names if alias.name.split(".")[0] == library}
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and re.match(r"_[a-z]", node.attr) and _root(node) in known:
                found.add(node.attr)
    return found


def _root(node: ast.expr) -> str:
    """Return the name at which a chain of attributes begins."""
    while isinstance(node, ast.Attribute | ast.Call):
        node = node.value if isinstance(node, ast.Attribute) else node.func
    return node.id if isinstance(node, ast.Name) else ""


def _fields(node: ast.ClassDef) -> Iterator[str]:
    """Yield the annotated fields of a class that have a default."""
    for line in node.body:
        if isinstance(line, ast.AnnAssign) and isinstance(line.target, ast.Name) and line.value is not None:
            yield line.target.id


def option_twins(trees: dict[str, ast.Module], options: dict[str, set[str]]) -> list[str]:
    """Return the dataclasses that declare options of a plugin of the same package again, with separate defaults.

    Args:
        trees: The modules.
        options: The fields of each plugin, by its module and name: "safe_inspect.room.module:Name".
    """
    found = []
    for module, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                marks = {_name(mark.func if isinstance(mark, ast.Call) else mark) for mark in node.decorator_list}
                fields = set(_fields(node))
                beside = [names for key, names in options.items() if key.split(".")[1] == module.split(".")[1]]
                if "dataclass" in marks and any(len(fields & names) >= _TWIN_FIELDS for names in beside):
                    found.append(f"{module}:{node.name}")
    return sorted(found)


def unset_fields(options: dict[str, set[str]], places: list[Path]) -> set[str]:
    """Return the fields of plugins, "Plugin.field", whose name no file below some places mentions.

    Args:
        options: The fields of each plugin.
        places: Folders and files of configurations, tests, examples and documentation.
    """
    words: set[str] = set()
    for place in places:
        files = (
            [place] if place.is_file() else [path for end in ("yml", "py", "md") for path in place.rglob(f"*.{end}")]
        )
        for path in files:
            words |= set(re.findall(r"\w+", path.read_text(encoding="utf-8")))
    return {f"{plugin}.{name}" for plugin, names in options.items() for name in names if name not in words}
