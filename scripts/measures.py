"""Print the measures of the source: circles of imports, sizes of folders, names with two definitions, and others.

Usage: python scripts/measures.py
"""

from __future__ import annotations

import ast
import io
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.sparse.csgraph import connected_components

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "safe_inspect"
MANY = 10
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


def circles(trees: dict[str, ast.Module]) -> list[list[str]]:
    """Return the sets of modules that import each other; imports in functions and for type checkers count."""
    names = list(trees)
    graph = np.zeros((len(names), len(names)), dtype=np.int8)
    for name, tree in trees.items():
        for node in ast.walk(tree):
            for other in _imported(node, trees):
                graph[names.index(name), names.index(other)] = 1
    np.fill_diagonal(graph, 0)
    _, labels = connected_components(graph, connection="strong")
    members = defaultdict(list)
    for name, label in zip(names, labels, strict=True):
        members[int(label)].append(name)
    return [group for group in members.values() if len(group) > 1]


def importers(module: str, trees: dict[str, ast.Module]) -> set[str]:
    """Return the modules that import a module, directly or not, and the module itself."""
    direct = defaultdict(set)
    for name, tree in trees.items():
        for node in ast.walk(tree):
            for other in _imported(node, trees):
                direct[other].add(name)
    found, waiting = set(), [module]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += direct[name]
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
    places.pop("main", None)  # of each module that is a command
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


def lines() -> tuple[int, int]:
    """Return the lines of the package, and those of code: without blank lines, comments and docstrings."""
    total = code = 0
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        total += len(text.splitlines())
        documented = set()
        for node in ast.walk(ast.parse(text)):
            body = getattr(node, "body", None)
            if isinstance(node, ast.Module | ast.ClassDef | Function) and ast.get_docstring(node) and body:
                documented |= set(range(body[0].lineno, (body[0].end_lineno or 0) + 1))
        silent = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)
        tokens = tokenize.generate_tokens(io.StringIO(text).readline)
        used = {line for t in tokens if t.type not in silent for line in range(t.start[0], t.end[0] + 1)}
        code += len(used - documented)
    return total, code


def yaml_lines() -> tuple[int, int]:
    """Return the lines of content of all configuration files, and how many of them are different."""
    found = [
        line.split(" #")[0].strip()
        for path in sorted((ROOT / "configs").rglob("*.yml"))
        for line in path.read_text(encoding="utf-8").splitlines()
    ]
    content = [line for line in found if line and not line.startswith("#")]
    return len(content), len(set(content))


def main() -> None:
    """Print all measures."""
    trees = modules()
    loops, inner, names, long = (
        circles(trees), imports_in_functions(trees), repeated_names(trees), long_signatures(trees),
    )  # fmt: skip
    total, code = lines()
    content, different = yaml_lines()
    fullest, count = max(folders().items(), key=lambda item: item[1])
    print(f"circles of imports                         {len(loops)}")
    print(f"own imports inside functions               {sum(inner.values())}")
    print(f"modules in the fullest folder              {count} ({fullest})")
    print(f"modules at the top level                   {folders()['safe_inspect']}")
    print(f"lines of the package, of them code         {total}, {code}")
    print(f"public names with several definitions      {len(names)}")
    print(f"functions with ten arguments or more       {len(long)}, largest {max(long.values(), default=0)}")
    print(f"different lines of YAML                    {different} of {content} ({different / content:.0%})")
    for title, detail in (("circle", loops), ("name", [f"{k}: {', '.join(v)}" for k, v in names.items()])):
        for item in detail:
            print(f"  {title} {item}")
    for title, table in (("imports in functions", inner), ("arguments", long)):
        for key, number in sorted(table.items(), key=lambda item: -item[1]):
            print(f"  {title} {number} {key}")


if __name__ == "__main__":
    main()
