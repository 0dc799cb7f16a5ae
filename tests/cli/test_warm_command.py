"""`safe-inspect warm` compiles ahead, so that the next process finds the machine code."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from safe_inspect.cli.main import main
from safe_inspect.compiling import folders

#: Kernels of the docking task in a batch of one, in a fresh process.
AGAIN = """
import gymnasium, safe_inspect
from safe_inspect.compiling import compiling_seconds
environment = gymnasium.make("safe_inspect/Docking-v0")
environment.reset(seed=1)
environment.step(environment.action_space.sample())
print(compiling_seconds())
"""


@pytest.mark.slow
def test_what_is_compiled_ahead_is_not_compiled_again(tmp_path: Path) -> None:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}

    def run(*words: str) -> str:
        done = subprocess.run(
            [sys.executable, *words], capture_output=True, text=True, env=environment, timeout=600, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    first, last = run("-m", "safe_inspect", "warm", "safe_inspect/Docking-v0").splitlines()
    assert first.startswith("[1/1] safe_inspect/Docking-v0 ")
    assert first.endswith(" s of it compiling")
    assert last == f"the machine code is in {tmp_path / 'safe_inspect' / folders.digest_of()[:16]}"
    assert float(run("-c", AGAIN)) == 0.0


def test_a_mistake_is_reported_before_anything_is_compiled(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["warm", "safe_inspect/Docking-v0", "safe_inspect/Dokcing-v0"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "did you mean `safe_inspect/Docking-v0`?" in captured.err


def test_without_a_folder_for_machine_code_nothing_is_compiled_ahead(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("safe_inspect.cli.commands.warm.kept_in", lambda: None)
    assert main(["warm", "safe_inspect/Docking-v0"]) == 2
    assert "set another with NUMBA_CACHE_DIR" in capsys.readouterr().err
