from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.cli.main import main

CFG = "safe_inspect/TranslationalInspectionSeed-v0"
PNG = b"\x89PNG"
SHORT = ["random", "--cfg", CFG, "--seed", "3"]


def test_an_episode_is_drawn_filmed_and_viewed(tmp_path, capsys):
    assert main(["draw", *SHORT, "--output", str(tmp_path / "a.png")]) == 0
    assert (tmp_path / "a.png").read_bytes().startswith(PNG)
    assert "episode 0" in capsys.readouterr().out
    film = ["--frames", "3", "--width", "320", "--output", str(tmp_path / "new" / "a.gif")]
    assert main(["film", *SHORT, *film]) == 0
    assert (tmp_path / "new" / "a.gif").read_bytes().startswith(b"GIF89a")
    assert main(["view", *SHORT, "--episode", "2", "--output", str(tmp_path / "a.html")]) == 0
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "<title>random, TRANSLATIONAL-INSPECTION, episode 2 of seed 3</title>" in page


def test_overrides_may_stand_anywhere_and_count(tmp_path, capsys):
    assert main(["draw", "zero-thrust", "--output", str(tmp_path / "a.svg"), "horizon=6"]) == 0
    assert "1.0 min" in capsys.readouterr().out  # six steps of ten seconds


def test_the_episode_of_a_number_is_that_of_a_rollout(spec):
    from safe_inspect.evaluation import rollout
    from safe_inspect.evaluation.rollouts import record_episode
    from safe_inspect.policies import RandomThrust

    among = rollout(spec, RandomThrust(), episodes=4, seed=3, record=4).trajectories[2]
    alone = record_episode(spec, RandomThrust(), episode=2, seed=3)
    for name in ("time", "position", "velocity", "control", "delta_v", "sun_angle", "inspected_at", "inspector"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(among, name))
    assert (alone.slot, alone.status) == (2, among.status)


def test_a_damaged_recording_is_not_drawn(tmp_path, capsys):
    words = ["--episodes", "1", "--record", "1", "horizon=20", "--output", str(tmp_path / "out")]
    assert main(["evaluate", *SHORT, *words]) == 0
    table = tmp_path / "out" / "trajectories.npz"
    whole = table.read_bytes()
    for place in (4, len(whole) // 3, len(whole) // 2):
        table.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        for source in (table, table.parent):
            assert main(["draw", str(source), "--output", str(tmp_path / "damaged.png")]) == 2
            assert "trajectories.npz: the file was damaged or changed after it was written" in capsys.readouterr().err


def test_a_recorded_episode_is_drawn_as_it_was_flown(spec, tmp_path, capsys):
    from safe_inspect.evaluation import rollout
    from safe_inspect.evaluation.results.files import save_packed
    from safe_inspect.policies import RandomThrust

    file = tmp_path / "trajectories.npz"
    save_packed(file, rollout(spec, RandomThrust(), 2, 3, record=2).trajectories)
    for source in (file, tmp_path):
        assert main(["view", str(source), "--episode", "1", "--output", str(tmp_path / "recorded.html")]) == 0
    capsys.readouterr()
    assert main(["view", *SHORT, "--episode", "1", "--title", "other", "--output", str(tmp_path / "flown.html")]) == 0
    pages = [(tmp_path / f"{name}.html").read_text(encoding="utf-8") for name in ("recorded", "flown")]
    bodies = [page.partition('id="episode">')[2] for page in pages]
    assert bodies[0] == bodies[1]
    assert main(["draw", str(file), "--episode", "7", "--output", str(tmp_path / "a.png")]) == 2
    assert "episode 7 is not recorded; the last one is 1" in capsys.readouterr().err
    assert main(["draw", str(file), "--cfg", CFG, "--output", str(tmp_path / "a.png")]) == 2
    assert "--cfg has no effect on a recorded episode" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (["draw", "inspecter"], "did you mean `inspector`?"),
        (["draw", "no/such/checkpoint"], "there is no such checkpoint or ONNX file"),
        (["draw", "no.onnx"], "no.onnx: there is no such file"),
        (["draw", "no.npz"], "no.npz: there are no recorded episodes"),
        (["draw", "."], "neither a checkpoint nor the folder of a training run"),
        (["draw", "random", "--output", "a.txt"], "must end in .png, .pdf, .svg"),
        (["film", "random", "--output", "a.avi"], "must end in .gif, .mp4"),
        (["view", "random", "--output", "a.png"], "must end in .html"),
        (["draw", "random", "--output", "file/a.png"], "give another"),
        (["film", "random", "--frames", "1"], "2 to 20,000 --frames"),
        (["film", "random", "--frames", "1000000000"], "2 to 20,000 --frames"),
        (["draw", "random", "--cfg", "no.yml"], "no.yml"),
        (["draw", "zero-thrust", "--until", "3", "horizon=5"], "--until 3: no step has ended by then"),
        (["draw", "random", "no.such.key=1"], "no.such.key"),
        (["curves"], "give folders of training runs"),
        (["curves", "nowhere"], "nowhere: there is no such folder"),
        (["curves", "--label", "label"], "give folders of training runs"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_message(tmp_path, monkeypatch, capsys, command, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    assert main(command) == 2
    told = capsys.readouterr().err
    assert message in told
    assert "Traceback" not in told
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file"]


def test_learning_curves_are_drawn(tmp_path, capsys):
    for index in range(2):
        folder = tmp_path / f"run_2026-01-01_00-00-0{index}"
        folder.mkdir()
        lines = [f"{i},{1000 * i},{0.1 * i},0.5,0.5,20" for i in range(1, 5 + index)]
        header = "iteration,steps,return_mean,success_rate,inspected_fraction,delta_v"
        (folder / "progress.csv").write_text("\n".join([header, *lines]))
    runs = sorted(str(path) for path in tmp_path.glob("run_*"))
    assert main(["curves", *runs, "--output", str(tmp_path / "c.png")]) == 0
    assert "run (2)" in capsys.readouterr().out
    assert main(["curves", *runs, "--label", "a", "--label", "b", "--output", str(tmp_path / "c.pdf")]) == 0
    assert "a (1), b (1)" in capsys.readouterr().out
    assert (tmp_path / "c.pdf").read_bytes().startswith(b"%PDF")
