"""How a long evaluation reports: a bar that fits the terminal, lines in a log file, the compiler's time left out."""

from __future__ import annotations

import io
import os

import pytest

from safe_inspect.cli import episode_bar
from safe_inspect.cli.episode_bar import EpisodeBar
from safe_inspect.cli.main import main


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def clock(monkeypatch):
    """Return a list: seconds since the start, seconds of compiling, columns."""
    now = [0.0, 0.0, 80]
    monkeypatch.setattr(episode_bar.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(episode_bar, "compiling_seconds", lambda: now[1])
    monkeypatch.setattr(episode_bar.shutil, "get_terminal_size", lambda *_, **__: os.terminal_size((now[2], 24)))
    return now


def test_a_log_file_gets_a_line_every_ten_seconds(clock):
    stream = io.StringIO()
    with EpisodeBar("inspector", stream) as bar:
        for second in range(0, 35, 5):
            clock[0] = float(second)
            bar.show(second, 200)
    assert stream.getvalue().splitlines() == [
        "inspector: 0 of 200, left -",
        "inspector: 10 of 200, left 0:03:10",
        "inspector: 20 of 200, left 0:03:00",
        "inspector: 30 of 200, left 0:02:50",
    ]


def test_compiling_is_not_counted_in_what_is_left(clock):
    stream = Terminal()
    bar = EpisodeBar("inspector", stream)
    clock[:2] = [70.0, 60.0]
    bar.show(50, 100)
    assert "50 %  left 0:00:10" in stream.getvalue()


@pytest.mark.parametrize("columns", [40, 60, 120])
def test_the_bar_fits_the_terminal(clock, columns):
    clock[0], clock[2] = 5.0, columns
    stream = Terminal()
    EpisodeBar("inspector", stream).show(50, 100)
    assert len(stream.getvalue().strip("\r").removesuffix("\x1b[K")) < columns


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        (
            ("safety", "configs/docking/experiment.yml", "--steps", "128", "--num-envs", "64"),
            "steps: 128 of 128, left ",
        ),
        (
            ("film", "random", "--cfg", "configs/docking/experiment.yml", "--frames", "3", "--width", "320"),
            "pictures: 3 of 3, left ",
        ),
    ],
)
def test_long_commands_report_in_a_log_file(words, shown, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(episode_bar, "_SILENCE", 0.0)
    monkeypatch.chdir(tmp_path)
    assert main([*words, *(("--output", "a.gif") if words[0] == "film" else ())]) == 0
    assert shown in capsys.readouterr().err
