"""Which episodes, missions and runs the commands of figures draw, with the drawing replaced."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from safe_inspect.cli import shown_episode
from safe_inspect.cli.commands import curves, draw, film, view
from safe_inspect.errors import SafeInspectError

Typed = Callable[..., tuple[int, str, str]]
pytestmark = pytest.mark.usefixtures("here")


@pytest.mark.parametrize(
    ("frames", "width", "fps", "fits"),
    [(2, 320, 1, True), (20_000, 3840, 100, True), (1, 320, 1, False), (20_001, 320, 1, False), (2, 319, 1, False),
     (2, 3841, 1, False), (2, 320, 101, False)],
)  # fmt: skip
def test_the_limits_of_a_film(
    typed: Typed, monkeypatch: pytest.MonkeyPatch, frames: int, width: int, fps: int, fits: bool
) -> None:
    made: list[Any] = []
    episode = trajectory()
    monkeypatch.setattr(film, "episode_of", lambda arguments, **_: (episode, "T"))
    monkeypatch.setattr(film, "Film", lambda *given: given)

    def save(film: Any, path: Path, rate: int, _: Any) -> None:
        path.write_bytes(b"x" * 1234)
        made.append((film, str(path), rate))

    monkeypatch.setattr(film, "save_film", save)
    words = ("--frames", str(frames), "--width", str(width), "--fps", str(fps), "--turn", "90")
    code, out, err = typed("film", "inspector", *words)
    if fits:
        assert (code, made) == (0, [((episode, frames, width, 90.0), "episode.gif", fps)])
        assert out == "episode.gif: episode 6, 2.5 min, 2 of 3 points, delta-v 0.750 m/s, 1 kB\n"
    else:
        assert (code, made) == (2, [])
        assert err == (
            "error: a film has 2 to 20,000 --frames, a --width of 320 to 3840 pixels and at most 100 --fps\n"
        )


def trajectory(points: int = 3) -> Any:
    return SimpleNamespace(
        slot=6, time=np.array([0.0, 10.0, 150.0]), points=np.zeros((points, 3)),
        delta_v=np.array([[0.0], [0.5], [0.75]]), inspected_at=np.array([1.0, np.inf, 9.0]),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("words", "title"),
    [((), "its title"), (("--title", "Mine"), "Mine")],
)
def test_the_title_of_a_page(typed: Typed, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], title: str) -> None:
    titles: list[str] = []
    monkeypatch.setattr(view, "episode_of", lambda arguments, **_: (trajectory(0), "its title"))
    monkeypatch.setattr(view, "episode_page", lambda episode, title: titles.append(title))
    monkeypatch.setattr(view, "save_page", lambda page, path: path.write_text("x" * 2600))
    assert typed("view", "inspector", "--seed", "3", *words)[:2] == (
        0, "episode.html: episode 6, 2.5 min, delta-v 0.750 m/s, 3 kB\n",
    )  # fmt: skip
    assert titles == [title]


def test_an_episode_is_flown_or_read_up_to_a_time(monkeypatch: pytest.MonkeyPatch, here: Path) -> None:
    cut: list[float] = []

    class Episode(SimpleNamespace):
        def until(self, time: float) -> Any:
            cut.append(time)
            return SimpleNamespace(time=np.arange(int(time)), slot=self.slot)

    config = SimpleNamespace(config=SimpleNamespace(config=SimpleNamespace(env_config=SimpleNamespace(TrialName="T"))))
    opened = SimpleNamespace(spec="spec", policies="policies", experiment=SimpleNamespace(config=config))
    asked: list[Any] = []
    monkeypatch.setattr(shown_episode, "open_candidates", lambda *given: asked.append(given) or [opened])
    monkeypatch.setattr(shown_episode, "record_episode", lambda *given: asked.append(given) or Episode(slot=given[2]))
    given: dict[str, Any] = {
        "source": "inspector",
        "cfg": "c",
        "overrides": ["a=1"],
        "episode": 4,
        "seed": 5,
        "until": None,
    }
    episode, title = shown_episode.episode_of(argparse.Namespace(**given))
    assert (episode.slot, title, cut) == (4, "inspector, T, episode 4 of seed 5", [])
    assert asked == [(["inspector"], shown_episode.Wanted("c", ("a=1",))), ("spec", "policies", 4, 5)]
    assert len(shown_episode.episode_of(argparse.Namespace(**given | {"until": 2.0}))[0].time) == 2
    with pytest.raises(
        SafeInspectError, match=r"^--until 1.5: no step has ended by then; give a later time in seconds$"
    ):
        shown_episode.episode_of(argparse.Namespace(**given | {"until": 1.5}))
    (here / "run").mkdir()
    (here / "run" / "trajectories.npz").write_text("")
    monkeypatch.setattr(shown_episode, "read_trajectories", lambda source: [Episode(slot=2), Episode(slot=7)])
    read = {**given, "source": "run", "cfg": None, "overrides": [], "seed": 0, "episode": 7}
    assert shown_episode.episode_of(argparse.Namespace(**read))[1] == "run, episode 7"
    for change, shown in (
        ({"cfg": "c"}, "run: --cfg has no effect on a recorded episode; remove it"),
        ({"overrides": ["a=1"]}, "run: KEY=VALUE has no effect on a recorded episode; remove it"),
        ({"seed": 1}, "run: --seed has no effect on a recorded episode; remove it"),
        ({"episode": 3}, "run: episode 3 is not recorded; the last one is 7"),
    ):
        with pytest.raises(SafeInspectError) as caught:
            shown_episode.episode_of(argparse.Namespace(**read | change))
        assert str(caught.value) == shown


def test_learning_curves_of_recipes(typed: Typed, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(curves, "recipes_of", lambda runs, labels: {f"{labels}": [Path(run) for run in runs]})
    monkeypatch.setattr(curves, "curves_figure", lambda recipes, centre, each: drawn.append((recipes, centre, each)))
    monkeypatch.setattr(curves, "save", lambda figure, path: None)
    assert typed("curves", "a", "b", "--label", "x")[:2] == (0, "curves.png: ['x'] (2)\n")
    assert typed("curves", "a", "--centre", "iqm", "--each", "--output", "o.svg")[:2] == (0, "o.svg: [] (1)\n")
    assert [item[1:] for item in drawn] == [("mean", False), ("iqm", True)]
    for wrong, shown in (
        (("--label", "x"), "no learning curves: give folders of training runs"),
        ((), "no learning curves: give folders of training runs"),
        (("a", "a"), "[]: a run is given twice, but must count once in a band over seeds"),
    ):
        assert typed("curves", *wrong) == (2, "", f"error: {shown}\n")
    assert len(drawn) == 2


def test_folders_without_a_learning_curve_are_left_out(
    typed: Typed, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(curves, "recipes_of", lambda runs, labels: {"x": [Path(run) for run in runs]})
    monkeypatch.setattr(curves, "curves_figure", lambda recipes, centre, each: None)
    monkeypatch.setattr(curves, "save", lambda figure, path: None)
    for name in ("run", "mission"):
        (here / name).mkdir()
    (here / "run" / "progress.csv").write_text("")
    assert typed("curves", "run", "mission") == (
        0, "curves.png: x (1)\n", "note: mission is left out, because it has no progress.csv\n"
    )  # fmt: skip
    monkeypatch.undo()
    monkeypatch.chdir(here)
    code, _, err = typed("curves", "mission")
    assert (code, err) == (
        2,
        "error: mission: there is no progress.csv in this folder; give the folder of a training run\n",
    )


@pytest.mark.parametrize(
    ("change", "shown"),
    [
        ({"cfg": "c"}, "--cfg has no effect on a recorded mission; remove it"),
        ({"overrides": ["a=1"]}, "KEY=VALUE has no effect on a recorded mission; remove it"),
        ({"seed": 1}, "--seed has no effect on a recorded mission; remove it"),
        ({"episode": 1}, "--episode has no effect on a recorded mission; remove it"),
        ({}, ""),
    ],
)
@pytest.mark.parametrize("name", ["events.jsonl", "log.npz"])
def test_options_that_a_flown_mission_does_not_have(here: Path, name: str, change: dict[str, Any], shown: str) -> None:
    arguments = argparse.Namespace(
        **{"source": str(here), "cfg": None, "overrides": [], "seed": 0, "episode": 0, "command": "film"} | change
    )
    assert not shown_episode.is_mission_source(arguments)
    (here / name).write_text("")
    if not shown:
        assert shown_episode.is_mission_source(arguments)
        return
    with pytest.raises(SafeInspectError) as caught:
        shown_episode.is_mission_source(arguments)
    assert str(caught.value) == f"{here}: {shown}"


def test_many_missions_are_drawn_alone(here: Path, monkeypatch: pytest.MonkeyPatch, typed: Typed) -> None:
    monkeypatch.setattr(shown_episode, "is_evaluation", lambda folder: True)
    monkeypatch.setattr(shown_episode, "read_evaluation_record", lambda folder: {"task": {"rendezvous": 1}})
    found = type("Found", (list,), {"team": "team"})([1, 2, 3])
    monkeypatch.setattr(draw, "read_evaluation", lambda folder: found)
    monkeypatch.setattr(draw, "ends", lambda team: f"ends of the {team}")
    monkeypatch.setattr(draw, "campaign_figure", lambda evaluation: evaluation)
    monkeypatch.setattr(draw, "save", lambda figure, path: path.write_text("x"))
    assert typed("draw", str(here))[:2] == (0, "mission.png: 3 missions, ends of the team\n")
    assert (
        typed("draw", str(here), "--until", "3")[2]
        == f"error: {here}: --until is for one mission, not several; remove it\n"
    )
    assert typed("view", str(here))[2].startswith(
        f"error: {here}: the evaluation of a rendezvous only has the results of its"
    )
