from __future__ import annotations

from pathlib import Path

import pytest

from safe_inspect.compiled import remove_stale_cache


@pytest.fixture
def package(tmp_path: Path) -> Path:
    (tmp_path / "inner" / "__pycache__").mkdir(parents=True)
    (tmp_path / "kernel.py").write_text("@njit\ndef f(): ...\n")
    (tmp_path / "inner" / "plain.py").write_text("def g(): ...\n")
    (tmp_path / "inner" / "__pycache__" / "caller.nbi").write_text("machine code")
    return tmp_path


def test_old_machine_code_goes_when_a_kernel_changes(package: Path) -> None:
    cached = package / "inner" / "__pycache__" / "caller.nbi"
    assert remove_stale_cache(package)
    assert not cached.exists()
    cached.write_text("machine code")
    assert not remove_stale_cache(package)
    (package / "inner" / "plain.py").write_text("def g(): return 1\n")
    assert not remove_stale_cache(package)
    assert cached.exists()
    (package / "kernel.py").write_text("@njit\ndef f(): return 1\n")
    assert remove_stale_cache(package)
    assert not cached.exists()
