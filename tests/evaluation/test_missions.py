"""Missions of a rendezvous as episodes of an evaluation: workers, what is kept, tables. The missions end soon."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from safe_inspect.cli.main import main
from safe_inspect.config.data import configs_root
from safe_inspect.evaluation import missions
from safe_inspect.evaluation.episodes import Episodes, join
from safe_inspect.evaluation.kept import KeptEpisodes
from safe_inspect.evaluation.missions import LocalFlights, fly_missions, mission_episode
from safe_inspect.evaluation.results.files import read_evaluation
from safe_inspect.evaluation.results.results import Evaluation
from safe_inspect.evaluation.results.tables import evaluation_table
from safe_inspect.missions.mission import Mission
from safe_inspect.missions.summary import MISSION_FIGURES
from safe_inspect.rendezvous.experiment import Rendezvous, load_rendezvous

_FILE = configs_root() / "tumbling-rendezvous" / "experiment-truth.yml"
_SHORT = ["tumble={functor: RandomTumble}", "mission.checkout=0.4 s", "mission.time_limit=2 s"]


def _load(*overrides: str) -> Rendezvous:
    return load_rendezvous(_FILE, [*_SHORT, *overrides])


def _command(episodes: int, output: Path, *words: str) -> list[str]:
    return ["evaluate", "--cfg", str(_FILE), *_SHORT, "--episodes", str(episodes), "--output", str(output), *words]


def _values(found: Evaluation | Episodes) -> dict[str, Any]:
    """Return all that does not depend on the speed of the machine."""
    evaluation = found if isinstance(found, Evaluation) else Evaluation.of("", found)
    values = {**evaluation.team.figures, **evaluation.initial_states, "status": evaluation.team.status}
    return {name: array for name, array in values.items() if name != "planning time"} | {"cause": evaluation.causes}


def _assert_equal(one: Evaluation | Episodes, other: Evaluation | Episodes) -> None:
    first, second = _values(one), _values(other)
    assert first.keys() == second.keys()
    for name, values in first.items():
        np.testing.assert_array_equal(values, second[name], err_msg=name)


def test_an_episode_has_the_figures_of_its_mission() -> None:
    experiment = _load("seed=3")
    episodes = fly_missions(experiment, 2)
    assert episodes.seed == 3
    for number in range(2):
        mission = Mission(experiment.config, number)
        _, chaser, target = next(mission.steps())
        summary = Mission(experiment.config, number).run().summary
        for name in {*MISSION_FIGURES} - {"planning_time"}:
            expected = np.nan if summary[name] is None else summary[name]
            np.testing.assert_array_equal(episodes.info[name][number], expected, err_msg=name)
        assert episodes.delta_v[number] == summary["delta_v"]
        assert episodes.length[number] * 0.2 == pytest.approx(summary["time"])
        assert episodes.causes is not None
        assert episodes.causes[number] == summary["cause"] == "given up in OBSERVE"
        begun = {name: values[number] for name, values in episodes.initial_states.items()}
        np.testing.assert_array_equal(begun["position"][0], chaser.position)
        np.testing.assert_allclose(begun["target_orientation"], target.orientation, atol=1e-12)
        np.testing.assert_allclose(begun["target_angular_velocity"], target.angular_velocity, atol=1e-12)
    assert not episodes.success.any()


def test_missions_that_are_kept_are_not_flown_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    experiment, flown, shown = _load(), [], []
    fly = missions.fly_mission

    def counted(tree: Any, source: str, number: int) -> Any:
        if number == 2 and len(flown) == 2:
            raise KeyboardInterrupt
        flown.append(number)
        return fly(tree, source, number)

    monkeypatch.setattr(missions, "fly_mission", counted)
    with pytest.raises(KeyboardInterrupt):
        fly_missions(experiment, 4, kept=KeptEpisodes(tmp_path, "pilot"))
    flown.append(-1)
    found = fly_missions(experiment, 4, None, KeptEpisodes(tmp_path, "pilot"), lambda *done: shown.append(done))
    assert flown == [0, 1, -1, 2, 3]
    assert shown == [(2, 4), (3, 4), (4, 4)]
    _assert_equal(found, fly_missions(experiment, 4))
    kept = KeptEpisodes(tmp_path, "pilot")
    _assert_equal(fly_missions(experiment, 3, kept=kept), fly_missions(experiment, 3))
    assert len(flown) == 5 + 4 + 3


def test_two_workers_fly_the_missions_of_one() -> None:
    _assert_equal(fly_missions(_load(), 3, LocalFlights(2)), fly_missions(_load(), 3))


def test_evaluate_flies_missions_and_compare_compares_pilots(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(_command(2, tmp_path / "tube", "--seed", "5")) == 0
    captured = capsys.readouterr()
    assert captured.out.startswith("pilot: 2 episodes, success 0.0 % (95 % interval 0.0 to 65.8 %; lose 2)\n")
    assert "2 lost: given up in OBSERVE (episodes 0, 1)" in captured.out
    assert captured.err.startswith("loading;")
    tube = read_evaluation(tmp_path / "tube")
    assert tube.record["seed"] == 5
    _assert_equal(tube, fly_missions(_load("seed=5"), 2))
    assert main(_command(2, tmp_path / "seed", "seed=5")) == 0
    _assert_equal(read_evaluation(tmp_path / "seed"), tube)
    assert main(_command(2, tmp_path / "lqr", "seed=5", "tracker={functor: LQRTracker}")) == 0
    capsys.readouterr()
    folders = [str(tmp_path / name) for name in ("tube", "lqr")]
    assert main(["compare", *folders]) == 0
    assert "2 episodes of seed 5, the same for all" in capsys.readouterr().out
    # The experiment of the first is flown where none is named.
    assert main(["compare", folders[0], "pilot", "tracker={functor: LQRTracker}"]) == 0
    assert "pilot less " in capsys.readouterr().out
    assert main(_command(2, tmp_path / "fast", "seed=5", "mission.observe=1 s")) == 0
    capsys.readouterr()
    assert main(["compare", folders[0], str(tmp_path / "fast")]) == 2
    assert "rendezvous.mission.observe" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        (["inspector"], "inspector: a rendezvous is controlled by its pilot"),
        (["--record", "1"], "--record is only for environments"),
        (["--num-envs", "4"], "--num-envs is only for environments"),
        (["--mode"], "--mode is only for environments"),
        (["--metric", "LargestSpeed"], "--metric is only for environments"),
        (["planner={functor: SplinePlanner}"], "did you mean `SplineSCPPlanner`?"),
        (["chaser.position=[0 m, -0.3 m, 0 m]"], "chaser.position: the chaser would overlap the target"),
    ],
)  # fmt: skip
def test_what_a_rendezvous_does_not_have_is_refused(
    words: list[str], shown: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(_command(1, tmp_path / "out", *words)) == 2
    assert shown in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_workers_are_for_missions(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "random", "--workers", "2"]) == 2
    assert "--workers is only for a rendezvous" in capsys.readouterr().err


def test_the_table_names_the_causes_of_losses() -> None:
    summary = {**dict.fromkeys(MISSION_FIGURES, 1.0), "delta_v": 0.2}
    config = _load().config
    causes = ["", "no plan", *["contact with the target"] * 11]
    found = [
        mission_episode(config, k, {**summary, "success": not cause, "cause": cause}) for k, cause in enumerate(causes)
    ]
    evaluation = Evaluation.of("pilot", join(found))
    assert evaluation.team.status.tolist() == ["win", *["lose"] * 12]
    lines = evaluation_table(evaluation).splitlines()
    assert "win 1, lose 12" in lines[0]
    assert lines[-2:] == [
        "  11 lost: contact with the target (episodes 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, ...)",
        "  1 lost: no plan (episodes 1)",
    ]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="processes are looked for in /proc")
def test_an_evaluation_that_is_killed_leaves_its_missions_and_no_process(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "safe_inspect", *_command(400, tmp_path / "out", "--workers", "2")]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    part = tmp_path / "out.part"
    try:
        _wait_for(lambda: len(list(part.glob("pilot-*.npz"))) >= 3)
        workers = _children(process.pid)
    finally:
        process.kill()
        process.wait()
    assert len(workers) >= 2
    _wait_for(lambda: not any(_runs(worker) for worker in workers))
    numbers = [int(file.stem.removeprefix("pilot-")) for file in part.glob("pilot-*.npz")]
    count = max(numbers) + 1
    _assert_equal(fly_missions(_load(), count, None, KeptEpisodes(part, "pilot")), fly_missions(_load(), count))


def _wait_for(condition: Callable[[], bool], seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def _children(parent: int) -> list[int]:
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            number, _, rest = status.read_text().partition(" (")
            if int(rest.rpartition(") ")[2].split()[1]) == parent:
                found.append(int(number))
    return found


def _runs(number: int) -> bool:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{number}/stat").read_text().rpartition(") ")[2][0] != "Z"
    return False


@pytest.mark.ray
@pytest.mark.slow
def test_ray_flies_the_missions_of_one_process(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "safe_inspect", *_command(3, tmp_path / "out", "--workers", "2", "address=local")]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert run.returncode == 0, run.stderr
    _assert_equal(read_evaluation(tmp_path / "out"), fly_missions(_load(), 3))
