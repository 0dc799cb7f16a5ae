"""The commands of docs/rendezvous.md, as a reader types them; only watching and waiting are cut short."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from safe_inspect.cli.main import main

ROOT = Path(__file__).parents[2]
#: What a reader need not wait for here.
_SHORT = ("mission.observe=1 s", "mission.checkout=0.4 s", "mission.wait_limit=0 s")
_SHORT_MANY = ("mission.time_limit=2 s",)


def _commands() -> list[list[str]]:
    """Return the commands of the page's blocks, without `safe-inspect`."""
    text = (ROOT / "docs" / "rendezvous.md").read_text(encoding="utf-8")
    lines = "\n".join(re.findall(r"^```(?:bash)?\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL))
    joined = lines.replace("\\\n", " ").splitlines()
    return [shlex.split(line, comments=True)[1:] for line in joined if line.startswith("safe-inspect ")]


def test_the_page_has_commands_of_every_kind() -> None:
    assert {command[0] for command in _commands()} == {
        "rendezvous", "evaluate", "draw", "film", "view", "record-log", "characterise",
    }  # fmt: skip


@pytest.mark.slow
def test_the_commands_of_the_page_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    for command in _commands():
        words = list(command)
        if words[0] in ("record-log", "characterise"):
            continue  # run in perception/test_sensor_log
        if words[0] == "rendezvous":
            if any(re.search(r"orbit|/experiment(-unknown)?\.yml$", word) for word in words):
                words += ["--dry-run"]  # flown in test_orbit, estimation/test_estimated_mission and test_mapping
            else:
                words += _SHORT
        elif words[0] == "evaluate":
            words[words.index("--episodes") + 1] = "2"
            words += [*_SHORT, *_SHORT_MANY]
        elif words[0] == "film":
            words += ["--until", "0.5"]
        assert main(words) == 0, words
    written = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    assert {"rendezvous.png", "rendezvous.gif", "rendezvous.html", "campaign.png", "summary.json"} <= written
