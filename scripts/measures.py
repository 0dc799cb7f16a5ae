"""Print the measures of the source, and hold them to what is recorded in `measures.json`: values that may only fall.

python scripts/measures.py                      # all measures, with what makes them up
python scripts/measures.py --write              # record the values that have fallen
python scripts/measures.py --write --for "..."  # record those that have risen too, with what they pay for
"""

from __future__ import annotations

import argparse
import ast
import inspect
import io
import json
import math
import sys
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.sparse.csgraph import connected_components
from structure import folder_graph, imports_by_string, option_twins, private_names, unset_fields

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "safe_inspect"
RECORD = Path(__file__).with_name("measures.json")
#: Values of this size are recorded in whole hundreds, so that a line more is no event.
_LARGE = 5000
MANY = 10
#: The folder with a module for each command.
COMMANDS = "safe_inspect/cli/commands"
Function = ast.FunctionDef | ast.AsyncFunctionDef


def modules() -> dict[str, ast.Module]:
    """Return the syntax tree of each module of the package by its dotted name."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        if "__pycache__" not in path.parts:
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
            found[name] = ast.parse(path.read_text(encoding="utf-8"))
    return found


def _imported(node: ast.AST, known: dict[str, ast.Module]) -> Iterator[str]:
    """Yield the modules of the package that an import statement names."""
    if isinstance(node, ast.ImportFrom) and node.module:
        for alias in node.names:
            whole = f"{node.module}.{alias.name}"
            yield from (name for name in (whole if whole in known else node.module,) if name in known)
    elif isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names if alias.name in known)


def _functions(tree: ast.AST) -> Iterator[Function]:
    return (node for node in ast.walk(tree) if isinstance(node, Function))


def imports(trees: dict[str, ast.Module]) -> dict[str, set[str]]:
    """Return the modules that each module imports; imports in functions and for type checkers count."""
    return {
        name: {other for node in ast.walk(tree) for other in _imported(node, trees)} - {name}
        for name, tree in trees.items()
    }


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Return the sets of nodes of a graph, modules or folders, that reach each other."""
    names = list(graph)
    matrix = np.zeros((len(names), len(names)), dtype=np.int8)
    for name, others in graph.items():
        for other in others:
            matrix[names.index(name), names.index(other)] = 1
    _, labels = connected_components(matrix, connection="strong")
    members = defaultdict(list)
    for name, label in zip(names, labels, strict=True):
        members[int(label)].append(name)
    return [group for group in members.values() if len(group) > 1]


def importers(module: str, trees: dict[str, ast.Module]) -> set[str]:
    """Return the modules that import a module, directly or not, and the module itself."""
    graph = imports(trees)
    found, waiting = set(), [module]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += [other for other, used in graph.items() if name in used]
    return found


def imports_in_functions(trees: dict[str, ast.Module]) -> dict[str, int]:
    """Return how many imports of the package's own modules stand inside functions, by module."""
    count: Counter[str] = Counter()
    for name, tree in trees.items():
        nodes = {node for function in _functions(tree) for node in ast.walk(function)}
        count[name] = sum(any(True for _ in _imported(node, trees)) for node in nodes)
    return {name: number for name, number in count.items() if number}


def folders() -> dict[str, int]:
    """Return the number of modules in each folder of the package; ``__init__.py`` does not count."""
    places = [PACKAGE, *(path.parent for path in PACKAGE.glob("**/__init__.py"))]
    return {
        place.relative_to(ROOT).as_posix(): len([path for path in place.glob("*.py") if not path.name.startswith("__")])
        for place in places
    }


def repeated_names(trees: dict[str, ast.Module]) -> dict[str, list[str]]:
    """Return the public functions, classes and constants that are defined in several modules."""
    places = defaultdict(set)
    for module, tree in trees.items():
        for node in tree.body:
            targets: list[str] = []
            if isinstance(node, Function | ast.ClassDef):
                targets = [node.name]
            elif isinstance(node, ast.Assign | ast.AnnAssign):
                given = node.targets if isinstance(node, ast.Assign) else [node.target]
                targets = [target.id for target in given if isinstance(target, ast.Name)]
            for target in targets:
                if not target.startswith("_"):
                    places[target].add(module)
    for name in ("main", "run", "add_arguments"):  # of each module that is a command
        places.pop(name, None)
    return {name: sorted(where) for name, where in places.items() if len(where) > 1}


def long_signatures(trees: dict[str, ast.Module]) -> dict[str, int]:
    """Return the functions with ten arguments or more."""
    found = {}
    for module, tree in trees.items():
        for function in _functions(tree):
            arguments = function.args
            count = len(arguments.posonlyargs) + len(arguments.args) + len(arguments.kwonlyargs)
            if count >= MANY:
                found[f"{module}:{function.name}"] = count
    return found


def public_names(trees: dict[str, ast.Module]) -> int:
    """Return how many public functions and classes the modules define at their top."""
    nodes = (node for tree in trees.values() for node in tree.body if isinstance(node, Function | ast.ClassDef))
    return sum(node.name[0] != "_" for node in nodes)


