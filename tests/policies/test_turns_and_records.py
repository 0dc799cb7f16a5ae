"""In what order deputies plan, and the file of a baseline: what it holds, and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from safe_inspect.dynamics.step_maps import step_maps
from safe_inspect.errors import SafeInspectError
from safe_inspect.policies.burn_execution import take_turns
from safe_inspect.policies.plan_record import Burn, Entry, Record, read_record, write_record

N, DT, CLEARANCE = 0.001027, 10.0, 25.0


def turns_by_numpy(position: np.ndarray, velocity: np.ndarray) -> list[int]:
    """Return the turn of each deputy: one of each pair by the step at which it meets, then the rest by index."""
    count = len(position)
    maps = step_maps(N, DT, 100).phi[: 3 * count]
    paths = np.einsum("jik,dk->dji", maps, np.concatenate((position, velocity), axis=1))[..., :3]
    meetings = []
    for a in range(count):
        for b in range(a):
            near = np.linalg.norm(paths[a] - paths[b], axis=1) < CLEARANCE
            if near.any():
                meetings.append((int(near.argmax()), a, b))
    order, settled = [], set()
    for _, a, b in sorted(meetings):
        if not {a, b} & settled:
            order.append(b)
            settled |= {a, b}
    order += [d for d in range(count) if d not in order]
    return [order.index(d) for d in range(count)]


@pytest.mark.parametrize("size", [1, 2, 4])
def test_who_meets_first_plans_first_in_every_environment(size: int) -> None:
    generator, count, environments = np.random.default_rng(size), 5, 60
    middle = generator.normal(size=(environments, 1, 3)) * 40.0
    position = middle + generator.normal(size=(environments, count, 3)) * 40.0
    velocity = generator.normal(size=(environments, count, 3)) * 0.8
    expected = np.array([turns_by_numpy(position[n], velocity[n]) for n in range(environments)])
    assert len({tuple(row) for row in expected.tolist()}) > 3
    deputy = np.tile(np.arange(count - size, count), environments)
    turn = np.full(environments * size, -1)
    turn[0] = 7  # one that has its turn keeps it
    take_turns(turn, deputy, size, position, velocity, step_maps(N, DT, 100), CLEARANCE)
    wanted = expected[:, count - size :].ravel()
    wanted[0] = 7
    np.testing.assert_array_equal(turn, wanted)


PLAN = (Burn(step=3, thrust=(0.1, -0.2, 0.0)), Burn(step=20, steps=4, thrust=(0.0, 0.0, 1.0)))
ENTRIES = (
    Entry(0xABCDEF, True, 0.5, 100, 99, 2.0, PLAN, 0.49, 0.6),
    Entry(2**64 - 1, False, 0.7, 400, 80, 3.0, (), None, None, False),
)
ABOUT = {"safe_inspect": "1.0", "configuration_file": "a.yml", "overrides": ["x=1"]}
RECORD = Record(3, "quick", {"points": 100}, ABOUT, ENTRIES)


def test_a_file_holds_what_a_record_does(tmp_path: Path) -> None:
    write_record(RECORD, tmp_path / "a.json")
    assert read_record(tmp_path / "a.json") == RECORD
    content = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert content == {
        "format": 1, "kind": "optimiser", "seed": 3, "episodes": 2, "effort": "quick", "delta_v": [0.5, None],
        "spent": [0.5, 0.7], "success": [True, False], "steps": [100, 400], "inspected": [99, 80], "burns": [2.0, 3.0],
        "planned": [0.49, None], "inspector": [0.6, None], "own": [True, False],
        "keys": ["0000000000abcdef", "ffffffffffffffff"],
        "plans": [
            [{"step": 3, "steps": 1, "thrust": [0.1, -0.2, 0.0]}, {"step": 20, "steps": 4, "thrust": [0, 0, 1]}], [],
        ],
        "task": {"points": 100}, **ABOUT,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("change", "shown"),
    [
        ({}, ""),
        ({"seed": 4}, "the seed is 4 there and 3 here"),
        ({"effort": "normal"}, "the effort is 'normal' there and 'quick' here"),
        ({"about": {**ABOUT, "safe_inspect": "2.0"}}, "it was made by version 2.0"),
        ({"about": {**ABOUT, "overrides": []}}, ""),
        ({"task": {"points": 99}}, "it is of another task"),
        ({"entries": ()}, ""),
    ],
)
def test_records_of_other_runs_are_distinguished(change: dict[str, Any], shown: str) -> None:
    assert RECORD.difference(replace(RECORD, **change)) == shown


@pytest.mark.parametrize(
    ("change", "shown"),
    [
        ({"format": 2}, "its format is 2, not 1"),
        ({"keys": ["xyz", "0"]}, "invalid literal for int() with base 16: 'xyz'"),
        ({"spent": [0.5]}, "list index out of range"),
        ({"task": ...}, "no 'task'"),
        ({"plans": [[{"step": -1, "thrust": [0, 0, 0]}], []]}, "1 validation error"),
        ({"plans": [None, None]}, "1 validation error"),
    ],
)
def test_files_that_hold_no_record_are_refused(change: dict[str, Any], shown: str, tmp_path: Path) -> None:
    content = {name: value for name, value in (RECORD.as_dict() | change).items() if value is not ...}
    path = tmp_path / "a.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(SafeInspectError) as refusal:
        read_record(path)
    assert str(refusal.value).startswith(f"{path}: not a file of `safe-inspect baseline optimiser` ({shown}")


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(SafeInspectError) as refusal:
        read_record(tmp_path / "none.json")
    assert str(refusal.value) == (
        f"{tmp_path / 'none.json'}: the file cannot be read (No such file or directory); give another file"
    )


@pytest.mark.parametrize("fields", [{"step": -1}, {"steps": 0}, {"thrust": (0.0, float("inf"), 0.0)}, {"other": 1}])
def test_burns_that_cannot_be_are_refused(fields: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        Burn(**{"step": 0, "thrust": (0.0, 0.0, 0.0), **fields})
    assert Burn(step=0, thrust=(0.0, 0.0, 0.0)).steps == 1
