"""The examples of other learners run, each for a few steps."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

_FOLDER = Path(__file__).parents[2] / "examples" / "learners"


@pytest.mark.parametrize(
    ("script", "words", "shown"),
    [
        ("fly_policy.py", ("--episodes", "1"), "episode 0: win after "),
        pytest.param("sb3_ppo.py", ("--steps", "64"), "inspected on average: ", marks=pytest.mark.slow),
        pytest.param(
            "cleanrl_ppo.py", ("--steps", "64", "--num-envs", "8", "--rollout", "4"), "steps      64",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "torchrl_ppo.py", ("--steps", "64", "--num-envs", "8", "--rollout", "8"), "steps      64",
            marks=pytest.mark.slow,
        ),
        ("pettingzoo_team.py", ("--steps", "20"), "3 agents, "),
    ],
)  # fmt: skip
def test_an_example_runs(script, words, shown):
    if script.startswith("torchrl"):
        pytest.importorskip("torchrl", reason="pip install 'safe_inspect[torchrl]'")
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, str(_FOLDER / script), *words], capture_output=True, text=True, timeout=300, env=environment
    )
    assert done.returncode == 0, done.stderr
    assert shown in done.stdout


def test_every_example_is_run():
    assert {path.name for path in _FOLDER.glob("*.py")} == {
        "fly_policy.py", "sb3_ppo.py", "cleanrl_ppo.py", "torchrl_ppo.py", "pettingzoo_team.py"
    }  # fmt: skip


def test_the_loop_of_the_page_flies_an_episode(capsys):
    page = (_FOLDER.parents[1] / "docs" / "learners.md").read_text()
    exec(page.split("```python\n")[1].split("```")[0], {})
    assert capsys.readouterr().out.split()[0] in ("win", "draw", "lose")