def code_lines() -> dict[str, int]:
    """Return the lines of code of each room: without blank lines, comments and docstrings."""
    found: Counter[str] = Counter()
    for path in PACKAGE.rglob("*.py"):
        if "__pycache__" in path.parts:
            continue
        parts = path.relative_to(PACKAGE).parts
        text = path.read_text(encoding="utf-8")
        documented = set()
        for node in ast.walk(ast.parse(text)):
            body = getattr(node, "body", None)
            if isinstance(node, ast.Module | ast.ClassDef | Function) and ast.get_docstring(node) and body:
                documented |= set(range(body[0].lineno, (body[0].end_lineno or 0) + 1))
        silent = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)
        tokens = tokenize.generate_tokens(io.StringIO(text).readline)
        used = {line for t in tokens if t.type not in silent for line in range(t.start[0], t.end[0] + 1)}
        found[parts[0] if len(parts) > 1 else "ground"] += len(used - documented)
    return dict(found)


def yaml_lines() -> tuple[int, int]:
    """Return the lines of content of all configuration files, and how many of them are different."""
    found = [
        line.split(" #")[0].strip()
        for path in sorted((ROOT / "configs").rglob("*.yml"))
        for line in path.read_text(encoding="utf-8").splitlines()
    ]
    content = [line for line in found if line and not line.startswith("#")]
    return len(content), len(set(content))


def options() -> tuple[int, dict[str, set[str]]]:
    """Return how many kinds of plugins the package has, and the fields of each plugin and part of one."""
    from safe_inspect.plugins.plugin import Plugin
    from safe_inspect.plugins.registry import registry

    kinds, found, waiting = set(), {}, [Plugin] if registry.kinds() else []
    while waiting:
        plugin = waiting.pop()
        waiting += plugin.__subclasses__()
        own = plugin.__module__.startswith("safe_inspect.") and ".testing." not in plugin.__module__
        if own and not inspect.isabstract(plugin) and "__call__" in dir(plugin):
            found[f"{plugin.__module__}:{plugin.registered_name or plugin.__name__}"] = set(plugin.model_fields)
            kinds |= {plugin.kind} - {""}
    return len(kinds), found


def details() -> tuple[dict[str, int], dict[str, list[str]]]:
    """Return the recorded measures, and what makes up those that one can list."""
    trees, code = modules(), code_lines()
    kinds, fields = options()
    content, different = yaml_lines()
    graph = imports(trees)
    places = [ROOT / name for name in ("configs", "tests", "docs", "examples", "benchmarks", "README.md")]
    largest = max(code, key=lambda room: code[room])
    lists = {
        "circles of folders": [", ".join(group) for group in circles(folder_graph(graph))],
        "imports by string": imports_by_string(trees),
        "private names of Numba": sorted(private_names(trees, "numba")),
        "private names of Ray": sorted(private_names(trees, "ray")),
        "option twins": option_twins(trees, fields),
        "fields that nothing sets": sorted(unset_fields(fields, places)),
        "imports in functions": [f"{name} {count}" for name, count in imports_in_functions(trees).items()],
        "long signatures": [f"{name} {count}" for name, count in long_signatures(trees).items()],
    }
    values = {
        "code lines": sum(code.values()),
        "code lines of the largest room": code[largest],
        "modules": len(trees),
        "folders": len(folders()),
        "modules in the fullest folder": max(n for place, n in folders().items() if place != COMMANDS),
        "modules at the top level": folders()["safe_inspect"],
        "plugin kinds": kinds,
        "public names": public_names(trees),
        "lines of YAML": content,
        "repeated lines of YAML": content - different,
        **{name: len(items) for name, items in lists.items()},
        "imports in functions": sum(imports_in_functions(trees).values()),
        "arguments of the longest signature": max(long_signatures(trees).values(), default=0),
    }
    lists["code lines"] = [f"{room} {count}" for room, count in sorted(code.items(), key=lambda item: -item[1])]
    return {name: 100 * math.ceil(value / 100) if value >= _LARGE else value for name, value in values.items()}, lists


def risen(values: dict[str, int], record: dict[str, int]) -> list[str]:
    """Return a message for each measure that is above its record."""
    return [
        f"{name}: {value}, recorded {record[name]}; bring it down, or record what the rise pays for: "
        'python scripts/measures.py --write --for "..."'
        for name, value in values.items()
        if value > record.get(name, value)
    ]


def main() -> None:
    """Print the measures, and write those that have fallen."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="record the values that have fallen")
    parser.add_argument("--for", dest="reason", help="what the values pay for that have risen")
    given = parser.parse_args()
    values, lists = details()
    record = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.is_file() else {"values": {}, "rises": []}
    for name, value in values.items():
        print(f"{name:36} {value:7,}   recorded {record['values'].get(name, value):7,}")
    for name, items in lists.items():
        for item in items:
            print(f"  {name}: {item}")
    problems = risen(values, record["values"])
    if given.write:
        if problems and not given.reason:
            sys.exit("\n".join(problems))
        for name, value in values.items():
            before = record["values"].get(name, value)
            if value > before:
                record["rises"].append(f"{name}: {before} to {value}, for {given.reason}")
        record["values"] = values
        RECORD.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
