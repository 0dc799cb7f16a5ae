"""The source keeps to its measures: no circle of modules, no name with two meanings, and records that only fall."""

from __future__ import annotations

import ast
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

SCRIPTS = Path(__file__).parents[2] / "scripts"


@pytest.fixture(scope="module")
def measures() -> Iterator[Any]:
    sys.path.insert(0, str(SCRIPTS))
    try:
        import measures

        yield measures
    finally:
        sys.path.remove(str(SCRIPTS))


@pytest.fixture(scope="module")
def trees(measures: Any) -> Any:
    return measures.modules()


def test_no_modules_import_each_other(measures: Any, trees: Any) -> None:
    assert measures.circles(measures.imports(trees)) == []


def test_a_public_name_is_defined_once(measures: Any, trees: Any) -> None:
    assert measures.repeated_names(trees) == {}


@pytest.mark.slow
def test_no_measure_has_risen_unless_it_is_written_for_what(measures: Any) -> None:
    record = json.loads(measures.RECORD.read_text(encoding="utf-8"))["values"]
    values, lists = measures.details()
    assert values.keys() == record.keys()
    assert measures.risen(values, record) == [], lists
    fallen = {name: value for name, value in values.items() if value < 0.98 * record[name]}
    assert not fallen, "write what has fallen: python scripts/measures.py --write"


SOURCES = {
    "safe_inspect.a": "def f():\n    from safe_inspect.b import g\n",
    "safe_inspect.b": "from safe_inspect import a\nX = 1\ndef g(): ...\n",
    "safe_inspect.c": "X = 2\n",
    "safe_inspect.room.one.m": "from safe_inspect.room.two import n\nimport numba\nnumba.core._hidden()\n",
    "safe_inspect.room.two": "",
    "safe_inspect.room.two.n": "from safe_inspect.room.one import m\nfrom numba.core.caching import Cache\n",
    "safe_inspect.room.three": (
        "from importlib import import_module\nfrom ray._private import services\n"
        "@dataclass(frozen=True)\nclass FilterOptions:\n    rate: float = 1.0\n    gain: float = 2.0\n    name: str\n"
        "class Other:\n    rate: float = 1.0\n    gain: float = 2.0\nimport_module('safe_inspect.a')\n"
    ),
}


def test_what_the_measures_count(measures: Any, tmp_path: Path) -> None:
    found = {name: ast.parse(text) for name, text in SOURCES.items()}
    graph = measures.imports(found)
    assert measures.circles(graph) == [
        ["safe_inspect.a", "safe_inspect.b"], ["safe_inspect.room.one.m", "safe_inspect.room.two.n"]
    ]  # fmt: skip
    assert measures.circles(measures.folder_graph(graph)) == [["safe_inspect.room.one", "safe_inspect.room.two"]]
    assert measures.importers("safe_inspect.c", found) == {"safe_inspect.c"}
    assert measures.importers("safe_inspect.a", found) == {"safe_inspect.a", "safe_inspect.b"}
    assert measures.imports_in_functions(found) == {"safe_inspect.a": 1}
    assert measures.repeated_names(found) == {"X": ["safe_inspect.b", "safe_inspect.c"]}
    assert measures.public_names(found) == 4
    assert measures.imports_by_string(found) == ["safe_inspect.room.three:11"]
    assert measures.private_names(found, "numba") == {"_hidden", "Cache"}
    assert measures.private_names(found, "ray") == {"services"}
    options = {"safe_inspect.room.plugins:Filter": {"rate", "gain", "order"}, "safe_inspect.hall:Filter": {"rate"}}
    assert measures.option_twins(found, options) == ["safe_inspect.room.three:FilterOptions"]
    assert measures.option_twins(found, {"safe_inspect.hall.m:Filter": {"rate", "gain"}}) == []
    (tmp_path / "task.yml").write_text("rate: 1  # the order counts\n")
    assert measures.unset_fields({"m:Filter": {"rate", "gain", "order"}}, [tmp_path]) == {"m:Filter.gain"}


def test_a_rise_names_the_measure_and_both_values(measures: Any) -> None:
    record = {"modules": 10, "folders": 3}
    assert measures.risen({"modules": 10, "folders": 2, "new": 5}, record) == []
    (message,) = measures.risen({"modules": 11, "folders": 3}, record)
    assert message.startswith("modules: 11, recorded 10;")
