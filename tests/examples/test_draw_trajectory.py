from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "examples" / "draw_trajectory.py"


@pytest.mark.slow
def test_the_picture_of_the_readme_can_be_drawn_again(tmp_path):
    task = ["--cfg", "safe_inspect/MultiagentTranslationalInspectionSeed-v0", "--seed", "4", "--until", "2500"]
    command = [sys.executable, str(SCRIPT), *task, "--out", str(tmp_path / "a.png")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "success 100.0 %" in done.stdout
    assert 20_000 < (tmp_path / "a.png").stat().st_size < 400_000


def test_a_picture_that_cannot_be_written_is_one_message(tmp_path):
    (tmp_path / "file").write_text("")
    command = [sys.executable, str(SCRIPT), "--out", str(tmp_path / "file" / "a.png")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "a.png: the file cannot be written (Not a directory)" in done.stderr
    assert "Traceback" not in done.stderr
