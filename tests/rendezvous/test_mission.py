from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from safe_inspect.missions.mission import Mission, MissionResult
from safe_inspect.missions.summary import mission_table, summarise_mission
from safe_inspect.missions.truth import replay
from safe_inspect.rendezvous.control.tracker import LinearFeedback, TrackerOutput, TubeTracker
from safe_inspect.rendezvous.control.tube import TrackedReference
from safe_inspect.rendezvous.coordination import actions
from safe_inspect.rendezvous.coordination.context import Phase, clearances
from safe_inspect.rendezvous.experiment import Rendezvous, load_rendezvous
from safe_inspect.types import FloatArray

from .test_experiment import SHIPPED

_QUICK = ["mission.observe=2 s", "mission.checkout=0.4 s"]
_SHORT = ["mission.observe=1 s", "mission.wait_limit=0 s", "mission.durations=[45 s, 60 s]", "mission.hold=1 s"]
_ERRORS = ["sensors.state.attitude_sigma=0.5 deg", "sensors.state.rate_sigma=0.05 deg/s"]


def _load(*overrides: str) -> Rendezvous:
    return load_rendezvous(SHIPPED, [*_QUICK, *overrides])


def _phases(result: MissionResult) -> list[str]:
    return [event["data"]["to"] for event in result.log.events if event["event"] == "transition"]


@pytest.fixture(scope="module")
def flown() -> MissionResult:
    """A whole mission, as short as it may be."""
    return Mission(_load(*_SHORT, *_ERRORS).config, 2).run()


def test_a_mission_goes_from_start_to_mating_point(flown: MissionResult) -> None:
    summary = flown.summary
    assert summary["success"], summary
    phases = _phases(flown)
    assert phases[:5] == ["OBSERVE", "CHARACTERISE", "PLAN", "BOUND", "WAIT"]
    assert phases[-3:] == ["TRACK", "MP_HOLD", "DONE"]
    assert summary["least_clearance"] > 0.09
    assert summary["mating_position_error"] < 0.03
    assert summary["largest_gauge"] < 1.0
    assert 0.0 < summary["attitude_error"] < np.deg2rad(5.0)


def test_a_chaser_flies_around_the_target_while_it_observes_and_stays_where_the_observation_ends() -> None:
    around = ["mission.fly_around=120 s", "mission.observe=30 s", "chaser.limits.keep_in=[3 m, 3 m, 1 m]"]
    phases, places = [], []
    mission = Mission(_load(*_SHORT, *around).config, 2)
    for _, chaser, _ in mission.steps():
        phases.append(mission.pilot.context.phase if places else Phase.CHECKOUT)
        places.append(chaser.position)
    found = np.array(places)
    begins, ends = (phases.index(phase) for phase in (Phase.OBSERVE, Phase.PLAN))
    distance = np.linalg.norm(found[begins:ends], axis=1)
    assert np.abs(distance - distance[0]).max() < 0.05
    # In 30 of 120 s it flies a quarter of the circle about z of W.
    before, after = found[begins] / distance[0], found[ends] / np.linalg.norm(found[ends])
    np.testing.assert_allclose(after, [-before[1], before[0], 0.0], atol=0.1)
    assert mission.pilot.arrived


def test_the_tube_holds_for_what_the_thrusters_do_from_plan_to_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """With exact estimates, only noise along the axes of the body moves the chaser off the reference."""
    asked, design = [], TubeTracker.design
    monkeypatch.setattr(TubeTracker, "design", lambda self, request: asked.append(request) or design(self, request))
    summary = Mission(_load(*_SHORT, "chaser.actuator.force_noise=20 mN").config, 2).run().summary
    assert summary["success"], summary
    assert 0.0 < summary["largest_gauge"] < 1.0
    assert asked[0].force_error == pytest.approx(np.sqrt(3.0) * 0.02)


