from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from safe_inspect.config.data import configs_root
from safe_inspect.errors import ConfigError, MissingLibraryError
from safe_inspect.missions.scenario import check_scenario, initial_tumbles, mission_streams
from safe_inspect.rendezvous.experiment import build_rendezvous, load_rendezvous, read_target
from safe_inspect.rendezvous.inertial_unit import ImuNoise
from safe_inspect.rendezvous.libraries import require

SHIPPED = configs_root() / "tumbling-rendezvous" / "experiment-truth.yml"


def test_the_shipped_experiment_loads_with_units_and_includes() -> None:
    config = load_rendezvous(SHIPPED).config
    assert config.target.mating_point == (0.25, 0.0, 0.42)
    assert config.chaser.limits.force == 0.3
    assert config.chaser.actuator.force_noise == pytest.approx(3e-3)
    assert config.mission.step == pytest.approx(0.2)
    assert config.mission.update_period == pytest.approx(1.0)
    assert config.tumble.rate == pytest.approx(0.0872664626)


def test_what_is_resolved_loads_again_as_the_same_experiment(tmp_path: Path) -> None:
    experiment = load_rendezvous(SHIPPED, ["tumble.config.rate=3 deg/s"])
    (tmp_path / "resolved.yml").write_text(experiment.text)
    again = load_rendezvous(tmp_path / "resolved.yml")
    assert again.config == experiment.config
    assert yaml.safe_load(again.text) == yaml.safe_load(experiment.text)


def test_every_mistake_is_reported_with_file_line_and_path(tmp_path: Path) -> None:
    folder = tmp_path / "configs"
    folder.mkdir()
    (folder / "chaser.yml").write_text("mass: 9 kg\nlimits:\n  forse: 0.3 N\n")
    (folder / "experiment.yml").write_text(
        "seed: -1\nchaser: !include ./chaser.yml\ntarget: {functor: EnvisatTraget}\n"
        "tumble: {functor: TriAxialTumble, config: {rate: 5 m}}\n"
    )
    with pytest.raises(ConfigError) as caught:
        load_rendezvous(folder / "experiment.yml")
    text = str(caught.value)
    assert "experiment.yml:1 seed:" in text
    assert "chaser.yml:3 chaser.limits.forse: unknown key `forse`; did you mean `force`?" in text
    assert (
        "experiment.yml:3 target.functor: unknown target_model 'EnvisatTraget'; did you mean `EnvisatTarget`?" in text
    )
    assert "experiment.yml:4 tumble.config.rate:" in text
    assert len(caught.value.problems) == 4


def test_overrides_are_checked() -> None:
    with pytest.raises(ConfigError, match=r"mission\.observ: unknown key `observ`; did you mean `observe`"):
        load_rendezvous(SHIPPED, ["mission.observ=3"])
    with pytest.raises(ConfigError, match="planned_force"):
        load_rendezvous(SHIPPED, ["chaser.limits.planned_force=0.4 N"])
    with pytest.raises(ConfigError, match="tumble=TriAxialTumbel: tumble: unknown parameter 'TriAxialTumbel'; did you"):
        load_rendezvous(SHIPPED, ["tumble=TriAxialTumbel"])
    with pytest.raises(ConfigError, match="multiple of control_ticks"):
        load_rendezvous(SHIPPED, ["mission.update_ticks=130"])
    with pytest.raises(
        ConfigError, match=r"the control step, tick times control_ticks, is 1\.25 s; it must be 0\.02 to 1 s"
    ):
        load_rendezvous(SHIPPED, ["mission.tick=50 ms"])
    with pytest.raises(ConfigError, match=r"wait_step: 1 s is not a multiple of the control step, 0\.4 s"):
        load_rendezvous(SHIPPED, ["mission.control_ticks=50", "mission.update_ticks=150"])
    with pytest.raises(ConfigError, match=r"durations: 60\.1 s is not a multiple"):
        load_rendezvous(SHIPPED, ["mission.durations=[60.1 s]"])


@pytest.mark.parametrize(
    ("overrides", "where", "message"),
    [
        (["bound.epsilon=0.001"], "bound.epsilon", r"0\.001 needs 999 trials, and `trials` is 200"),
        (
            ["sensors.frame_period=0.3 s"],
            "sensors.frame_period",
            r"0\.3 s is not a multiple of the control step",
        ),
        (
            ["sensors.frame_period=6.2 s"],
            "sensors.frame_period",
            r"6\.2 s between two frames are more than the 6 s, mission\.camera_silence \(5 s\) and one update of the",
        ),
        (["sensors.imu_ticks=26"], "sensors.imu_ticks", "more than the 25 ticks of a control step"),
        (["chaser.position=[0 m, -3.5 m, 0 m]"], "chaser.position", "the start is outside of the keep-in box"),
    ],
)
def test_what_cannot_be_flown_is_refused_when_the_file_is_checked(overrides, where, message) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        load_rendezvous(SHIPPED.with_name("experiment.yml"), overrides)
    (problem,) = caught.value.problems
    assert problem.path == where
    assert problem.location is not None
    assert problem.location.text == overrides[0]


