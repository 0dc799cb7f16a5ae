"""Kernels that kernels call are linked into those that Python calls, and machine code is kept where it can be."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from safe_inspect.compiling import folders

#: `inner` is called by both others: a function must not be linked before all that call it are.
MODULE = """
from safe_inspect.compiling import njit

@njit
def inner(x):
    return 2.0 * x

@njit
def middle(x):
    if x < 0.0:
        raise ValueError("negative")
    return inner(x) + 1.0

@njit
def outer(x):
    return inner(x) + middle(x)

@njit
def other(x):
    return middle(x) - inner(x)
"""
RUN = """
import sys
from safe_inspect.compiling import linking
from frozen import inner, middle, outer, other
print(outer(3.0), *([other(3.0), inner(3.0)] if "all" in sys.argv else []))
try:
    outer(-1.0)
except ValueError as error:
    print(error)
print(sum(outer.dispatcher.stats.cache_hits.values()), sum(middle.part.stats.cache_hits.values()), middle._dispatcher)
for result in middle.part.overloads.values():
    assert isinstance(result.library, linking.PartLibrary), result.library
    assert result.library.complete
    assert result.library.get_pointer_to_function(result.fndesc.llvm_func_name) == 0
"""


def run(folder: Path, *arguments: str) -> list[str]:
    environment = os.environ | {"XDG_CACHE_HOME": str(folder / "cache"), "LOCALAPPDATA": str(folder / "cache")}
    environment.pop("NUMBA_CACHE_DIR", None)
    done = subprocess.run(
        [sys.executable, "-c", RUN, *arguments],
        capture_output=True,
        text=True,
        cwd=folder,
        env=environment,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.skipif(sys.platform == "darwin", reason="the user's folder follows no variable there")
def test_machine_code_of_a_folder_that_cannot_be_written_is_kept_in_the_users(tmp_path: Path) -> None:
    (tmp_path / "frozen.py").write_text(MODULE, encoding="utf-8")
    (tmp_path / "__pycache__").write_text("no folder can be made here", encoding="utf-8")
    assert run(tmp_path) == ["13.0", "negative", "0 0 None"]
    kept = sorted(path.name for path in (tmp_path / "cache" / "safe_inspect" / folders.digest_of()[:16]).rglob("*.nbi"))
    assert [name.partition("-")[0] for name in kept] == ["frozen.inner", "frozen.middle", "frozen.outer"]
    # `outer` comes from the folder; `other` is compiled, with `middle` and `inner` from there
    assert run(tmp_path, "all") == ["13.0 1.0 6.0", "negative", "1 1 None"]


def test_a_kernel_of_another_file_may_change_what_it_returns(tmp_path: Path) -> None:
    (tmp_path / "caller.py").write_text(
        "from called import share\nfrom safe_inspect.compiling import njit\n@njit\ndef double(x): return 2 * share(x)\n"
    )
    code = (
        "from safe_inspect.compiling import njit\nfrom caller import double\n"
        "@njit\ndef {0}(x): return double(x)\nprint({0}(7))"
    )
    for name, returned, printed in (("first", "x // 2", "6"), ("second", "x / 2", "7.0")):
        (tmp_path / "called.py").write_text(
            f"from safe_inspect.compiling import njit\n@njit\ndef share(x): return {returned}\n"
        )
        (tmp_path / f"{name}.py").write_text(code.format(name))
        done = subprocess.run([sys.executable, f"{name}.py"], capture_output=True, text=True, cwd=tmp_path, timeout=120)
        assert done.stdout.strip() == printed, done.stderr


def test_machine_code_of_a_users_kernel_belongs_to_the_sources_of_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A kernel of the package is linked into it, so after an update of the package it is compiled again."""
    source = "from safe_inspect.compiling import njit\n@njit\ndef double(x): return 2.0 * x\n"
    (tmp_path / "mine.py").write_text(source, encoding="utf-8")

    def loaded() -> int:
        spec = spec_from_file_location("mine", tmp_path / "mine.py")
        assert spec is not None
        assert spec.loader is not None
        spec.loader.exec_module(module := module_from_spec(spec))
        assert module.double(2.0) == 4.0
        return sum(module.double.dispatcher.stats.cache_hits.values())

    assert [loaded(), loaded()] == [0, 1]
    monkeypatch.setattr("safe_inspect.compiling.dispatchers.digest_of", lambda: "an update")
    assert [loaded(), loaded()] == [0, 1]


def test_the_users_folder_follows_the_platform(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for variable in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.setenv(variable, str(tmp_path / variable))
    monkeypatch.setenv("HOME", str(tmp_path))
    found = {}
    for platform in ("linux", "darwin", "win32"):
        monkeypatch.setattr(folders.sys, "platform", platform)
        found[platform] = folders.user_folder("0123456789abcdefg")
    assert found == {
        "linux": tmp_path / "XDG_CACHE_HOME" / "safe_inspect" / "0123456789abcdef",
        "darwin": tmp_path / "Library" / "Caches" / "safe_inspect" / "0123456789abcdef",
        "win32": tmp_path / "LOCALAPPDATA" / "safe_inspect" / "0123456789abcdef",
    }