def test_the_log_agrees_with_the_geometry(flown: MissionResult) -> None:
    arrays = flown.log.arrays()
    target = _load().config.target()
    at_steps = clearances(target, arrays["x"][:, :3], arrays["target_q"], 0.25)
    assert (arrays["clearance"][:-1] <= at_steps[1:] + 1e-12).all()
    assert flown.summary["least_clearance"] == arrays["clearance"].min()
    track = arrays["state"] == [*Phase].index(Phase.TRACK)
    # The margin that the tube asks for is kept.
    assert (arrays["clearance"][track] >= arrays["tube"][track] * np.sqrt(3.0)).all()
    assert (np.abs(arrays["force"]) <= 0.3).all()
    assert (np.abs(arrays["x"][:, :3]) <= np.array([0.8, 3.0, 0.8])).all()


def test_the_same_seed_gives_the_same_bytes(flown: MissionResult) -> None:
    again = Mission(_load(*_SHORT, *_ERRORS).config, 2).run()
    first, second = flown.log.arrays(), again.log.arrays()
    assert first.keys() == second.keys()
    for name, array in first.items():
        assert array.tobytes() == second[name].tobytes(), name


def test_a_written_mission_is_replayed_bit_for_bit(flown: MissionResult, tmp_path: Path) -> None:
    flown.log.write(tmp_path, _load(*_SHORT, *_ERRORS).text, flown.summary)
    assert {path.name for path in tmp_path.iterdir()} == {
        "config.resolved.yml", "events.jsonl", "log.npz", "plan_0.npz", "summary.json",
    }  # fmt: skip
    again = replay(tmp_path)
    logged, ticks = flown.log.arrays(), _load().config.mission.control_ticks
    after = slice(ticks - 1, -1, ticks)  # The log contains the states before each step.
    np.testing.assert_array_equal(again.translation[after], logged["x"][1:])
    np.testing.assert_array_equal(again.orientation[after], logged["q"][1:])
    np.testing.assert_allclose(again.clearance.reshape(-1, ticks).min(axis=1), logged["clearance"], atol=1e-9)
    assert again.clearance.min() == pytest.approx(flown.summary["least_clearance"], abs=1e-9)
    events = [json.loads(line) for line in (tmp_path / "events.jsonl").read_text().splitlines()]
    assert all(set(event) == {"tick", "t", "state", "event", "data"} for event in events)
    assert json.loads((tmp_path / "summary.json").read_text())["success"] is True


def _ends_with(result: MissionResult, *phases: str) -> None:
    assert tuple(_phases(result)[-len(phases) :]) == phases, _phases(result)


@pytest.mark.parametrize(
    ("overrides", "phases", "cause"),
    [
        (["mission.faults=[{kind: camera, start: 0 s, duration: 100 s}]"], ["DEPART", "ABORTED"], "camera silent"),
        (["mission.faults=[{kind: imu, start: 0 s, duration: 100 s}]"], ["DEPART", "ABORTED"], "given up in CHECKOUT"),
        (
            ["mission.faults=[{kind: planner, start: 0 s, duration: 100 s}]"],
            ["RETREAT", "DEPART", "ABORTED"],
            "retreat from PLAN",
        ),
        (["mission.observe=400 s", "mission.time_limit=3 s"], ["DEPART", "ABORTED"], "given up in OBSERVE"),
        (["chaser.limits.planned_force=0.01 N"], ["RETREAT", "DEPART", "ABORTED"], "retreat from PLAN"),
    ],
    ids=["camera", "imu", "planner", "time", "no plan"],
)
def test_a_fault_ends_the_mission_in_safety(overrides: list[str], phases: list[str], cause: str) -> None:
    result = Mission(_load(*overrides).config).run()
    _ends_with(result, *phases)
    assert result.summary["success"] is False
    assert result.summary["cause"] == cause
    assert result.summary["least_clearance"] > 0.2
    assert result.summary["given_up"]
    assert result.summary["final_speed"] == pytest.approx(0.02, abs=0.003)
    assert result.summary["final_range_rate"] == pytest.approx(result.summary["final_speed"], abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "cause"), [("camera", "camera silent"), ("imu", "inertial unit silent")])
