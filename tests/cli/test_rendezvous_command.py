from __future__ import annotations

import json
from pathlib import Path

import pytest

from safe_inspect.cli.main import main
from safe_inspect.config.data import configs_root
from safe_inspect.missions.mission import Mission
from safe_inspect.missions.record import json_text
from safe_inspect.rendezvous.experiment import load_rendezvous

_FILE = str(configs_root() / "tumbling-rendezvous" / "experiment-truth.yml")
_QUICK = ["mission.observe=1 s", "mission.checkout=0.4 s", "mission.wait_limit=0 s"]


def test_a_dry_run_prints_the_resolved_experiment(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rendezvous", _FILE, "--dry-run", "tumble.config.rate=2 deg/s"]) == 0
    printed = capsys.readouterr().out
    assert "rate: 2 deg/s" in printed
    assert "functor: EnvisatTarget" in printed


def test_a_mistake_is_printed_without_a_traceback(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rendezvous", _FILE, "planner={functor: SplinePlanner}"]) == 2
    assert "did you mean `SplineSCPPlanner`?" in capsys.readouterr().err


def test_its_file_is_validated_like_others(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", _FILE]) == 0
    assert "is valid: rendezvous, EnvisatTarget, TriAxialTumble, SplineSCPPlanner" in capsys.readouterr().out
    assert main(["validate", _FILE, "mission.observ=3 s"]) == 2
    assert "did you mean `observe`?" in capsys.readouterr().err


def test_one_mission_leaves_its_files_and_a_failed_one_another_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["rendezvous", _FILE, *_QUICK, "--output", str(tmp_path / "run")]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("success\n")
    assert "least clearance" in printed
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["success"] is True
    assert main(["rendezvous", _FILE, *_QUICK, "mission.time_limit=0.8 s"]) == 1
    assert capsys.readouterr().out.startswith("failed: given up in OBSERVE\n")


def test_an_episode_of_an_evaluation_is_flown_alone(tmp_path: Path) -> None:
    short = [_FILE, "tumble={functor: RandomTumble}", "mission.time_limit=0.8 s"]
    assert main(["rendezvous", *short, "--episode", "3", "--output", str(tmp_path / "run")]) == 1
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    expected = Mission(load_rendezvous(short[0], short[1:]).config, 3).run().summary
    assert summary == json.loads(json_text(expected))


def test_a_mission_prints_its_state_every_ten_seconds(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rendezvous", _FILE, "mission.time_limit=35 s"]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "loading; the first run on a machine compiles for a minute"
    printed = [line for line in lines if "from the target's centre" in line]
    assert [line.split()[0] for line in printed] == ["0.0", "10.0", "20.0", "30.0"]
    assert printed[0].endswith(
        "s  CHECKOUT, 1.50 m from the target's centre; attitude within 0 deg, rate within 0 deg/s"
    )
    assert "OBSERVE, 1.50 m" in printed[1]


def test_what_is_doubtful_is_printed_before_the_flight(capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("validate", "rendezvous"):
        main([command, _FILE, "tumble.config.rate=0.08", "mission.time_limit=1 s"])
        err = capsys.readouterr().err
        assert "warning: command line: tumble.config.rate=0.08: tumble.config.rate: 0.08 has no unit" in err
    assert main(["validate", _FILE, "chaser.position=[0 m, -0.3 m, 0 m]"]) == 2
    assert "chaser.position: the chaser would overlap the target" in capsys.readouterr().err


def test_the_missions_before_an_episode_are_looked_at_too(capsys: pytest.CaptureFixture[str]) -> None:
    random = "tumble={functor: RandomTumble, config: {least_rate: 2 deg/s, largest_rate: 40 deg/s}}"
    assert main(["rendezvous", _FILE, random, "--episode", "19", "--dry-run"]) == 0
    assert "of 20 missions, such as" in capsys.readouterr().err


def test_where_the_log_is_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "run"
    assert main(["rendezvous", _FILE, "mission.time_limit=0.4 s", "--output", str(folder)]) == 1
    assert capsys.readouterr().out.endswith(f"\nthe log is in {folder}\n")
    assert {path.name for path in folder.iterdir()} >= {
        "summary.json",
        "log.npz",
        "events.jsonl",
        "config.resolved.yml",
    }
