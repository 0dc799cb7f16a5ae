"""Every block of the tutorials runs, with fewer steps and episodes than a reader asks for."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from .blocks import blocks_of, run_page

_FOLDER = Path(__file__).parents[2] / "docs" / "tutorials"
_REPLACE = {
    "first-training": {
        "num_env_steps_sampled_lifetime=650000": "num_env_steps_sampled_lifetime=4000",
        "--episodes 20": "--episodes 2",
    },
    "own-reward": {},
    "team": {"num_envs=256": "num_envs=4", "range(50)": "range(5)", "--episodes 4": "--episodes 1"},
    "safety": {"--steps 20000": "--steps 2000 --num-envs 64", "--episodes 20": "--episodes 4"},
    "evaluation": {"--episodes 20": "--episodes 4"},
    "stable-baselines3": {
        "num_envs=64": "num_envs=4",
        "n_steps=64, batch_size=512": "n_steps=16, batch_size=64",
        "100_000": "64",
        "learning_starts=100": "learning_starts=10",
        "1_000": "20",
        "--episodes 20": "--episodes 2",
    },
}


def _words(words: list[str]) -> list[str]:
    """Put the run's folder in the place of `output/RUN`."""
    return [str(next(Path("output").iterdir())) if word == "output/RUN" else word for word in words]


@pytest.fixture
def run(monkeypatch, tmp_path, capsys, clean_registry) -> Iterator[Callable[[str], None]]:
    """Return a function that runs a tutorial in a new folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    before = set(sys.modules)
    yield lambda name: run_page(_FOLDER / f"{name}.md", _REPLACE[name], lambda: "".join(capsys.readouterr()), _words)
    for module in set(sys.modules) - before:
        if module.startswith("my_"):
            del sys.modules[module]


def test_every_tutorial_is_run_here() -> None:
    assert {page.stem for page in _FOLDER.glob("*.md")} - {"index"} == set(_REPLACE)


@pytest.mark.parametrize("name", sorted(set(_REPLACE) - {"first-training", "stable-baselines3"}))
def test_a_tutorial_runs(name, run) -> None:
    run(name)


@pytest.mark.slow
def test_the_tutorial_of_stable_baselines3_runs(run) -> None:
    pytest.importorskip("stable_baselines3", reason="pip install 'safe_inspect[sb3]'")
    run("stable-baselines3")


@pytest.mark.slow
@pytest.mark.ray
def test_the_tutorial_of_the_first_training_trains(run) -> None:
    run("first-training")
    (folder,) = Path("output").iterdir()
    assert len((folder / "progress.csv").read_text().splitlines()) == 2


def test_the_blocks_of_a_page_are_found(tmp_path) -> None:
    page = tmp_path / "page.md"
    page.write_text('a\n\n```python title="a.py"\nx = 1\n```\n\n```bash\nsafe-inspect list a \\\n  b  # c\nls\n```\n')
    first, second = blocks_of(page)
    assert (first.language, first.title, first.text) == ("python", "a.py", "x = 1\n")
    assert second.commands() == [["safe-inspect", "list", "a", "b"]]