def test_a_sensor_that_fails_on_the_approach_leads_to_a_clear_retreat(kind: str, cause: str) -> None:
    fault = f"mission.faults=[{{kind: {kind}, start: 45 s, duration: 900 s}}]"
    result = Mission(_load("mission.wait_limit=0 s", *_ERRORS, fault).config, 2).run()
    _ends_with(result, "RETREAT", "DEPART", "ABORTED")
    assert result.summary["cause"] == cause
    assert result.summary["least_clearance"] > 0.0
    assert result.summary["escape_missing"] == 0
    assert np.linalg.norm(result.log.arrays()["x"][-1, :3]) > 1.5


@pytest.mark.slow
def test_a_mission_that_is_out_of_time_on_the_approach_retreats() -> None:
    result = Mission(_load(*_SHORT, *_ERRORS, "mission.time_limit=30 s").config, 2).run()
    _ends_with(result, "TRACK", "RETREAT", "DEPART", "ABORTED")
    assert result.summary["cause"] == "out of time in TRACK"
    assert result.summary["least_clearance"] > 0.0
    assert np.linalg.norm(result.log.arrays()["x"][-1, :3]) > 1.5


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["camera", "imu", "planner"])
def test_a_mission_continues_after_a_fault_that_ends(kind: str) -> None:
    fault = f"mission.faults=[{{kind: {kind}, start: 20 s, duration: 8 s}}]"
    result = Mission(_load(*_SHORT, *_ERRORS, fault).config, 2).run()
    assert result.summary["success"], _phases(result)
    assert ("RETREAT" in _phases(result)) is (kind != "planner")
    assert result.summary["least_clearance"] > 0.05


@pytest.mark.slow
@pytest.mark.parametrize("outside", [0.009, 0.011])
def test_an_approach_is_planned_again_where_the_chaser_is_out_of_its_tube(
    monkeypatch: pytest.MonkeyPatch, outside: float
) -> None:
    step, steps = LinearFeedback.step, []

    def moved(run: LinearFeedback, estimate: FloatArray, followed: TrackedReference, k: int) -> TrackerOutput:
        steps.append(k)
        off = -outside if steps.count(30) == 1 and k == 30 else 0.0
        return replace(step(run, estimate, followed, k), outside=np.array([0.0, off, 0.0]))

    monkeypatch.setattr(LinearFeedback, "step", moved)
    result = Mission(_load(*_SHORT, *_ERRORS).config, 2).run()
    assert (_phases(result).count("TRACK") > 1) is (outside > 0.01)
    assert result.summary["success"], _phases(result)
    assert result.summary["least_clearance"] > 0.05


@pytest.mark.slow
@pytest.mark.parametrize("finds_a_plan", [True, False])
def test_a_reference_beyond_the_limits_leads_to_a_new_plan_on_the_way_or_to_a_retreat(
    monkeypatch: pytest.MonkeyPatch, finds_a_plan: bool
) -> None:
    asked = []

    def problem(design: object, plan: object, bound: object, reference: object, k: int = 0) -> str:
        asked.append(k)
        return "beyond a limit" if 95 <= k <= 104 and len([j for j in asked if j >= 95]) <= 2 else ""

    monkeypatch.setattr(actions, "reference_problem", problem)
    fault = [] if finds_a_plan else ["mission.faults=[{kind: planner, start: 10 s, duration: 100 s}]"]
    result = Mission(_load("mission.wait_limit=0 s", *fault).config, 2).run()
    phases = _phases(result)
    assert phases.count("TRACK") == (2 if finds_a_plan else 1)
    assert result.summary["success"] is finds_a_plan
    assert result.summary["least_clearance"] > 0.09
    if not finds_a_plan:
        assert phases[phases.index("TRACK") + 1 :][:2] == ["PLAN", "RETREAT"]
    else:
        plans = [event["data"] for event in result.log.events if event["event"] == "plan"]
        assert plans[-1]["t_start"] > plans[0]["t_start"] + 15.0


