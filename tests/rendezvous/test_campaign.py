"""Campaigns: their folder, that goes on after a stop, their workers and tables. The missions end soon."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from safe_inspect.errors import OutputError
from safe_inspect.rendezvous.experiment import Rendezvous, load_rendezvous
from safe_inspect.rendezvous.missions import campaign
from safe_inspect.rendezvous.missions.campaign import LocalFlights, fly_missions
from safe_inspect.rendezvous.missions.folder import CampaignFolder
from safe_inspect.rendezvous.missions.tables import interval, missions_table, tumble_classes

from .test_experiment import SHIPPED

_SHORT = ["tumble={functor: RandomTumble}", "mission.checkout=0.4 s", "mission.time_limit=2 s"]


def _load(*overrides: str) -> Rendezvous:
    return load_rendezvous(SHIPPED, [*_SHORT, *overrides])


def _timeless(summaries: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{key: value for key, value in summary.items() if key != "planning_time"} for summary in summaries]


def test_a_campaign_goes_on_where_it_was_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    experiment, flown, shown = _load(), [], []
    fly = campaign.fly_mission

    def counted(tree: Any, source: str, number: int) -> campaign.FlownMission:
        if number == 2 and len(flown) == 2:
            raise KeyboardInterrupt
        flown.append(number)
        return fly(tree, source, number)

    monkeypatch.setattr(campaign, "fly_mission", counted)
    with pytest.raises(KeyboardInterrupt):
        fly_missions(experiment, 4, None, tmp_path)
    assert sorted(CampaignFolder(tmp_path).summaries()) == [0, 1]
    # A line that was being written when the process was killed counts for nothing.
    with (tmp_path / "missions.jsonl").open("a") as lines:
        lines.write('{"mission": 2, "succ')
    flown.append(-1)
    found = fly_missions(experiment, 4, None, tmp_path, lambda *done: shown.append(done))
    assert flown == [0, 1, -1, 2, 3]
    assert shown == [(0, 2), (1, 2), (2, 2)]
    assert _timeless(found) == _timeless(fly_missions(experiment, 4))
    assert fly_missions(experiment, 3, None, tmp_path) == found[:3]
    assert (tmp_path / "mission_0003" / "log.npz").is_file()


def test_two_workers_fly_the_missions_of_one(tmp_path: Path) -> None:
    one = fly_missions(_load(), 3)
    two = fly_missions(_load(), 3, LocalFlights(2), tmp_path)
    assert _timeless(two) == _timeless(one)
    assert sorted(CampaignFolder(tmp_path).summaries()) == [0, 1, 2]
    assert fly_missions(_load(), 3, LocalFlights(2), tmp_path) == two


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="processes are looked for in /proc")
def test_a_campaign_that_is_killed_leaves_its_missions_and_no_process(tmp_path: Path) -> None:
    folder = tmp_path / "campaign"
    command = [sys.executable, "-m", "safe_inspect", "rendezvous", str(SHIPPED), *_SHORT]
    command += ["--missions", "400", "--workers", "2", "--output", str(folder)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        _wait_for(lambda: folder.is_dir() and len(CampaignFolder(folder).summaries()) >= 3)
        workers = _children(process.pid)
    finally:
        process.kill()
        process.wait()
    assert len(workers) >= 2
    _wait_for(lambda: not any(_runs(worker) for worker in workers))
    flown = CampaignFolder(folder).summaries()
    count = max(flown) + 1
    assert _timeless(fly_missions(_load(), count, None, folder)) == _timeless(fly_missions(_load(), count))


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


def _open(path: Path, *overrides: str) -> None:
    with CampaignFolder.opened(path, _load(*overrides)):
        pass


def test_a_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    _open(tmp_path / "campaign")
    _open(tmp_path / "campaign")
    with pytest.raises(OutputError, match=r"campaign: holds missions of another experiment \(seed: 0 there, 3 here\)"):
        _open(tmp_path / "campaign", "seed=3")
    other = tmp_path / "other"
    other.mkdir()
    _open(other)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").write_text("all of it")
    with pytest.raises(OutputError, match="holds something else than a campaign"):
        _open(tmp_path / "full")
    assert [item.name for item in (tmp_path / "full").iterdir()] == ["thesis.tex"]
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="the folder cannot be written"):
        _open(tmp_path / "file")


@pytest.mark.skipif(sys.platform == "win32", reason="folders are not locked there")
def test_two_commands_do_not_fly_into_one_folder(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path\n"
        "from safe_inspect.errors import OutputError\n"
        "from safe_inspect.rendezvous.missions.folder import CampaignFolder\n"
        "from safe_inspect.rendezvous.experiment import load_rendezvous\n"
        "try:\n"
        "    with CampaignFolder.opened(Path(sys.argv[1]), load_rendezvous(sys.argv[2], sys.argv[3:])): pass\n"
        "except OutputError as error: print(error)"
    )
    command = [sys.executable, "-c", code, str(tmp_path), str(SHIPPED), *_SHORT]
    with CampaignFolder.opened(tmp_path, _load()):
        found = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert found == f"{tmp_path}: another process is flying missions into this folder; wait for its end\n"
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == ""


@pytest.mark.ray
@pytest.mark.slow
def test_ray_flies_the_missions_of_one_process(tmp_path: Path) -> None:
    folder = tmp_path / "campaign"
    command = [sys.executable, "-m", "safe_inspect", "rendezvous", str(SHIPPED), *_SHORT, "address=local"]
    command += ["--missions", "3", "--workers", "2", "--output", str(folder)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert run.returncode == 1, run.stderr
    assert "0 of 3 missions succeeded" in run.stdout
    found = CampaignFolder(folder).summaries()
    assert _timeless([found[number] for number in range(3)]) == _timeless(fly_missions(_load(), 3))
    assert (folder / "mission_0002" / "log.npz").is_file()


def _summary(number: int, success: bool, axis: int, rate: float, **others: Any) -> dict[str, Any]:
    figures = ("time", "least_clearance", "mating_position_error", "mating_speed_error", "delta_v", "largest_force",
               "largest_gauge", "planning_time")  # fmt: skip
    given = {"mission": number, "success": success, "cause": "", "tumble_axis": axis, "tumble_rate": rate}
    return {**given, **dict.fromkeys(figures, 1.0), **others}


def test_the_table_has_the_classes_of_tumbles_and_each_failure_with_its_cause() -> None:
    failure = {"cause": "retreat from BOUND", "detail": "the tube leaves the keep-in box", "largest_gauge": None}
    summaries = [
        _summary(0, True, 1, 0.04), _summary(1, True, 3, 0.05), _summary(2, False, 3, 0.055, **failure),
    ]  # fmt: skip
    table = missions_table(summaries)
    assert table.startswith("2 of 3 missions succeeded: 66.7 % (95 % interval 9.4 to 99.2 %)")
    assert "tumble about axis 1                 1 of 1 100.0 % (95 % interval 2.5 to 100.0 %)" in table
    assert "tumble about axis 3                 1 of 2 50.0 % (95 % interval 1.3 to 98.7 %)" in table
    assert "1 failed: retreat from BOUND (missions 2)" in table
    assert (
        "mission 2 at 1.0 s: retreat from BOUND (the tube leaves the keep-in box) [about axis 3, at 3 to 4 deg/s]"
        in table
    )
    assert tumble_classes(_summary(0, True, 0, 0.04))[0] == "of constant rate"


def test_the_interval_is_that_of_clopper_and_pearson() -> None:
    assert interval(95, 100) == pytest.approx((0.88717, 0.98357), abs=1e-5)
    assert interval(10, 10) == pytest.approx((0.69150, 1.0), abs=1e-5)
    assert interval(0, 10)[0] == 0.0
