from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from safe_inspect.cli.main import main
from safe_inspect.config.data import configs_root
from safe_inspect.errors import CheckpointError
from safe_inspect.evaluation.episodes import join
from safe_inspect.evaluation.missions import mission_episode, mission_task
from safe_inspect.evaluation.results.files import write_evaluation
from safe_inspect.evaluation.results.results import Evaluation
from safe_inspect.figures.campaign_figure import campaign_figure
from safe_inspect.missions.record import read_mission
from safe_inspect.rendezvous.experiment import load_rendezvous

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
        (["--seed", "1"], "--seed has no effect on a recorded mission"),
        (["--episode", "1"], "--episode has no effect on a recorded mission"),
        (["--cfg", "a.yml"], "--cfg has no effect on a recorded mission"),
        (["horizon=3"], "KEY=VALUE has no effect on a recorded mission"),
        (["--until", "0.1"], "--until 0.1: no step has ended by then"),
        (["--output", "a.txt"], "must end in .png, .pdf, .svg"),
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
    "state": (lambda path: _set(path / "log.npz", "state", np.full(STEPS, 99)), "not a phase"),
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


@pytest.fixture
def missions() -> Callable[[int, int], Evaluation]:
    """Return an evaluation of some missions, of which the first few have failed."""
    config = load_rendezvous(configs_root() / "tumbling-rendezvous" / "experiment-truth.yml").config

    def evaluation(count: int, failures: int) -> Evaluation:
        episodes = [
            mission_episode(config, k, {
                "success": k >= failures, "cause": "" if k >= failures else "camera silent",
                "least_clearance": 0.1 + 0.01 * k, "mating_position_error": 1.0 if k < failures else 0.001 * (k + 1),
                "mating_speed_error": 0.001, "delta_v": 0.1, "largest_gauge": None, "time": 240.0,
            })
            for k in range(count)
        ]  # fmt: skip
        record = {"seed": 0, "episodes": count, "task": mission_task(config)}
        return Evaluation.of("pilot", join(episodes), record)

    return evaluation


def test_the_distributions_of_many_missions_are_drawn(
    tmp_path: Path, missions: Callable[[int, int], Evaluation], capsys: pytest.CaptureFixture[str]
) -> None:
    evaluation = missions(10, 2)
    write_evaluation(evaluation, tmp_path / "many")
    assert main(["draw", str(tmp_path / "many"), "--output", str(tmp_path / "a.png")]) == 0
    outcome = "10 missions, success 80.0 % (95 % interval 49.0 to 94.3 %; win 8, lose 2)"
    assert f"a.png: {outcome}\n" in capsys.readouterr().out
    assert main(["draw", str(tmp_path / "many"), "--until", "3", "--output", str(tmp_path / "b.png")]) == 2
    assert "--until is for one mission" in capsys.readouterr().err
    for command, ending in (("film", "gif"), ("view", "html")):
        assert main([command, str(tmp_path / "many"), "--output", str(tmp_path / f"a.{ending}")]) == 2
        assert "run one of them with `rendezvous --episode N" in capsys.readouterr().err
    figure = campaign_figure(evaluation)
    clearance, error, _, _, gauge, _ = figure.axes
    curve = clearance.lines[0]
    np.testing.assert_allclose(curve.get_xdata(), [12, *range(12, 20)])
    np.testing.assert_allclose(curve.get_ydata(), 12.5 * np.arange(9))
    assert error.get_xscale() == "log"  # two failed a metre away
    assert not gauge.lines
    assert [text.get_text() for text in figure.texts] == [outcome, "2 failed: camera silent"]


def test_all_missions_may_fail_or_succeed(missions: Callable[[int, int], Evaluation]) -> None:
    assert campaign_figure(missions(3, 3)).texts[0].get_text().startswith("3 missions, success 0.0 %")
    assert campaign_figure(missions(1, 0)).texts[1].get_text() == ""
