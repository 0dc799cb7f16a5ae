from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from safe_inspect.cli.main import main
from safe_inspect.errors import CheckpointError
from safe_inspect.figures.rendezvous.campaign_figure import campaign_figure
from safe_inspect.rendezvous.missions.campaign import read_missions, write_missions
from safe_inspect.rendezvous.missions.record import read_mission
from safe_inspect.rendezvous.missions.tables import rate_of_success

STEPS = 40


def test_a_mission_is_drawn_filmed_and_viewed(
    mission_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["draw", str(mission_folder)]) == 0
    assert (tmp_path / "mission.png").read_bytes().startswith(b"\x89PNG")
    assert capsys.readouterr().out.startswith("mission.png: success after 8 s; ")
    assert main(["draw", str(mission_folder), "--until", "2", "--output", "early.svg"]) == 0
    assert main(["film", str(mission_folder), "--frames", "2", "--width", "320"]) == 0
    assert (tmp_path / "mission.gif").read_bytes().startswith(b"GIF89a")
    assert main(["view", str(mission_folder)]) == 0
    assert "<title>Rendezvous mission</title>" in (tmp_path / "mission.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--seed", "1"], "--seed changes nothing in a flown mission"),
        (["--episode", "1"], "--episode changes nothing in a flown mission"),
        (["--cfg", "a.yml"], "--cfg changes nothing in a flown mission"),
        (["horizon=3"], "KEY=VALUE changes nothing in a flown mission"),
        (["--until", "0.1"], "--until 0.1: no step has ended by then"),
        (["--output", "a.txt"], "ends in .png, .pdf, .svg"),
    ],
)
def test_an_option_that_a_mission_does_not_have_is_one_message(
    mission_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    options: list[str], message: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["draw", str(mission_folder), *options]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def _drop(path: Path, name: str) -> None:
    with np.load(path) as arrays:
        kept = {key: arrays[key] for key in arrays.files if key != name}
    np.savez_compressed(path, **kept)  # type: ignore[arg-type]


def _set(path: Path, name: str, value: object) -> None:
    with np.load(path) as arrays:
        kept = {key: arrays[key] for key in arrays.files}
    np.savez_compressed(path, **{**kept, name: value})  # type: ignore[arg-type]


DAMAGE = {
    "cut": (lambda path: (path / "log.npz").write_bytes((path / "log.npz").read_bytes()[:3000]), "log.npz: the file"),
    "text": (lambda path: (path / "log.npz").write_text("no arrays"), "log.npz: the file cannot be read"),
    "flipped": (
        lambda path: (path / "plan_0.npz").write_bytes(
            (path / "plan_0.npz").read_bytes()[:200] + bytes(50) + (path / "plan_0.npz").read_bytes()[250:]
        ),
        "plan_0.npz: the file cannot be read",
    ),
    "array": (lambda path: _drop(path / "log.npz", "tube_force"), "no array tube_force"),
    "plan": (lambda path: _drop(path / "plan_0.npz", "force"), "plan_0.npz: the file cannot be read (no array force)"),
    "shape": (lambda path: _set(path / "log.npz", "x", np.zeros((3, 6))), "x has the shape (3, 6), not (40, 6)"),
    "state": (lambda path: _set(path / "log.npz", "state", np.full(STEPS, 99)), "no phase"),
    "nan": (lambda path: _set(path / "log.npz", "q", np.full((STEPS, 4), np.nan)), "q is not finite"),
    "log": (lambda path: (path / "log.npz").unlink(), "no log.npz; give the folder of a mission"),
    "config": (lambda path: (path / "config.resolved.yml").unlink(), "no config.resolved.yml"),
    "summary": (lambda path: (path / "summary.json").write_text("{"), "summary.json: the file cannot be read"),
    "events": (lambda path: (path / "events.jsonl").write_text("[1]\n"), "events.jsonl: the file cannot be read"),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_a_damaged_mission_is_one_message(
    mission_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    damage, message = DAMAGE[kind]
    own = tmp_path / "mission"
    shutil.copytree(mission_folder, own)
    damage(own)
    with pytest.raises(CheckpointError):
        read_mission(own)
    assert main(["draw", str(own), "--output", str(tmp_path / "a.png")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error
    assert len(error.strip().splitlines()) == 1
    assert not (tmp_path / "a.png").exists()


def _summaries(count: int, failures: int) -> list[dict[str, object]]:
    return [
        {
            "mission": k, "success": k >= failures, "cause": "" if k >= failures else "camera silent",
            "least_clearance": 0.1 + 0.01 * k, "mating_position_error": 1.0 if k < failures else 0.001 * (k + 1),
            "mating_speed_error": 0.001, "delta_v": 0.1, "largest_gauge": None, "time": 240.0,
        }
        for k in range(count)
    ]  # fmt: skip


def test_the_distributions_of_many_missions_are_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    summaries = _summaries(10, 2)
    write_missions(tmp_path / "missions.parquet", summaries)
    assert read_missions(tmp_path / "missions.parquet") == summaries
    assert main(["draw", str(tmp_path), "--output", str(tmp_path / "a.png")]) == 0
    assert "a.png: 8 of 10 missions succeeded: 80.0 % (95 % interval 44.4 to 97.5 %)" in capsys.readouterr().out
    assert main(["draw", str(tmp_path), "--until", "3", "--output", str(tmp_path / "b.png")]) == 2
    assert "--until cuts one mission" in capsys.readouterr().err
    figure = campaign_figure(summaries)
    clearance, error, _, _, gauge, _ = figure.axes
    curve = clearance.lines[0]
    np.testing.assert_allclose(curve.get_xdata(), [12, *range(12, 20)])
    np.testing.assert_allclose(curve.get_ydata(), 12.5 * np.arange(9))
    assert error.get_xscale() == "log"  # two failed a metre away
    assert not gauge.lines
    assert [text.get_text() for text in figure.texts] == [rate_of_success(summaries), "2 failed: camera silent"]


def test_all_missions_may_fail_or_succeed() -> None:
    assert campaign_figure(_summaries(3, 3)).texts[0].get_text().startswith("0 of 3 missions succeeded")
    assert campaign_figure(_summaries(1, 0)).texts[1].get_text() == ""


def test_the_folder_of_many_missions_is_neither_filmed_nor_damaged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "missions.parquet"
    write_missions(table, _summaries(2, 0))
    assert main(["film", str(tmp_path), "--output", str(tmp_path / "a.gif")]) == 2
    assert "the folder of many missions; no mission has failed" in capsys.readouterr().err
    (tmp_path / "mission_0003").mkdir()
    assert main(["view", str(tmp_path)]) == 2
    assert "such as" in capsys.readouterr().err
    for damage in (b"", b"PAR1" + bytes(100), table.read_bytes()[:-30]):
        table.write_bytes(damage)
        assert main(["draw", str(tmp_path), "--output", str(tmp_path / "a.png")]) == 2
        error = capsys.readouterr().err
        assert "missions.parquet: the file cannot be read" in error
        assert len(error.strip().splitlines()) == 1
    write_missions(table, [{"name": 1}])
    assert main(["draw", str(tmp_path), "--output", str(tmp_path / "a.png")]) == 2
    assert "no table of missions" in capsys.readouterr().err
