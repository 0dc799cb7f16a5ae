"""The notebooks are what `scripts/notebooks.py` writes from the tutorials, and every cell of them runs."""

from __future__ import annotations

import os
import runpy
import sys
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat", reason="pip install 'safe_inspect[dev]'")
nbclient = pytest.importorskip("nbclient", reason="pip install 'safe_inspect[dev]'")
_SCRIPT = runpy.run_path(str(Path(__file__).parents[2] / "scripts" / "notebooks.py"))
_FOLDER: Path = _SCRIPT["FOLDER"]
#: Values that would take minutes to run.
_REPLACE = {
    "num_env_steps_sampled_lifetime=650000": "num_env_steps_sampled_lifetime=4000",
    "--episodes 20": "--episodes 2",
    "--steps 20000": "--steps 2000 --num-envs 64",
}


@pytest.mark.parametrize("name", _SCRIPT["TUTORIALS"])
def test_a_notebook_is_that_of_its_page(name) -> None:
    text = (_FOLDER / f"{name}.ipynb").read_text(encoding="utf-8")
    assert text == _SCRIPT["notebook"](name), "python scripts/notebooks.py"


#: test_tutorials runs the blocks of this page, in one process, in a fifth of the time.
_NAMES = [
    pytest.param(name, marks=[pytest.mark.long] if name == "first-training" else []) for name in _SCRIPT["TUTORIALS"]
]


@pytest.mark.slow
@pytest.mark.ray
@pytest.mark.parametrize("name", _NAMES)
def test_every_cell_of_a_notebook_runs(name, monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    text = (_FOLDER / f"{name}.ipynb").read_text(encoding="utf-8")
    for long, short in _REPLACE.items():
        text = text.replace(long, short)
    notebook = nbformat.reads(text, as_version=4)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert all(cell.execution_count for cell in notebook.cells if cell.cell_type == "code")
