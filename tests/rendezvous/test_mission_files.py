"""Logs that are written by hand: their summary from the definitions of its figures, and what is read of their files."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.dynamics.quaternion import conjugate, log, multiply, to_matrix
from safe_inspect.errors import CheckpointError
from safe_inspect.missions.record import MissionLog, MissionRecord, PhaseInterval, read_mission
from safe_inspect.missions.summary import mission_table, summarise_mission, true_reference
from safe_inspect.rendezvous.coordination.context import Phase
from safe_inspect.rendezvous.experiment import load_rendezvous

from .pieces.control import plan

_EXPERIMENT = load_rendezvous(configs_root() / "tumbling-rendezvous" / "experiment-truth.yml")
_CONFIG = _EXPERIMENT.config
_TARGET = _CONFIG.target()
_PHASES = [Phase.OBSERVE, Phase.PLAN, Phase.TRACK, Phase.TRACK, Phase.MP_HOLD, Phase.MP_HOLD]
_STEPS = len(_PHASES)


def _units(random: np.random.Generator) -> np.ndarray:
    q = random.normal(size=(_STEPS, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def _arrays(**changes: Any) -> dict[str, np.ndarray]:
    """Return the arrays of a mission that ends at the mating point."""
    random = np.random.default_rng(8)
    arrays = {
        "t": 0.2 * np.arange(_STEPS), "state": np.array([list(Phase).index(phase) for phase in _PHASES]),
        **{name: random.normal(size=(_STEPS, 3)) for name in ("force", "torque", "estimated_target_p")},
        **{name: random.normal(size=(_STEPS, 6)) for name in ("x", "reference", "flown")},
        **{name: _units(random) for name in ("q", "target_q", "estimated_q", "estimated_target_q")},
        "w": random.normal(size=(_STEPS, 3)), "target_w": 0.05 * random.normal(size=(_STEPS, 3)),
        "clearance": np.array([0.5, 0.4, 0.3, 0.2, 0.25, 0.21]), "nees": np.array([np.nan, 4.0, 5.0, 6.0, 7.0, 8.0]),
        **{name: np.full(_STEPS, 0.02) for name in ("margin", "tube_force", "pointing_error")},
        "tube": np.array([np.nan, np.nan, 0.02, 0.03, 1e-10, 0.05]),
    } | changes  # fmt: skip
    # In the last step the chaser is 1 cm and 2 mm/s off the mating point.
    rotation, rate = to_matrix(arrays["target_q"][-1]), arrays["target_w"][-1]
    point = _TARGET.mating_point
    arrays["x"][-1] = np.concatenate([rotation @ point, rotation @ np.cross(rate, point)]) + np.array(
        [0.01, 0, 0, 0, 0.002, 0]
    )
    arrays["x"][:-1, :3] *= 0.3
    return arrays


def _log(arrays: dict[str, np.ndarray]) -> MissionLog:
    found = MissionLog(plans=[plan(), replace(plan(), t_start=9.0, times=plan().times + 0.7)])
    for k in range(len(arrays["t"])):
        found.add(**{name: array[k] for name, array in arrays.items()})
    for tick, name, data in (
        (0, "plan", {"seconds": 0.5, "message": ""}), (25, "plan", {"seconds": None, "message": "too short"}),
        (50, "tube", {"refusal": "too wide", "bound": np.inf}), (75, "no_escape", {"clearance": np.float64(0.25)}),
        (99, "coarse", {"rows": np.arange(2)}),
    ):  # fmt: skip
        found.event(tick, 0.008 * tick + 1e-8, "PLAN", name, data)
    return found


def _summary(success: bool = True, cause: str = "", **changes: Any) -> dict[str, Any]:
    return summarise_mission(_CONFIG, _TARGET, _log(_arrays(**changes)), success, cause)


def test_the_figures_of_a_summary_are_those_of_their_definitions() -> None:
    arrays, summary = _arrays(), _summary()
    x, force, last = arrays["x"], arrays["force"], arrays["x"][-1]
    moves = slice(2, None)
    path = true_reference(arrays)
    for k in range(_STEPS):  # the plan in T is the reference as estimated, and moves with the true attitude
        in_target = to_matrix(arrays["estimated_target_q"][k]).T @ (
            arrays["reference"][k, :3] - arrays["estimated_target_p"][k]
        )
        np.testing.assert_allclose(path[k], to_matrix(arrays["target_q"][k]) @ in_target, atol=1e-12)
    wide = [2, 3, 5]
    error = multiply(
        conjugate(multiply(conjugate(arrays["q"][1]), arrays["target_q"][1])),
        multiply(conjugate(arrays["estimated_q"][1]), arrays["estimated_target_q"][1]),
    )
    expected = {
        "success": True, "cause": "", "time": 1.2, "time_on_approach": 0.8, "least_clearance": 0.2,
        "mating_position_error": 0.01, "mating_speed_error": 0.002,
        "delta_v": np.sqrt((force**2).sum(axis=1)).sum() * 0.2 / 9.583788668, "largest_force": np.abs(force).max(),
        "largest_gauge": max(np.abs(x[k, :3] - path[k]).max() / arrays["tube"][k] for k in wide), "plans": 2,
        "planning_time": 0.5, "attitude_error": np.linalg.norm(log(error)), "nees": 4.0,
        "tumble_rate": np.linalg.norm(arrays["target_w"][0]), "detail": "", "escape_missing": 1,
        "keep_in_excursion": max((np.abs(x[:, :3]) - np.array([0.8, 3.0, 0.8])).max(), 0.0), "contact_speed": None,
        "given_up": False, "final_speed": np.linalg.norm(last[3:]), "final_range": np.linalg.norm(last[:3]),
        "final_range_rate": last[:3] @ last[3:] / np.linalg.norm(last[:3]),
    }  # fmt: skip
    assert set(summary) == {*expected, "tumble_axis"}
    for name, value in expected.items():
        assert summary[name] == (pytest.approx(value) if isinstance(value, float) else value), name
    assert len(arrays["x"][moves]) == 4


@pytest.mark.parametrize(
    ("changes", "given", "expected"),
    [
        ({}, (False, "why"), {"success": False, "cause": "why", "detail": "too wide"}),
        ({"clearance": np.array([0.5, 0.4, 0.3, 0.2, 0.25, 0.0])}, (True, ""),
         {"success": False, "cause": "contact with the target"}),
        ({"clearance": np.full(_STEPS, -0.1)}, (False, "why"), {"cause": "contact with the target (why)"}),
        ({"state": np.full(_STEPS, list(Phase).index(Phase.DEPART))}, (False, ""),
         {"given_up": True, "largest_gauge": None, "nees": None, "attitude_error": None,
          "time_on_approach": 0.0}),
        ({"tube": np.full(_STEPS, np.nan)}, (True, ""), {"largest_gauge": None}),
        ({"tube": np.full(_STEPS, 1e-9)}, (True, ""), {"largest_gauge": None}),
        ({"nees": np.full(_STEPS, np.nan)}, (True, ""), {"nees": None}),
    ],
)  # fmt: skip
def test_a_summary_says_what_went_wrong(
    changes: dict[str, Any], given: tuple[bool, str], expected: dict[str, Any]
) -> None:
    summary = _summary(*given, **changes)
    assert {name: summary[name] for name in expected} == expected


def test_a_success_is_one_in_truth() -> None:
    for name, value in (("hold_position", 0.009), ("hold_speed", 0.0019)):
        mission = _CONFIG.mission.model_copy(update={name: value})
        config = _CONFIG.model_copy(update={"mission": mission})
        summary = summarise_mission(config, _TARGET, _log(_arrays()), True, "")
        assert not summary["success"]
        assert summary["cause"] == "the estimate was at the mating point, and the chaser was not"
    free = _CONFIG.chaser.model_copy(update={"limits": _CONFIG.chaser.limits.model_copy(update={"keep_in": None})})
    config = _CONFIG.model_copy(update={"chaser": free})
    assert summarise_mission(config, _TARGET, _log(_arrays()), True, "")["keep_in_excursion"] is None


def test_the_speed_at_contact_is_relative_to_the_surface() -> None:
    arrays = _arrays(clearance=np.array([0.5, 0.4, 0.0, -0.2, 0.25, 0.21]))
    turning = np.cross(to_matrix(arrays["target_q"][2]) @ arrays["target_w"][2], arrays["x"][2, :3])
    summary = _summary(clearance=arrays["clearance"])
    assert summary["contact_speed"] == pytest.approx(np.linalg.norm(arrays["x"][2, 3:] - turning))


def test_the_table_of_a_mission_shows_its_figures() -> None:
    table = mission_table(_summary() | {"time": 1.23456, "contact_speed": None, "plans": 2}).splitlines()
    assert table[0] == "success"
    assert "  time                                      1.23 s" in table
    assert "  speed at contact                          -" in table
    assert "  plans                                     2" in table
    assert table[-1].startswith("  delta-v ")
    failed = mission_table(_summary(False, "why"))
    assert failed.startswith("failed: why (too wide)\n")
    assert mission_table({"success": False, "cause": "why"}).startswith(
        "failed: why\n  time                                      -\n"
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    _log(_arrays()).write(tmp_path, _EXPERIMENT.text, _summary() | {"nees": np.nan})
    return tmp_path


def test_a_mission_is_read_as_it_was_written(folder: Path) -> None:
    record = read_mission(folder)
    for name, array in _arrays().items():
        np.testing.assert_array_equal(record.arrays[name], array, name)
    first, second = record.plans
    written = ("t_start", "times", "position", "velocity", "force", "position_target")
    for name in written:
        np.testing.assert_array_equal(getattr(first, name), getattr(plan(), name), name)
    np.testing.assert_array_equal(second.times, plan().times + 0.7)
    assert set(np.load(folder / "plan_1.npz")) == set(written)
    assert [event["event"] for event in record.events] == ["plan", "plan", "tube", "no_escape", "coarse"]
    assert record.events[2] == {"tick": 50, "t": 0.4, "state": "PLAN", "event": "tube",
                                "data": {"refusal": "too wide", "bound": None}}  # fmt: skip
    assert record.events[4]["data"] == {"rows": [0, 1]}
    assert record.summary["nees"] is None
    assert record.config == _CONFIG
    np.testing.assert_array_equal(record.target.mating_point, _TARGET.mating_point)


def test_a_record_is_asked_about_its_phases_and_places(folder: Path) -> None:
    record: MissionRecord = read_mission(folder)
    names = [Phase.OBSERVE, Phase.PLAN, Phase.TRACK, Phase.MP_HOLD]
    times = [0.0, 0.2, 0.4, 0.8, 1.2]
    expected = [PhaseInterval(*one) for one in zip(names, times[:-1], times[1:], strict=True)]
    for one, other in zip(record.phases(), expected, strict=True):
        assert one.phase is other.phase
        assert [*one[1:]] == pytest.approx([*other[1:]])
    assert record.approach() == 2
    assert record.until(0.4).approach() == 2
    assert record.until(0.39).approach() == 0
    assert [len(record.until(time).arrays["x"]) for time in (0.0, 0.4, 0.59, 9.0)] == [1, 3, 3, 6]
    start = plan().times[0]
    assert [len(record.until(time).plans) for time in (start - 0.1, start, start + 0.7)] == [0, 1, 2]
    arrays = record.arrays
    for k in range(_STEPS):
        at = to_matrix(arrays["target_q"][k]).T @ arrays["x"][k, :3]
        np.testing.assert_allclose(record.position_in_target()[k], at, atol=1e-12)
        np.testing.assert_allclose(
            record.force_in_inertial()[k], to_matrix(arrays["q"][k]) @ arrays["force"][k], atol=1e-12
        )
        assert record.mating_distance()[k] == pytest.approx(np.linalg.norm(at - _TARGET.mating_point))


def _with_arrays(change: Callable[[dict[str, Any]], None], file: str = "log.npz") -> Callable[[Path], None]:
    def damage(folder: Path) -> None:
        with np.load(folder / file) as kept:
            arrays = dict(kept)
        change(arrays)
        np.savez(folder / file, **arrays)

    return damage


def _set(name: str, value: Any) -> Callable[[Path], None]:
    return _with_arrays(lambda arrays: arrays.update({name: value}))


_NOT_FINITE = np.full((_STEPS, 4), np.nan)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        *((lambda folder, name=name: (folder / name).unlink(), f"no {name}; give the folder of a mission")
          for name in ("config.resolved.yml", "log.npz", "events.jsonl", "summary.json")),
        (_with_arrays(lambda arrays: arrays.pop("force")), "log.npz: the file cannot be read (no array force); fly"),
        (_with_arrays(lambda arrays: arrays.pop("t")), "log.npz: the file cannot be read (no array t); fly"),
        (_set("force", np.zeros((_STEPS, 2))), "(force has the shape (6, 2), not (6, 3))"),
        (_set("t", np.zeros((2, 2))), "(t has the shape (2, 2), not ('K',))"),
        (_set("t", np.zeros(0)), "(t has the shape (0,), not ('K',))"),
        (_set("estimated_x", np.zeros((5, 6))), "(estimated_x has the shape (5, 6), not (6, 6))"),
        (_set("sigma", np.zeros(6)), "(sigma has the shape (6,), not (6, 2))"),
        (_set("clearance", np.zeros(5)), "(clearance has the shape (5,), not (6,))"),
        (_set("state", np.full(_STEPS, 12)), "(state has a number that is not a phase)"),
        (_set("state", np.full(_STEPS, -1)), "(state has a number that is not a phase)"),
        (_set("q", _NOT_FINITE), "(q is not finite)"), (_set("target_q", _NOT_FINITE), "(target_q is not finite)"),
        (_set("x", np.full((_STEPS, 6), np.inf)), "(x is not finite)"),
        (_with_arrays(lambda arrays: arrays.pop("force"), "plan_1.npz"),
         "plan_1.npz: the file cannot be read (no array force)"),
        (lambda folder: (folder / "log.npz").write_bytes(b"none"), "log.npz: the file cannot be read ("),
        (lambda folder: (folder / "log.npz").write_bytes(b""), "log.npz: the file cannot be read (No data"),
        (lambda folder: (folder / "events.jsonl").write_text("{}\n{"), "events.jsonl: the file cannot be read (Exp"),
        (lambda folder: (folder / "summary.json").write_text("[1]"), "summary.json: the file cannot be read (not a m"),
    ],
)  # fmt: skip
def test_a_damaged_mission_is_refused_with_its_file(folder: Path, damage: Callable[[Path], None], message: str) -> None:
    damage(folder)
    with pytest.raises(CheckpointError) as caught:
        read_mission(folder)
    assert message in str(caught.value)


def test_an_empty_line_is_no_event(folder: Path) -> None:
    with (folder / "events.jsonl").open("a") as file:
        file.write("\n  \n" + json.dumps({"event": "last"}) + "\n")
    assert read_mission(folder).events[-1] == {"event": "last"}