def test_a_mistake_of_merged_mappings_stands_where_its_value_was_written(tmp_path: Path) -> None:
    (tmp_path / "base.yml").write_text("mass: 9 kg\nlimits:\n  planned_force: 0.1 N\n  force: 0.3 N\n")
    (tmp_path / "experiment.yml").write_text(
        "seed: 0\nchaser:\n  - !include ./base.yml\n  - radius: 0.2 m\n    limits: {planned_force: 0.4 N}\n"
    )
    with pytest.raises(ConfigError, match=r"experiment\.yml:5 chaser\.limits: planned_force"):
        load_rendezvous(tmp_path / "experiment.yml")
    with pytest.raises(ConfigError, match=r"command line: chaser\.limits\.force=0\.4 N: chaser\.limits: planned_force"):
        load_rendezvous(tmp_path / "experiment.yml", ["chaser.limits.force=0.4 N"])
    with pytest.raises(ConfigError, match=r"command line: chaser\.inertia=.*: chaser: inertia: no body"):
        load_rendezvous(SHIPPED, ["chaser.inertia=[1 kg m^2, 1 kg m^2, 5 kg m^2]"])


def test_a_key_that_no_file_has_may_be_given_on_the_command_line(tmp_path: Path) -> None:
    (tmp_path / "experiment.yml").write_text("seed: 3\n\ntumble: RandomTumble\n")
    overrides = ["mission.observe=5 s", "planner.config.samples=61", "bound.trials=300", "plugin_paths=[json]"]
    config = load_rendezvous(tmp_path / "experiment.yml", overrides).config
    assert (config.mission.observe, config.planner.samples, config.plugin_paths) == (5.0, 61, ("json",))
    assert config.bound.trials == 300


def _doubts(*overrides: str, missions: int = 1) -> list[str]:
    return [str(doubt) for doubt in check_scenario(load_rendezvous(_SENSORS, overrides), missions)]


_SENSORS = SHIPPED.with_name("experiment.yml")
_ROOM = "chaser.limits.keep_in=[9 m, 9 m, 9 m]"


def test_the_shipped_experiments_are_not_doubted() -> None:
    for file in SHIPPED.parent.glob("experiment*.yml"):
        assert check_scenario(load_rendezvous(file)) == []
    assert _doubts("tumble={functor: RandomTumble}", missions=100) == []


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            ["sensors.imu_ticks=7"],
            r"imu_ticks: the last inertial sample is up to 48 ms older than a frame; take",
        ),
        ([_ROOM, "chaser.position=[0 m, -4.5 m, 0 m]"], r"chaser\.position: the target's centre is 4\.5 m away"),
        (["estimator.config.known_target=false"], "known_target: without a known shape .* no approach is planned"),
        (
            ["tumble.config.rate=15 deg/s", "chaser.limits.speed=9 m/s"],
            r"tumble\.config\.rate: the target turns by up to",
        ),
        (
            ["estimator=MeasuredState", "tumble.config.rate=30 deg/s"],
            r"following the mating point takes at least .* m/s and .* N",
        ),
        (["tumble.config.rate=0.0872"], r"0\.0872 has no unit and is read as 0\.0872 rad/s, which is 4\.996 deg/s"),
        (["mission.time_limit=122 s"], r"mission\.time_limit: the mission ends after 122 s at .* no approach starts"),
        (["mission.observe=301 s"], r"mission\.observe: 301 s are more than mission\.observe_limit, 300 s, which ends"),
        (
            ["sensors.camera.least_range=0.25 m"],
            r"least_range: the camera measures from 0\.25 m, and .* 0\.246 m away; lower it",
        ),
        (
            ["chaser.limits.torque=1e-4 N m"],
            r"limits\.torque: 0\.0001 N m need 145 s to turn .* 5\.13 deg/s; an approach",
        ),
        (["chaser.actuator.lag=0.3 s"], r"actuator\.lag: the tube does not include that the actuators lag by 0\.3 s"),
        (["chaser.limits.cone=1.2"], r"chaser\.limits\.cone: 1\.2 has no unit .* 68\.75 deg; write the unit"),
    ],
)
def test_what_is_doubtful_is_said_before_the_flight_with_its_place(overrides, message) -> None:
    (doubt,) = _doubts(*overrides)
    assert re.search(message, doubt)
    assert doubt.startswith("command line: ")


def test_a_target_that_the_camera_cannot_see_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"command line: .*: chaser\.position: .* it sees nothing of the target"):
        _doubts(_ROOM, "chaser.position=[0 m, -5.5 m, 0 m]")


def test_tumbles_of_many_missions_are_drawn() -> None:
    random = "tumble={functor: RandomTumble, config: {least_rate: 2 deg/s, largest_rate: 40 deg/s}}"
    (doubt,) = _doubts("estimator=MeasuredState", random, missions=20)
    assert re.search(r"following the mating point in \d+ of 20 missions, such as \d+, takes", doubt)


