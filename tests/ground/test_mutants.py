"""The faults that `scripts/mutants.py` plants are valid, reproducible and counted with an interval."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

SCRIPTS = Path(__file__).parents[2] / "scripts"
SOURCE = '''"""A module."""

LIMIT = 2.5


def clipped(value: float, low: float = 0.0) -> float:
    """Return a value within its limits."""
    if value < low and not value > 1:
        value -= 1.0
    return max(low, min(value, LIMIT))


def record(values: list[float], low: float) -> None:
    """Append a value."""
    values.append(1.0)
    values[0] = -values[1] * 2
    low = divmod(values, low)
'''


@pytest.fixture(scope="module")
def mutants() -> Any:
    sys.path.insert(0, str(SCRIPTS))
    try:
        import mutants
    finally:
        sys.path.remove(str(SCRIPTS))
    return mutants


def test_every_kind_of_fault_is_found(mutants: Any) -> None:
    found = {(one.kind, one.replaced(SOURCE), one.text) for one in mutants.mutations(SOURCE)}
    for expected in (
        ("constant", "2.5", "3.75"),
        ("constant", "0.0", "1.0"),
        ("comparison", "<", "<="),
        ("comparison", "<", ">"),
        ("and, or", "and", "or"),
        ("dropped sign", "not value > 1", "(value > 1)"),
        ("dropped condition", "value < low and not value > 1", "True"),
        ("dropped condition", "value < low", "True"),
        ("dropped update", "value -= 1.0", "pass"),
        ("dropped update", "values[0] = -values[1] * 2", "pass"),
        ("dropped call", "values.append(1.0)", "pass"),
        ("exchanged arguments", "values, low", "low, values"),
        ("operator", "*", "/"),
        ("early return", "", "return; "),
    ):
        assert expected in found
    exchanged = [before for kind, before, _ in found if kind == "exchanged arguments"]
    assert exchanged == ["values, low"], "the largest of two numbers does not depend on their order"
    assert not any('"""' in before for _, before, _ in found)  # docstrings stay


def test_faults_change_the_source_and_compile(mutants: Any) -> None:
    for one in mutants.mutations(SOURCE):
        assert one.compiles(SOURCE), one
        assert one.applied(SOURCE) != SOURCE


def test_machine_code_of_files_that_reach_a_fault_is_left_out(mutants: Any, tmp_path: Path) -> None:
    before, after = tmp_path / "before", tmp_path / "after"
    for name in (
        "room_0f/a.f-1.nbi",
        "called/room_0f/a.f-1.nbi",
        "room_0f/b.g-1.nbi",
        "hall_1a/a.f-1.nbi",
        "rta_2b/test_arc_cells.f-1.nbi",
    ):
        (before / name).parent.mkdir(parents=True, exist_ok=True)
        (before / name).write_text(name, encoding="utf-8")
    mutants.link_machine_code(before, after, {"safe_inspect.room.a", "safe_inspect.hall"})
    found = {path.relative_to(after).as_posix() for path in after.rglob("*.nbi")}
    # A kernel of a test contains those of the package that it calls.
    assert found == {"room_0f/b.g-1.nbi", "hall_1a/a.f-1.nbi"}


def test_draws_are_reproducible_and_keep_to_their_rooms(mutants: Any) -> None:
    drawn = mutants.draw(5, 12, ["dynamics", "dones"])
    assert drawn == mutants.draw(5, 12, ["dynamics", "dones"])
    assert drawn != mutants.draw(6, 12, ["dynamics", "dones"])
    assert len({(file, one.line) for file, one in drawn}) == 12
    assert all(file.startswith(("safe_inspect/dynamics/", "safe_inspect/dones/")) for file, _ in drawn)


def test_every_room_names_tests(mutants: Any) -> None:
    names = {".".join(path.relative_to(mutants.ROOT).with_suffix("").parts) for path in mutants.sources()}
    for room in {mutants.room_of(name) for name in names}:
        for folder in mutants.tests_of(room):
            place = mutants.ROOT / folder
            assert place.is_file() or list(place.rglob("test_*.py")), (room, folder)


def test_the_table_counts_by_room(mutants: Any) -> None:
    results = [
        {"key": f"{room} {n}", "room": room, "outcome": "passed" if n < missed else "failed"}
        for room, count, missed in (("a", 10, 2), ("b", 5, 0))
        for n in range(count)
    ]
    rows = [line.split() for line in mutants.table(results).splitlines()]
    assert rows[1][:4] == ["a", "10", "8", "80.0%"]
    assert rows[1][4:6] == ["49.0%", "94.3%"]  # Wilson
    assert rows[3][:4] == ["all", "15", "13", "86.7%"]


def test_only_files_that_run_a_function_are_tried_on_it(mutants: Any, tmp_path: Path) -> None:
    module, tests = "safe_inspect/dynamics/base.py", ("tests/dynamics",)
    source = (mutants.ROOT / module).read_text(encoding="utf-8")
    lines = mutants.functions_of(source)
    files = [
        file for file in mutants.files_of(tests) if not mutants._PROCESSES.search((mutants.ROOT / file).read_text())
    ]
    runs, other = files[:2]
    inside = next(one for one in mutants.mutations(source) if one.line in lines)
    outside = next(one for one in mutants.mutations(source) if one.line not in lines)
    known = {file: {"seconds": 1.0, "functions": {}, "digest": mutants.digest_of(file)} for file in files}
    known[runs]["functions"] = {module: [lines[inside.line]]}
    (tmp_path / "reach.json").write_text(json.dumps(known))
    reach = mutants.Reach(tmp_path / "reach.json")
    tried = reach.files(module, inside, tests)
    assert runs in tried
    assert other not in tried
    assert set(reach.files(module, outside, tests)) >= set(files)
    known[other]["digest"] = "of an earlier text"
    (tmp_path / "reach.json").write_text(json.dumps(known))
    assert other in mutants.Reach(tmp_path / "reach.json").unknown(tests)
