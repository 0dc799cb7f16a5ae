"""The command: it continues after a stop with the same result, and says in one line what is wrong."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import pytest

from safe_inspect.cli.commands import baseline
from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.errors import OutputError, SafeInspectError
from safe_inspect.evaluation import rollout
from safe_inspect.evaluation.baselines import complete
from safe_inspect.policies.open_loop import OpenLoopPlan
from safe_inspect.policies.plan_record import Record, read_record

ABOUT = {"safe_inspect": "0", "configuration_file": "x", "overrides": []}


class StoppedError(Exception):
    pass


def asked(seed: int = 3) -> Record:
    return Record(seed, "quick", {"points": 100}, ABOUT)


@pytest.fixture
def inspector(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the search: the plans are the trajectories of the inspector, found in a moment."""
    monkeypatch.setattr("safe_inspect.evaluation.optimiser._search", lambda *_: (None, None))


def command(*texts: str) -> int:
    parser = argparse.ArgumentParser()
    baseline.add_arguments(parser)
    return baseline.run(parser.parse_intermixed_args(texts))


@pytest.mark.parametrize("search", ["inspector", pytest.param("whole", marks=pytest.mark.long)])
def test_a_run_that_was_stopped_continues_with_the_same_result(
    spec: EnvironmentSpec,
    tmp_path: Path,
    search: str,
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if search == "inspector":
        request.getfixturevalue("inspector")

    def stop(done: int, wanted: int) -> None:
        if done >= 2:
            raise StoppedError

    stopped, whole = tmp_path / "stopped.json", tmp_path / "whole.json"
    complete(spec, asked(), 4, path=whole)
    monkeypatch.setattr("safe_inspect.evaluation.baselines._BATCH", 1)
    with pytest.raises(StoppedError):
        complete(spec, asked(), 4, path=stopped, progress=stop)
    assert not stopped.exists()
    assert len(read_record(f"{stopped}.part").entries) == 2
    shown: list[int] = []
    monkeypatch.setattr("safe_inspect.evaluation.baselines._BATCH", 2)
    complete(spec, asked(), 4, path=stopped, progress=lambda done, wanted: shown.append(done))
    assert shown == [2, 4]
    assert stopped.read_bytes() == whole.read_bytes()
    assert not Path(f"{stopped}.part").exists()
    # A request for more episodes continues from the file; fewer are read from it.
    more = complete(spec, asked(), 5, path=stopped)
    assert more.entries[:4] == read_record(whole).entries
    assert complete(spec, asked(), 2, path=stopped).entries == more.entries[:2]
    assert len(read_record(stopped).entries) == 5


@pytest.mark.usefixtures("inspector")
def test_a_file_of_another_run_is_kept_unless_forced(spec: EnvironmentSpec, tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    complete(spec, asked(), 2, path=path)
    before = path.read_bytes()
    other = Record(3, "quick", {"points": 99}, ABOUT)
    for record, shown in ((asked(4), "seed"), (other, "another task")):
        with pytest.raises(OutputError, match=shown):
            complete(spec, record, 2, path=path)
    assert path.read_bytes() == before
    complete(spec, asked(4), 2, path=path, force=True)
    assert read_record(path).seed == 4
    path.write_text("{}")
    for force in (False, True):
        with pytest.raises(SafeInspectError, match="not a file of"):
            complete(spec, asked(4), 2, path=path, force=force)
    assert path.read_text() == "{}"


@pytest.mark.slow
def test_the_file_states_every_episode(spec: EnvironmentSpec, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    path = tmp_path / "optimum.json"
    assert command("optimiser", "--episodes", "2", "--seed", "9", "--effort", "quick", "--output", str(path)) == 0
    printed = capsys.readouterr().out
    assert "success   100.00 %" in printed
    content = json.loads(path.read_text())
    assert (content["kind"], content["seed"], content["episodes"]) == ("optimiser", 9, 2)
    for name in ("delta_v", "success", "steps", "plans"):
        assert len(content[name]) == 2
    flown = rollout(spec, OpenLoopPlan.read(path), episodes=2, seed=9)
    assert flown.delta_v.tolist() == content["delta_v"]
    assert flown.success.tolist() == content["success"]


@pytest.mark.parametrize(
    ("texts", "shown"),
    [
        (["inspector"], "run a policy by `safe-inspect evaluate`"),
        (["optimiser", "--output", "{folder}"], "folder"),
        (["optimiser", "--output", "{folder}/file/x.json"], "cannot be written"),
        (["optimiser", "--cfg", "{folder}/none.yml"], "none.yml"),
        (["optimiser", "nonsense.path=1"], "nonsense"),
    ],
)
def test_mistakes_are_reported_in_one_line(texts: list[str], shown: str, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(SafeInspectError, match=shown) as caught:
        command(*(text.format(folder=tmp_path) for text in texts), "--episodes", "1")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("texts", [["--episodes", "0"], ["--seed", "-1"], ["--effort", "huge"]])
def test_numbers_out_of_range_are_refused(texts: list[str]) -> None:
    with pytest.raises(SystemExit):
        command("optimiser", *texts)
