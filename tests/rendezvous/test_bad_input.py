"""Bad input of every kind gives one message of where, what, and what to do, and no traceback."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from safe_inspect.cli.main import main
from safe_inspect.errors import ConfigError
from safe_inspect.missions.mission import Mission
from safe_inspect.rendezvous.experiment import build_rendezvous, load_rendezvous

from .test_experiment import SHIPPED

_OPEN = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n"


@pytest.fixture
def files(tmp_path: Path) -> Path:
    (tmp_path / "open.obj").write_text(_OPEN)
    return tmp_path


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("target={functor: MeshTarget, config: {path: FILES/open.obj}}", "open.obj: the mesh is not a closed surface"),
        ("target={functor: MeshTarget, config: {path: FILES/none.stl}}", "none.stl: the mesh cannot be read"),
        (
            "target={functor: BoxTarget, config: {inertia: [[1, 0, 0], [0, 1, 0], [0, 0, 3]]}}",
            "target.config.inertia: no body has the principal moments 1, 1 and 3 kg m^2",
        ),
        (
            "target={functor: BoxTarget, config: {inertia: [[1, 0.5, 0], [0, 1, 0], [0, 0, 1.5]]}}",
            "target.config.inertia: inertia must be a symmetric matrix",
        ),
        ("chaser.inertia=[1 kg m^2, 1 kg m^2, 5 kg m^2]", "inertia: no body has the moments 1, 1 and 5 kg m^2"),
        ("target.config.mating_point=[0.05 m, 0 m, 0 m]", "would overlap the target by 0.332 m there; move the point"),
        ("target.config.mating_point=[5 m, 0 m, 0 m]", "the centre of mass, farther than any corner"),
        ("target.config.mating_point=[0 m, 0 m, 0 m]", "the mating point is the target's centre of mass"),
        ("chaser.position=[0 m, 0 m, 0 m]", "chaser.position: the chaser would overlap the target"),
        ("tumble.config.rate=-5 deg/s", "tumble.config.rate: expected a number of 0 or more"),
        ("tumble.config.direction=[0, 0, 0]", "is neither a direction nor an attitude"),
        (
            "tumble={functor: RandomTumble, config: {least_rate: 5 deg/s, largest_rate: 2 deg/s}}",
            "least_rate (0.08727 rad/s) is more than largest_rate",
        ),
    ],
)
def test_a_mistake_is_one_message(override: str, message: str, files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    quick = ["mission.checkout=0 s", "mission.observe=0 s"]
    assert main(["rendezvous", str(SHIPPED), *quick, override.replace("FILES", str(files))]) == 2
    printed = capsys.readouterr().err
    assert message in printed
    assert printed.count("error:") == 1
    assert "Traceback" not in printed


def test_a_missing_library_is_one_message(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == "piqp"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [_Without("piqp"), *sys.meta_path])
    assert main(["rendezvous", str(SHIPPED), "mission.checkout=0 s", "mission.observe=0 s"]) == 2
    assert (
        "needs 'piqp', which is not installed; install the extra: pip install .[rendezvous]" in capsys.readouterr().err
    )


class _Without:
    """Finds a library not to be installed."""

    def __init__(self, name: str) -> None:
        self.name = name

    def find_spec(self, name: str, *_: object) -> None:
        if name == self.name:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("chaser.mass=1e30 kg", "chaser.mass: 0.3 N move 1e+30 kg by"),
        ("chaser.mass=1e-30 kg", "chaser.mass: 0.3 N move 1e-30 kg by"),
        ("chaser.inertia=[1e-300 kg m^2, 1e-300 kg m^2, 1e-300 kg m^2]", "chaser.inertia: 0.025 N m turn it by"),
        ("tumble.config.rate=1e308 rad/s", "tumble.config.rate: the target turns by inf deg in a control step"),
        ("tumble.config.rate=1000 deg/s", "tumble.config.rate: the target turns by 200 deg in a control step"),
        (
            "mission.tick=1e-9 s",
            "mission: the control step, tick times control_ticks, is 2.5e-08 s; it must be 0.02 to 1 s",
        ),
        ("mission.wait_step=1e-9 s", "mission: wait_step: 1e-09 s is not a multiple of the control step"),
        ("mission.wait_limit=1e9 s", "mission: wait_limit (1e+09 s) is more than 1,000 times wait_step (1 s)"),
        ("mission.hold_limit=1e300 s", "mission: hold_limit: 1e+300 s is more than 5,000 control steps"),
        ("mission.durations=[1e6 s]", "mission: durations: 1e+06 s is more than 5,000 control steps"),
        ("mission.length=1e300", "mission: length: 1e+300 m is more than 1,000,000 m"),
        ("mission.update_ticks=100000000000000000000000", "mission: update_ticks: 8e+20 s is more than 5,000 control"),
        ("mission.durations=['0 s']", "mission.durations[0]: expected a number above 0, got 0.0"),
        ("sensors.imu={gyro_nois: 1}", "sensors.imu.gyro_nois: unknown key `gyro_nois`; known: `acceleration`"),
        ("planner=MeasuredState", "'MeasuredState' is a state_estimator; expected an approach_planner here"),
        ("bound.trials=100000000", "bound.trials: 100000000 trials are more than 20,000"),
        ("mission.checkout=11 s", "mission: checkout (11 s) is more than checkout_limit (10 s)"),
        ("mission.hold_speed=0 m/s", "mission.hold_speed: expected a number above 0, got 0"),
        ("mission.hold=21 s", "mission: hold (21 s) is more than hold_limit (20 s)"),
        ("sensors.camera.least_range=4 m", "least_range (4 m) must be below largest_range (4 m)"),
        ("tracker={functor: TubeTracker, config: {least_frequency: 2}}", "least_frequency (2 rad/s) is more than larg"),
        ("chaser.limits.cone=200 deg", "chaser.limits.cone: expected an angle of 180 deg or less, got 200 deg"),
        ("target={functor: MeshTarget, config: {path: FILES/text}}", "text: the mesh cannot be read"),
        ("target={functor: MeshTarget, config: {path: FILES/bad.ply}}", "bad.ply: the mesh cannot be read"),
        ("target={functor: MeshTarget, config: {path: FILES/bad.obj}}", "bad.obj: the mesh cannot be read"),
        ("sensors.imu={rate: 0.0}", "imu: rate is 0; an estimator needs"),
        (
            "sensors.imu={rate_walk: -1.0}",
            "imu: rate_walk is -1; an estimator",
        ),
    ],
)
def test_what_would_hang_or_fail_in_flight_is_refused_before(
    override: str, message: str, files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (files / "text").write_text("root:x:0:0")
    (files / "bad.ply").write_text("ply\nformat ascii 1.0\nelement vertex 3\nend_header\n")
    (files / "bad.obj").write_text("v 0 0\nf 1 2 9\n")
    override = override.replace("FILES", str(files))
    assert main(["validate", str(SHIPPED), override]) == 2
    printed = capsys.readouterr().err
    assert message in printed
    assert "items" not in printed
    assert printed.startswith(f"error: command line: {override}")


def test_calls_from_python_say_what_they_take() -> None:
    experiment = load_rendezvous(SHIPPED)
    with pytest.raises(
        TypeError, match=r"a mission needs a RendezvousConfig, such as `load_rendezvous\(FILE\)\.config`"
    ):
        Mission(experiment)  # type: ignore[arg-type]
    for number in (-1, 1.5):
        with pytest.raises(ValueError, match="the number of a mission must be a whole number of 0 or more"):
            Mission(experiment.config, number)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match=r"overrides must be a list of strings; write \['seed=3'\]"):
        load_rendezvous(SHIPPED, "seed=3")
    with pytest.raises(ConfigError, match="a configuration must be a mapping of keys to values, not None"):
        build_rendezvous(None)
