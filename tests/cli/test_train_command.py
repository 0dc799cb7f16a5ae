"""What a training is given by its command, and what the command prints of its end."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from safe_inspect.cli.commands import train
from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.errors import ConfigError, Problem
from safe_inspect.experiments.runs.train import TrainingResult

EXPERIMENT = str(configs_root() / "translational-inspection" / "experiment.yml")
Typed = Callable[..., tuple[int, str, str]]


def result_of(folder: Path, **changes: Any) -> TrainingResult:
    values: dict[str, Any] = {
        "folder": folder, "checkpoint": None, "iteration": 1, "steps": 900, "seconds": 12.6, "metrics": {},
        "interrupted": False,
    }  # fmt: skip
    return TrainingResult(**values | changes)


@pytest.mark.parametrize(
    ("changes", "lines"),
    [
        ({}, ["finished after 1 iteration, 900 steps, 13 s"]),
        ({"iteration": 0}, ["finished after 0 iterations, 900 steps, 13 s"]),
        (
            {"iteration": 2, "checkpoint": Path("c"), "best": Path("b")},
            ["finished after 2 iterations, 900 steps, 13 s", "checkpoint:  c", "the best:    b"],
        ),
        ({"interrupted": True}, ["interrupted after 1 iteration, 900 steps, 13 s"]),
    ],
)
def test_a_training_ends_with_its_lines(here: Path, changes: dict[str, Any], lines: list[str]) -> None:
    folder = here / "a run"
    shown = train._closing(result_of(folder, **changes)).splitlines()
    more = [f"evaluate:    safe-inspect evaluate '{folder}'"] if changes.get("checkpoint") else []
    more.append(f"TensorBoard: tensorboard --logdir '{folder}'")
    if changes.get("interrupted"):
        more.append(f"continue:    python -m safe_inspect.train_rl --resume '{folder}'")
    assert shown == [*lines, *more]


def test_a_search_ends_with_the_table_of_its_trials(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trials = tuple(SimpleNamespace(folder=here / "trials" / name) for name in ("one", "two"))
    monkeypatch.setattr(train, "trial_table", lambda found: [f"{len(found)} rows"])
    monkeypatch.setattr(train, "_draw_curve", lambda folder: folder / "curve.png")
    assert train._closing(result_of(here, trials=trials, seconds=3.0)).splitlines() == [
        "finished: 2 trials, 900 steps, 3 s", "2 rows", f"trials:      {here / 'trials'}",
        f"curves:      {here / 'curve.png'}", f"TensorBoard: tensorboard --logdir {here}",
    ]  # fmt: skip


def test_the_curve_of_a_run_is_drawn_from_its_progress(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(train, "save", lambda figure, target: drawn.append((figure, target)))
    monkeypatch.setattr(train, "curves_figure", lambda recipes: recipes)
    monkeypatch.setattr(train, "recipes_of", lambda folders: folders)
    assert train._draw_curve(here) == here / "learning_curve.png"
    (here / "progress.csv").write_text("")
    train._draw_curve(here)
    target = here / "learning_curve.png"
    assert drawn == [([here], target), ({here.name: [here / "progress.csv"]}, target)]


@pytest.mark.parametrize(("words", "output"), [((), Path("output")), (("--output", "elsewhere"), Path("elsewhere"))])
def test_a_training_gets_what_its_experiment_says(
    here: Path, typed: Typed, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], output: Path
) -> None:
    given: list[Any] = []
    monkeypatch.setattr(train, "train", lambda run: given.append(run) or result_of(here))
    code, out, _ = typed("train", EXPERIMENT, "lr=0.25", *words)
    (run,) = given
    assert code == 0
    assert out.startswith("finished after 1 iteration")
    experiment = load_experiment(EXPERIMENT, ["lr=0.25"])
    assert run.experiment == experiment.resolved
    assert run.rllib == {"algorithm": "PPO", **experiment.rllib}
    assert run.rllib["lr"] == 0.25
    task = experiment.config.config.config
    assert (run.tune, run.ray, run.name, run.text) == (
        task.tune_config, task.ray_config, "TRANSLATIONAL-INSPECTION", experiment.text,
    )  # fmt: skip
    assert (run.output, run.resume, run.maker) == (output, None, "")
    assert run.command[1:3] == ["-m", "safe_inspect.train_rl"]
    assert run.policies == tuple(experiment.policies.values())


def test_a_mistake_that_a_training_meets_gets_its_place(
    typed: Typed, monkeypatch: pytest.MonkeyPatch, here: Path
) -> None:
    def refuse(run: Any) -> TrainingResult:
        raise ConfigError([Problem("it is too small", "tune_config.stop.training_iteration")])

    monkeypatch.setattr(train, "train", refuse)
    code, _, err = typed("train", EXPERIMENT, "training_iteration=3")
    assert code == 2
    place = "command line: training_iteration=3: config.config.tune_config.stop.training_iteration"
    assert err.splitlines()[-1] == f"error: {place}: it is too small"
    monkeypatch.setattr(train, "train", lambda run: result_of(here, interrupted=True))
    assert typed("train", EXPERIMENT)[0] == 128 + signal.SIGINT


def test_a_training_that_continues_takes_the_configuration_of_its_run(
    typed: Typed, monkeypatch: pytest.MonkeyPatch, here: Path
) -> None:
    given: list[Any] = []
    monkeypatch.setattr(train, "train", lambda run: given.append(run) or result_of(here))
    monkeypatch.setattr(train.RunFolder, "open", lambda folder: SimpleNamespace(configuration=EXPERIMENT))
    assert typed("train", "--resume", "earlier")[0] == 0
    assert given[0].resume == Path("earlier")
    code, _, err = typed("train")
    assert (code, err) == (
        2,
        "error: no experiment: give an experiment file with --cfg, or an earlier run's folder with --resume\n",
    )
    assert len(given) == 1