def test_an_approach_starts_only_where_the_mating_point_can_be_held_in_the_keep_in_box() -> None:
    limits = ["chaser.limits.keep_in=[0.4 m, 3 m, 0.4 m]", "mission.wait_limit=30 s", "mission.hold_limit=5 s"]
    result = Mission(_load(*_SHORT, *limits).config, 2).run()
    assert result.summary["success"], result.summary
    refusals = [event["data"]["refusal"] for event in result.log.events if event["event"] == "tube"]
    assert "keep-in box" in refusals[0]  # the box is smaller by the tube, which is not known before the first plan
    assert not any(event["event"] == "reference" for event in result.log.events)
    assert _phases(result).count("TRACK") == 1


def test_observation_that_stays_coarse_is_flagged() -> None:
    overrides = ["mission.observe_limit=5 s", "mission.attitude_sigma=0.1 deg", "mission.time_limit=8 s", *_ERRORS]
    result = Mission(_load(*overrides).config, 2).run()
    assert any(event["event"] == "coarse" for event in result.log.events)


@pytest.mark.slow
def test_another_tracker_reaches_the_mating_point() -> None:
    assert Mission(_load("tracker={functor: LQRTracker}").config).run().summary["success"]


def test_a_chaser_that_leaves_the_keep_in_box_comes_back() -> None:
    """At 0.3 m/s it cannot brake within 0.8 m."""
    result = Mission(_load("chaser.velocity=[0.3 m/s, 0 m/s, 0 m/s]", "mission.time_limit=60 s").config).run()
    left = [event for event in result.log.events if event["event"] == "transition" and event["data"]["to"] == "RETREAT"]
    assert left[0]["data"]["guard"] == "fault"
    arrays = result.log.arrays()
    outside = np.abs(arrays["x"][:, 0]) > 0.8
    assert arrays["t"][outside].min() - 0.25 < left[0]["t"] <= arrays["t"][outside].min() + 0.01
    assert not outside[-1]
    assert result.summary["keep_in_excursion"] == pytest.approx(np.abs(arrays["x"][:, 0]).max() - 0.8)


def test_a_mission_that_left_the_keep_in_box_is_no_success(flown: MissionResult) -> None:
    config = _load(*_SHORT, *_ERRORS).config
    limits = config.chaser.limits.model_copy(update={"keep_in": (0.8, 1.4, 0.8)})  # without the check of the start
    config = config.model_copy(update={"chaser": config.chaser.model_copy(update={"limits": limits})})
    summary = summarise_mission(config, config.target(), flown.log, True, "")
    assert flown.summary["keep_in_excursion"] == 0.0
    assert summary["keep_in_excursion"] == pytest.approx(0.1, abs=0.01)
    assert not summary["success"]
    assert summary["cause"] == "outside of the keep-in box by 0.1 m"
    assert summary["contact_speed"] is None
    assert "excursion from the keep-in box            0.1 m" in mission_table(summary)
    assert not summary["given_up"]


@pytest.mark.parametrize("rates", [("10 ms", 10, 100), ("10 ms", 50, 100)])
def test_the_step_of_control_is_that_of_the_file(rates) -> None:
    tick, control, update = rates
    names = [f"mission.tick={tick}", f"mission.control_ticks={control}", f"mission.update_ticks={update}"]
    result = Mission(_load(*_SHORT, *_ERRORS, *names, "mission.checkout=2 s").config, 2).run()
    assert result.summary["success"], result.summary
    step = 0.01 * control
    np.testing.assert_allclose(np.diff(result.log.plans[0].times), step, rtol=1e-9)
    np.testing.assert_allclose(np.diff(result.log.arrays()["t"]), step, rtol=1e-9)
    assert result.summary["largest_gauge"] < 1.0


def test_a_mission_is_watched_at_every_step(flown: MissionResult) -> None:
    times: list[float] = []
    result = Mission(_load("mission.time_limit=1 s").config, watch=lambda context: times.append(context.time)).run()
    assert times == result.log.arrays()["t"].tolist()
