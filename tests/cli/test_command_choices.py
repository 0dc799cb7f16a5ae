"""What commands refuse before their work, and what they pass on to it where the work is replaced."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from safe_inspect.cli import flights
from safe_inspect.cli.commands import baseline, leaderboard, record_log
from safe_inspect.cli.flights import PilotCandidate, open_pilot
from safe_inspect.config.data import configs_root
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.missions import LocalFlights
from safe_inspect.evaluation.results.results import EvaluationError
from safe_inspect.rendezvous.experiment import load_rendezvous
from safe_inspect.version import __version__

Typed = Callable[..., tuple[int, str, str]]
MISSION = str(configs_root() / "tumbling-rendezvous" / "experiment-truth.yml")
EXPERIMENT = str(configs_root() / "docking" / "experiment.yml")
pytestmark = pytest.mark.usefixtures("here")


def evaluation_arguments(**changes: Any) -> argparse.Namespace:
    given: dict[str, Any] = {
        "cfg": MISSION, "overrides": [], "seed": None, "workers": None, "record": None, "reference": None,
        "sampled": None, "num_envs": 512, "episodes": 4,
    }  # fmt: skip
    return argparse.Namespace(**given | changes)


@pytest.mark.parametrize(
    ("changes", "sources", "shown"),
    [
        ({"record": 3}, [], f"--record is only for environments, and {MISSION} is a rendezvous; remove it"),
        ({"reference": "r"}, [], f"--reference is only for environments, and {MISSION} is a rendezvous; remove it"),
        ({"sampled": False}, [], f"--mode is only for environments, and {MISSION} is a rendezvous; remove it"),
        ({"sampled": True}, ["pilot"], f"--mode is only for environments, and {MISSION} is a rendezvous; remove it"),
        ({"num_envs": 511}, [], f"--num-envs is only for environments, and {MISSION} is a rendezvous; remove it"),
        ({}, ["pilot", "inspector"], "inspector: a rendezvous is controlled by its pilot; remove the source, and "
         "choose the parts with KEY=VALUE, such as tracker={functor: LQRTracker}"),
        ({"cfg": EXPERIMENT, "workers": 2}, [], "--workers is only for a rendezvous; an environment runs "
         "--num-envs episodes at a time"),
    ],
)  # fmt: skip
def test_options_that_a_rendezvous_does_not_have(changes: dict[str, Any], sources: list[str], shown: str) -> None:
    with pytest.raises(SafeInspectError) as caught:
        open_pilot(evaluation_arguments(**changes), sources, None)
    assert str(caught.value) == shown


def test_the_pilot_of_an_evaluation(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    checked: list[int] = []
    monkeypatch.setattr(flights, "check_scenario", lambda experiment, count: checked.append(count) or ["doubt"])
    assert open_pilot(evaluation_arguments(cfg=EXPERIMENT), [], None) is None
    assert open_pilot(evaluation_arguments(cfg=None), [], None) is None
    arguments = evaluation_arguments(seed=9, workers=3)
    pilot = open_pilot(arguments, ["pilot"], None)
    assert pilot is not None
    assert (arguments.seed, arguments.num_envs, checked) == (9, 1, [4])
    assert pilot.experiment.config.seed == 9
    assert pilot.flights == LocalFlights(3)
    assert capsys.readouterr().err.splitlines()[1:] == ["warning: doubt"]
    plain = evaluation_arguments()
    other = open_pilot(plain, [], None)
    assert other is not None
    assert plain.seed == other.experiment.config.seed == load_rendezvous(MISSION, []).config.seed
    assert other.flights == LocalFlights(1)
    assert other.source["sha256"] != pilot.source["sha256"]
    assert {key: other.source[key] for key in ("text", "kind", "path")} == {
        "text": "pilot", "kind": "scripted", "path": None,
    }  # fmt: skip
    assert (other.label, other.price, other.measured([])) == ("pilot", "", [])
    metric: Any = SimpleNamespace()
    with pytest.raises(SafeInspectError, match=r"^--metric is only for environments, not for a rendezvous"):
        other.measured([metric])


def test_missions_are_flown_again_as_an_evaluation_says(monkeypatch: pytest.MonkeyPatch) -> None:
    flown: list[Any] = []
    monkeypatch.setattr(flights, "fly_missions", lambda *given: flown.append(given) or "episodes")
    experiment = load_rendezvous(MISSION, ["seed=3"])
    record = {"task": {"rendezvous": 1}, "configuration": experiment.resolved, "configuration_file": "there.yml"}
    model: Any = SimpleNamespace(record=record)
    found = open_pilot(evaluation_arguments(cfg=None, overrides=["seed=4"]), [], model)
    assert isinstance(found, PilotCandidate)
    assert (found.experiment.config.seed, found.experiment.source) == (4, "there.yml")
    kept: Any = object()
    assert found.fly(5, 4, 1, kept=kept, progress=print, record=0) == "episodes"
    assert flown == [(found.experiment, 5, found.flights, kept, print)]
    record["task"] = {}
    assert open_pilot(evaluation_arguments(cfg=None), [], model) is None


def test_policies_are_no_baselines(typed: Typed) -> None:
    shown = "there is no baseline 'random'; write `optimiser`, or run a policy by `safe-inspect evaluate`"
    assert typed("baseline", "random")[2] == f"error: {shown}\n"


@pytest.mark.parametrize(
    ("words", "effort"), [(("optimizer",), "normal"), (("optimiser", "--effort", "quick"), "quick")]
)
def test_a_baseline_is_asked_for_with_its_task(
    typed: Typed, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], effort: str
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(
        baseline, "complete", lambda spec, record, count, **more: asked.append((record, count, more)) or 1
    )
    monkeypatch.setattr(baseline, "baseline_table", lambda record: "the table")
    code, out, _ = typed("baseline", *words, "horizon=30", "--episodes", "7", "--seed", "2", "--output", "o", "--force")
    assert (code, out) == (0, "the table\nthe episodes are in o\n")
    ((record, count, more),) = asked
    assert (record.effort, record.seed, count) == (effort, 2, 7)
    assert (more["path"], more["force"]) == (Path("o"), True)
    assert record.about["overrides"] == ["horizon=30"]
    assert record.about["configuration_file"] == "safe_inspect/TranslationalInspectionSeed-v0"


@pytest.mark.parametrize(("period", "fits"), [("0.4", True), ("0.2", True), ("0.3", False), ("0.05", False)])
def test_frames_are_taken_at_steps_of_control(
    typed: Typed, monkeypatch: pytest.MonkeyPatch, period: str, fits: bool
) -> None:
    given: list[Any] = []

    def record(folder: Path, config: Any, mission: int, seconds: float, _: Any) -> int:
        given.append((config.sensors.frame_period, mission, seconds))
        return 17

    monkeypatch.setattr(record_log, "record_watch", record)
    words = ("record-log", MISSION, "--period", period, "--seconds", "9", "--mission", "3", "--output", "o")
    code, out, err = typed(*words)
    if fits:
        assert (code, out, given) == (0, "17 frames are in o\n", [(float(period), 3, 9.0)])
    else:
        shown = f"error: --period {period} is not a multiple of the control step, 0.2 s; round it"
        assert (code, err.splitlines()[-1], given) == (2, shown, [])


@pytest.mark.parametrize(
    ("change", "known"),
    [({}, True), ({"episodes": 8}, False), ({"seed": 1}, False), ({"configuration": {"a": 2}}, False),
     ({"source": {"sha256": "y"}}, False), ({"safe_inspect": "0.0.1"}, False)],
)  # fmt: skip
def test_a_row_of_a_leaderboard_is_flown_once(
    here: Path, monkeypatch: pytest.MonkeyPatch, change: dict[str, Any], known: bool
) -> None:
    record = {
        "safe_inspect": __version__, "episodes": 9, "seed": 0, "configuration": {"a": 1, "b": "c"},
        "source": {"sha256": "x"},
    } | change  # fmt: skip
    monkeypatch.setattr(leaderboard, "is_evaluation", lambda folder: folder == here)
    monkeypatch.setattr(leaderboard, "read_evaluation_record", lambda folder: json.loads(json.dumps(record)))
    resolved = {"a": 1, "b": Path("c")}
    candidate = SimpleNamespace(experiment=SimpleNamespace(resolved=resolved), source={"sha256": "x"})
    entry: Any = SimpleNamespace(candidate=candidate)
    board: Any = SimpleNamespace(episodes=9, seed=0)
    assert leaderboard._is_known(here, entry, board) is known
    assert not leaderboard._is_known(here / "other", entry, board)

    def damaged(folder: Path) -> Any:
        raise EvaluationError("damaged")

    monkeypatch.setattr(leaderboard, "read_evaluation_record", damaged)
    assert not leaderboard._is_known(here, entry, board)
