from __future__ import annotations

import shutil
from pathlib import Path

import pytest


@pytest.fixture
def copied(shipped: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a copy of the shipped folder, below a working directory of its own."""
    folder = tmp_path / "configs" / "translational-inspection"
    shutil.copytree(shipped.parent, folder)
    monkeypatch.chdir(tmp_path)
    return folder
