"""The source keeps to its measures: no circle of imports, no name with two meanings, no function of many arguments."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import pytest

MEASURES = Path(__file__).parents[2] / "scripts" / "measures.py"


@pytest.fixture(scope="module")
def measures() -> dict[str, Any]:
    return runpy.run_path(str(MEASURES))


@pytest.fixture(scope="module")
def trees(measures: dict[str, Any]) -> Any:
    return measures["modules"]()


def test_no_modules_import_each_other(measures: dict[str, Any], trees: Any) -> None:
    assert measures["circles"](trees) == []


def test_imports_inside_functions_are_the_exception(measures: dict[str, Any], trees: Any) -> None:
    inner = measures["imports_in_functions"](trees)
    assert sum(inner.values()) < 40, inner


def test_a_public_name_is_defined_once(measures: dict[str, Any], trees: Any) -> None:
    assert measures["repeated_names"](trees) == {}


def test_few_functions_take_many_arguments(measures: dict[str, Any], trees: Any) -> None:
    long = measures["long_signatures"](trees)
    assert len(long) < 10, long
    assert max(long.values(), default=0) <= 12, long


def test_circles_and_names_are_found(measures: dict[str, Any], tmp_path: Path) -> None:
    import ast

    found = {
        "safe_inspect.a": ast.parse("def f():\n    from safe_inspect.b import g\n"),
        "safe_inspect.b": ast.parse("from safe_inspect import a\nX = 1\ndef g(): ...\n"),
        "safe_inspect.c": ast.parse("X = 2\n"),
    }
    assert measures["circles"](found) == [["safe_inspect.a", "safe_inspect.b"]]
    assert measures["imports_in_functions"](found) == {"safe_inspect.a": 1}
    assert measures["repeated_names"](found) == {"X": ["safe_inspect.b", "safe_inspect.c"]}