@pytest.mark.parametrize("key", ["functor", "type"])
def test_a_tumble_is_any_parameter_with_an_attitude_and_a_rate(key: str) -> None:
    config = load_rendezvous(SHIPPED, [f"tumble={{{key}: TumbleParameter}}"]).config
    attitudes, rates = initial_tumbles(config, mission_streams(config, 0, 1, 2))
    np.testing.assert_allclose(np.linalg.norm(attitudes, axis=1), 1.0)
    assert (
        (np.deg2rad(1.0) <= np.linalg.norm(rates, axis=1)) & (np.linalg.norm(rates, axis=1) <= np.deg2rad(5.0))
    ).all()
    other = load_rendezvous(SHIPPED, [f"tumble={{{key}: ConstantParameter}}"])
    message = r"command line: tumble=.*: tumble: `ConstantParameter` gives no attitude and angular velocity; use Tumble"
    with pytest.raises(ConfigError, match=message):
        check_scenario(other)


def test_the_tumble_of_a_mission_is_the_same_alone() -> None:
    config = load_rendezvous(SHIPPED, ["tumble={functor: RandomTumble}"]).config
    together = initial_tumbles(config, mission_streams(config, 0, 1, 2))
    for number in range(3):
        for values, (value,) in zip(together, initial_tumbles(config, mission_streams(config, number)), strict=True):
            np.testing.assert_array_equal(values[number], value)


def test_a_file_that_a_plugin_reads_is_found_next_to_the_file_that_names_it(tmp_path: Path, monkeypatch) -> None:
    trimesh = pytest.importorskip("trimesh")
    shapes, parts, elsewhere = (tmp_path / name for name in ("shapes", "parts", "elsewhere"))
    for folder in (shapes, parts, elsewhere):
        folder.mkdir()
    trimesh.creation.box((0.4, 0.3, 0.2)).export(shapes / "body.stl")
    trimesh.creation.box((0.8, 0.3, 0.2)).export(elsewhere / "other.stl")
    (parts / "target.yml").write_text(
        "functor: MeshTarget\nconfig: {path: ../shapes/body.stl, mating_point: [0 m, 0 m, 0.6 m]}\n"
    )
    (tmp_path / "experiment.yml").write_text("seed: 0\ntarget: !include ./parts/target.yml\n")
    monkeypatch.chdir(elsewhere)
    experiment = load_rendezvous("../experiment.yml")
    assert experiment.config.target.path == str(shapes / "body.stl")
    (tmp_path / "resolved.yml").write_text(experiment.text)
    monkeypatch.chdir("/")
    assert load_rendezvous(tmp_path / "resolved.yml").config.target().swept_radius == pytest.approx(0.2693, abs=1e-4)
    assert read_target(tmp_path / "experiment.yml").swept_radius == pytest.approx(0.2693, abs=1e-4)
    # A name on the command line is relative to the working directory.
    monkeypatch.chdir(elsewhere)
    own = load_rendezvous(tmp_path / "experiment.yml", ["target.config.path=other.stl"]).config.target
    assert own.path == str(elsewhere / "other.stl")
    missing = load_rendezvous(tmp_path / "experiment.yml", ["target.config.path=none.stl"]).config.target
    assert missing.path == str(elsewhere / "none.stl")


def test_a_library_that_is_not_installed_is_named_with_the_extra() -> None:
    with pytest.raises(MissingLibraryError, match=r"pip install \.\[rendezvous\]"):
        require("no_such_library")


def test_a_library_that_lacks_a_dependency_is_not_taken_for_missing(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "half_a_library.py").write_text("import no_such_library\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ModuleNotFoundError, match="No module named 'no_such_library'"):
        require("half_a_library")


def test_a_file_of_another_kind_is_named() -> None:
    with pytest.raises(ConfigError, match="not a rendezvous experiment: the file has none of the keys"):
        load_rendezvous(SHIPPED.with_name("chaser.yml"))
    assert build_rendezvous({}).config.seed == 0


@pytest.mark.parametrize(
    ("override", "part", "key", "value"),
    [("time_limit=600 s", "mission", "time_limit", 600.0), ("mass=10 kg", "chaser", "mass", 10.0)],
)
def test_a_key_that_no_file_has_is_overridden_by_its_name(override, part, key, value):
    assert getattr(getattr(load_rendezvous(SHIPPED, [override]).config, part), key) == value


def test_a_misspelt_key_that_no_file_has_is_recognised() -> None:
    with pytest.raises(ConfigError, match="there is no `time_limt` in the configuration; did you mean `time_limit`"):
        load_rendezvous(SHIPPED, ["time_limt=5 s"])


@pytest.mark.parametrize("path", ["sensors.imu.rate_bias", "imu.rate_bias"])
def test_a_key_in_a_mapping_that_no_file_has_leaves_the_other_defaults(path):
    imu = load_rendezvous(SHIPPED, [f"{path}=1e-7"]).config.sensors.imu
    assert imu == ImuNoise(rate_bias=1e-7)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("sensors.imu.rate_bais=1", "did you mean `rate_bias`"),
        ("mission.time_limit.foo=5", "must have the keys `value`"),
    ],
)
def test_a_wrong_key_in_a_mapping_that_no_file_has_is_refused(override, message):
    with pytest.raises(ConfigError, match=message):
        load_rendezvous(SHIPPED, [override])
