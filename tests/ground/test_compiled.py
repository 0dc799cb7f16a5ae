from __future__ import annotations

import copy
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from safe_inspect.compiled import Kernel, remove_stale_cache


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


def test_kernels_are_compiled_at_the_first_call_and_call_each_other() -> None:
    import numpy as np

    from safe_inspect.dynamics.propagation import propagate
    from safe_inspect.simulators.rows import copy_rows

    for kernel in (propagate, copy_rows):
        assert isinstance(kernel, Kernel)
        assert pickle.loads(pickle.dumps(kernel)) is copy.deepcopy(kernel) is kernel
    position, velocity, out = np.ones((1, 3)), np.zeros((1, 3)), np.empty((2, 1, 3))
    propagate(position, velocity, velocity, np.eye(6), np.zeros((6, 3)), *out)
    assert out[0].tolist() == [[1.0, 1.0, 1.0]]
    assert propagate.dispatcher.signatures


def test_a_kernel_is_compiled_where_no_cache_can_be_kept(tmp_path: Path) -> None:
    (tmp_path / "frozen.py").write_text(
        "from safe_inspect.compiled import njit\n@njit\ndef double(x): return 2.0 * x\n", encoding="utf-8"
    )
    code = (
        "import numba.core.caching as caching\n"
        "def refuse(self, py_func): raise RuntimeError('cannot cache function: no locator available')\n"
        "caching.CacheImpl.__init__ = refuse\n"
        "from frozen import double\nprint(double(2.0))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, cwd=tmp_path)
    assert done.stdout == "4.0\n", done.stderr
