from __future__ import annotations

import shutil
from pathlib import Path

import pytest


@pytest.fixture
def copied(long_form: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a copy of the written-out folder of one deputy, below a new working directory."""
    folder = tmp_path / "configs" / "translational-inspection"
    shutil.copytree(long_form / folder.name, folder)
    monkeypatch.chdir(tmp_path)
    return folder
