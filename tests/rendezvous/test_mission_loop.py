"""The loop of a mission with a made-up pilot: the order of its steps, what each leaves in the log, and its events."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from safe_inspect.dynamics.quaternion import to_matrix
from safe_inspect.geometry.pointing import R_BC
from safe_inspect.missions import mission as module
from safe_inspect.missions.mission import Mission
from safe_inspect.missions.record import MissionLog, json_text
from safe_inspect.rendezvous.coordination.pilot import Phase
from safe_inspect.rendezvous.experiment import RendezvousConfig, load_rendezvous

from .test_experiment import SHIPPED


def made(**attributes: Any) -> Any:
    """Return a mission without its parts but for these."""
    mission: Any = object.__new__(Mission)
    settings = SimpleNamespace(mission=SimpleNamespace(control_ticks=5))
    given = {"_log": MissionLog(), "_config": settings, "_target": "target", "_progress": None, "_watch": None}
    vars(mission).update({**given, **attributes})
    return mission


@pytest.mark.parametrize("watched", [True, False])
def test_each_step_is_sensed_flown_and_recorded(watched: bool) -> None:
    told: list[Any] = []
    commands = iter(["first", "second", None])

    class Truth:
        time, chaser, target = 0.0, "chaser 0", "target 0"

        def advance(self, command: Any) -> Any:
            told.append(("advance", command))
            self.time += 0.5
            self.chaser, self.target = f"chaser {self.time}", f"target {self.time}"
            return SimpleNamespace(chaser=f"trace {self.time}")

    def read(*given: Any) -> Any:
        told.append(("read", *given))
        return f"readings {given[0]}"

    pilot = SimpleNamespace(act=lambda readings: told.append(("act", readings)) or next(commands), context="context")
    mission = made(_truth=Truth(), _sensors=SimpleNamespace(read=read), pilot=pilot)
    mission._record = lambda command, done: told.append(("record", command, done.chaser))
    mission._watch = (lambda context: told.append(("watch", context))) if watched else None
    steps = [tuple(step) for step in mission.steps()]
    assert steps == [
        ("readings 0.0", "chaser 0", "target 0"), ("readings 0.5", "chaser 0.5", "target 0.5"),
        ("readings 1.0", "chaser 1.0", "target 1.0"),
    ]  # fmt: skip
    expected: list[Any] = [("read", 0.0, "chaser 0", "target 0"), ("act", "readings 0.0")]
    for before, time, command in ((0.0, 0.5, "first"), (0.5, 1.0, "second")):
        assert ("act", f"readings {before}") in told
        expected += [("watch", "context")] if watched else []
        expected += [
            ("advance", command), ("record", command, f"trace {time}"),
            ("read", time, f"chaser {time}", f"target {time}", f"trace {time}", command), ("act", f"readings {time}"),
        ]  # fmt: skip
    assert told == expected


def test_a_mission_is_flown_to_its_end_in_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[Any] = []

    @contextmanager
    def limits(**given: Any) -> Iterator[None]:
        told.append(given)
        yield
        told.append("free")

    monkeypatch.setattr(module, "threadpool_limits", limits)
    monkeypatch.setattr(module, "summarise_mission", lambda *given: given)
    pilot = SimpleNamespace(arrived="arrived", context=SimpleNamespace(cause="cause"))
    mission = made(pilot=pilot, steps=lambda: (told.append(step) for step in range(3)))
    found = mission.run()
    assert told == [{"limits": 1, "user_api": "blas"}, 0, 1, 2, "free"]
    assert found.summary == (mission._config, "target", mission._log, "arrived", "cause")
    assert found.log is mission._log


def body(first: float) -> Any:
    return SimpleNamespace(
        position=first + np.arange(3.0), velocity=first + np.arange(3.0, 6.0), orientation=first + np.arange(4.0),
        angular_velocity=first + np.arange(6.0, 9.0),
    )  # fmt: skip


def context_of(**changes: Any) -> Any:
    """Return the memory of a pilot that follows a plan from step 7 on, at step 9."""
    estimate = SimpleNamespace(
        translation="x", chaser=body(10.0), target=body(20.0), inertia=np.array([2.0, 6.0, 8.0]),
        errors=SimpleNamespace(attitude=0.1, rate=0.2),
    )  # fmt: skip
    tube = SimpleNamespace(clearance=np.array([1.0, 2.0, 3.0, 4.0]), force=np.array([10.0, 20.0, 30.0, 40.0]))
    given = {
        "time": 4.5, "step": 9, "phase": list(Phase)[2], "limits": SimpleNamespace(radius=0.75), "estimate": estimate,
        "following": SimpleNamespace(first_step=7, design=SimpleNamespace(tube=tube, margin=np.arange(5.0, 9.0))),
        "design": None, "plan": None, "pointing_error": 0.3,
    }  # fmt: skip
    return SimpleNamespace(**{**given, **changes})


def recorded(monkeypatch: pytest.MonkeyPatch, context: Any) -> dict[str, Any]:
    """Return the row that a step leaves."""
    rows: list[Any] = []
    monkeypatch.setattr(module, "clearances", lambda *given: rows.append(given) or np.array([0.9, 0.4, 0.6]))
    monkeypatch.setattr(module, "normalised_error", lambda *given: given)
    done = SimpleNamespace(
        chaser=SimpleNamespace(position="path", wrench=np.arange(18.0).reshape(3, 6)), target="turning",
        chaser_before=body(0.0), target_before=body(30.0), flown="flown",
    )  # fmt: skip
    log = SimpleNamespace(add=lambda **values: rows.append(values))
    mission = made(pilot=SimpleNamespace(context=context, followed="reference"), _log=log)
    mission._record(SimpleNamespace(force="force", torque="torque"), done)
    asked, row = rows
    assert asked == ("target", "path", "turning", 0.75)
    row["nees"] = [
        one is two
        for one, two in zip(row["nees"], (context.estimate, done.chaser_before, done.target_before), strict=True)
    ]
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in row.items()}


def test_a_step_is_recorded_as_it_began_and_as_it_was_flown(monkeypatch: pytest.MonkeyPatch) -> None:
    row = recorded(monkeypatch, context_of())
    assert row == {
        "t": 4.5, "state": 2, "x": [0.0, 1.0, 2.0, 3.0, 4.0, 5.0], "q": [0.0, 1.0, 2.0, 3.0], "w": [6.0, 7.0, 8.0],
        "target_q": [30.0, 31.0, 32.0, 33.0], "target_w": [36.0, 37.0, 38.0], "estimated_x": "x",
        "estimated_q": [10.0, 11.0, 12.0, 13.0], "estimated_target_p": [20.0, 21.0, 22.0],
        "estimated_target_q": [20.0, 21.0, 22.0, 23.0], "estimated_target_w": [26.0, 27.0, 28.0],
        "estimated_ratios": [0.25, 0.75], "nees": [True] * 3, "sigma": [0.1, 0.2], "reference": "reference",
        "force": "force", "torque": "torque", "flown": "flown",
        "wrench": [12.0, 13.0, 14.0, 15.0, 16.0, 17.0],
        "clearance": 0.4, "margin": 7.0, "tube": 3.0, "tube_force": 30.0, "pointing_error": 0.3,
    }  # fmt: skip


@pytest.mark.parametrize(("step", "place"), [(7, 0), (10, 3), (11, 3), (50, 3)])
def test_the_tube_of_a_step_is_that_of_its_place_in_the_plan(
    monkeypatch: pytest.MonkeyPatch, step: int, place: int
) -> None:
    row = recorded(monkeypatch, context_of(step=step))
    assert (row["tube"], row["margin"], row["tube_force"]) == (1.0 + place, 5.0 + place, 10.0 * (1 + place))


def test_without_a_plan_that_is_followed_there_is_no_tube(monkeypatch: pytest.MonkeyPatch) -> None:
    row = recorded(monkeypatch, context_of(following=None))
    assert np.isnan([row["tube"], row["margin"], row["tube_force"]]).all()


def test_plans_are_kept_as_they_are_flown_and_changes_of_state_are_told() -> None:
    told: list[Any] = []
    context = SimpleNamespace(time=1.2345678, step=3, phase=Phase.TRACK, plan="plan")
    mission = made(pilot=SimpleNamespace(context=context), _progress=lambda *given: told.append(given))
    other = next(phase for phase in Phase if phase is not Phase.TRACK)
    mission._changed(other, "ready", Phase.TRACK)
    mission._changed(Phase.TRACK, "again", Phase.TRACK)
    mission._changed(Phase.TRACK, "lost", other)
    context.plan = None
    mission._changed(other, "without", Phase.TRACK)
    assert mission._log.plans == ["plan", "plan"]
    assert told == [
        (1.2345678, other, "ready", Phase.TRACK), (1.2345678, Phase.TRACK, "lost", other),
        (1.2345678, other, "without", Phase.TRACK),
    ]  # fmt: skip
    assert mission._log.events[1] == {
        "tick": 15, "t": 1.234568, "state": Phase.TRACK.value,
        "event": "transition", "data": {"from": Phase.TRACK.value, "guard": "again", "to": Phase.TRACK.value},
    }  # fmt: skip
    assert len(mission._log.events) == 4
    silent = made(pilot=SimpleNamespace(context=context))
    silent._changed(other, "ready", Phase.TRACK)
    assert len(silent._log.events) == 1


def test_a_log_is_written_as_it_was_kept(tmp_path: Path) -> None:
    log = MissionLog()
    for step in range(3):
        log.add(t=0.5 * step, x=np.array([step, 2.0]))
    log.event(5, 0.1234567, "wait", "seen", {"value": np.nan, "many": np.array([1, 2]), "one": np.float64(2.5)})
    log.event(6, 1.0, "wait", "lost", {})
    plan = SimpleNamespace(t_start=1.0, times=2.0, position=3.0, velocity=4.0, force=5.0, position_target=6.0)
    log.plans = [plan, plan]  # type: ignore[list-item]
    assert log.arrays()["x"].tolist() == [[0.0, 2.0], [1.0, 2.0], [2.0, 2.0]]
    log.write(tmp_path, "config: 1\n", {"clearance": np.inf, "name": "some", "done": True})
    assert (tmp_path / "config.resolved.yml").read_text() == "config: 1\n"
    lines = (tmp_path / "events.jsonl").read_text().splitlines()
    assert [json.loads(line) for line in lines] == [
        {"tick": 5, "t": 0.123457, "state": "wait", "event": "seen",
         "data": {"value": None, "many": [1, 2], "one": 2.5}},
        {"tick": 6, "t": 1.0, "state": "wait", "event": "lost", "data": {}},
    ]  # fmt: skip
    with np.load(tmp_path / "log.npz") as arrays:
        assert arrays["t"].tolist() == [0.0, 0.5, 1.0]
    for index in range(2):
        with np.load(tmp_path / f"plan_{index}.npz") as arrays:
            assert {name: float(arrays[name]) for name in arrays.files} == vars(plan)
    assert json.loads((tmp_path / "summary.json").read_text()) == {"clearance": None, "name": "some", "done": True}
    assert json_text((1, [np.int64(2)], {"a": -np.inf})) == '[1,[2],{"a":null}]'


def test_a_mission_begins_where_its_file_says_with_the_camera_on_the_target() -> None:
    config = load_rendezvous(
        SHIPPED, ["chaser.position=[0.6 m, -1.6 m, 0.5 m]", "chaser.velocity=[0.01, -0.02, 0.03]"]
    ).config
    starts = [next(Mission(config, number).steps()) for number in (np.int64(3), 3, 4)]
    for _, chaser, target in starts:
        np.testing.assert_array_equal(chaser.position, [0.6, -1.6, 0.5])
        np.testing.assert_array_equal(chaser.velocity, [0.01, -0.02, 0.03])
        assert not chaser.angular_velocity.any()
        axis = to_matrix(chaser.orientation) @ R_BC[:, 2]
        np.testing.assert_allclose(axis, -chaser.position / np.linalg.norm(chaser.position), atol=1e-12)
        assert not target.position.any()
    one, same, other = (target for _, _, target in starts)
    np.testing.assert_array_equal(one.orientation, same.orientation)
    assert np.abs(one.orientation - other.orientation).max() > 1e-3
    more, *_ = next(Mission(config, 3, reads=("poses",)).steps())
    assert (starts[0][0].frame is None, more.frame is None) == (True, False)


def test_what_is_no_mission_is_refused() -> None:
    for config in ({}, None, "experiment.yml"):
        with pytest.raises(TypeError, match="RendezvousConfig"):
            Mission(config)  # type: ignore[arg-type]
    config = object.__new__(RendezvousConfig)
    for number in (-1, 1.0, "1"):
        with pytest.raises(ValueError, match="number"):
            Mission(config, number)  # type: ignore[arg-type]
