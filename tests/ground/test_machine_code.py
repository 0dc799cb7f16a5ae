"""Where machine code is kept, and that none is used that does not belong to the sources."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from safe_inspect.compiling import folders

DIGEST = "0123456789abcdef" * 4
NAME = DIGEST[:16]
KERNEL = "from safe_inspect.compiling import njit\n@njit\ndef double(x): return 2.0 * x\n"


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A separate package, and a user's folder."""
    monkeypatch.setattr(folders, "PACKAGE", tmp_path / "package")
    monkeypatch.setattr(folders, "user_folder", lambda: tmp_path / "user")
    (tmp_path / "package").mkdir()
    folders.machine_code_folder.cache_clear()
    yield tmp_path
    folders.machine_code_folder.cache_clear()


def run(code: str, folder: Path, **environment: str) -> str:
    """Run code in a folder with an empty folder of the user's, and return what it prints."""
    variables = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        cwd=folder,
        env=variables | environment,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_machine_code_is_kept_in_the_package(home: Path) -> None:
    kept = home / "package" / "__pycache__" / "machine_code" / NAME
    assert folders.machine_code_folder(DIGEST) == kept
    assert kept.is_dir()


def test_a_package_that_cannot_be_written_keeps_machine_code_with_the_user(home: Path) -> None:
    (home / "package" / "__pycache__").write_text("no folder can be made here", encoding="utf-8")
    assert folders.machine_code_folder(DIGEST) == home / "user" / NAME


def test_machine_code_of_an_image_is_copied_for_a_user_who_cannot_write_there(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed = folders.installed_folder(DIGEST)
    (installed / "room").mkdir(parents=True)
    (installed / "room" / "kernel.nbi").write_text("machine code", encoding="utf-8")
    can_be_written = folders._can_be_written
    monkeypatch.setattr(folders, "_can_be_written", lambda folder: folder != installed and can_be_written(folder))
    mine = folders.machine_code_folder(DIGEST)
    assert mine == home / "user" / NAME
    assert (mine / "room" / "kernel.nbi").read_text(encoding="utf-8") == "machine code"


def test_where_no_folder_can_be_written_nothing_is_kept(home: Path) -> None:
    (home / "package" / "__pycache__").write_text("", encoding="utf-8")
    (home / "user").write_text("", encoding="utf-8")
    assert folders.machine_code_folder(DIGEST) is None
    assert folders.machine_code_folder(DIGEST, str(home / "user")) is None


def test_the_folder_that_the_user_names_is_taken(home: Path) -> None:
    assert folders.machine_code_folder(DIGEST, str(home / "named")) == home / "named" / "safe_inspect" / NAME


def test_machine_code_of_the_last_states_of_the_sources_is_kept(home: Path) -> None:
    parent = folders.installed_folder(DIGEST).parent
    for age, name in enumerate(("a" * 16, "b" * 16, "c" * 16, "d" * 16, "notes")):
        (parent / name).mkdir(parents=True)
        os.utime(parent / name, (0, 1000 - age))
    folders.machine_code_folder(DIGEST)
    assert {path.name for path in parent.iterdir()} == {"a" * 16, "b" * 16, NAME, "notes"}


def test_the_digest_is_that_of_all_files_with_kernels_and_what_they_import(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "__pycache__").mkdir()
    digests = []
    for name, text in (
        ("kernel.py", "@njit\ndef f(): ...\n"),
        ("inner/plain.py", "def g(): ...\n"),
        ("__pycache__/generated.py", "@njit\ndef g(): ...\n"),
        ("inner/other.py", "@njit\ndef h(): ...\n"),
        ("inner/other.py", "@njit\ndef h(): return 1\n"),
        ("kernel.py", f"from {tmp_path.name}.inner import (\n    other,\n    plain,\n)\n@njit\ndef f(): ...\n"),
        ("inner/plain.py", "def g(): return 1\n"),
    ):
        (tmp_path / name).write_text(text, encoding="utf-8")
        digests.append(folders.digest_of.__wrapped__(tmp_path))
    assert digests[0] == digests[1] == digests[2]
    assert len(set(digests)) == 5


def test_a_kernel_is_compiled_where_no_machine_code_can_be_kept(tmp_path: Path) -> None:
    (tmp_path / "frozen.py").write_text(KERNEL, encoding="utf-8")
    code = (
        "from safe_inspect.compiling import folders\n"
        "folders._can_be_written = lambda folder: False\n"
        "from frozen import double\nprint(double(2.0), double.dispatcher.stats.cache_path)"
    )
    assert run(code, tmp_path) == "4.0 None"


def test_a_kernel_is_compiled_that_has_no_file(tmp_path: Path) -> None:
    assert run(KERNEL + "print(double(2.0))", tmp_path) == "4.0"


def test_a_kernel_comes_from_the_folder(tmp_path: Path) -> None:
    (tmp_path / "frozen.py").write_text(KERNEL, encoding="utf-8")
    code = "from frozen import double\nprint(double(2.0), sum(double.dispatcher.stats.cache_hits.values()))"
    named = {"NUMBA_CACHE_DIR": str(tmp_path / "named")}
    assert run(code, tmp_path, **named) == "4.0 0"
    assert run(code, tmp_path, **named) == "4.0 1"
    shutil.rmtree(tmp_path / "named")
    assert run(code, tmp_path, **named) == "4.0 0"


CALLERS = """
import called
from called import share
from safe_inspect.compiling import njit

@njit
def by_name(x): return 2 * share(x)

@njit
def by_module(x): return 2 * called.share(x)

def made(inner):
    @njit
    def by_closure(x): return 2 * inner(x)
    return by_closure

by_closure = made(share)
"""


def test_a_kernel_is_compiled_again_when_one_that_it_calls_has_changed(tmp_path: Path) -> None:
    (tmp_path / "caller.py").write_text(CALLERS, encoding="utf-8")
    code = (
        "from caller import by_name, by_module, by_closure\nfor each in (by_name, by_module, by_closure):\n"
        "    print(each(7), sum(each.dispatcher.stats.cache_hits.values()))"
    )
    named = {"NUMBA_CACHE_DIR": str(tmp_path / "named"), "PYTHONDONTWRITEBYTECODE": "1"}
    for returned, printed in (("x // 2", "6 0"), ("x // 2", "6 1"), ("x / 2", "7.0 0")):
        source = f"from safe_inspect.compiling import njit\n@njit\ndef share(x): return {returned}\n"
        (tmp_path / "called.py").write_text(source, encoding="utf-8")
        assert run(code, tmp_path, **named).splitlines() == [printed] * 3


VALUES = """
from enum import IntEnum
import numba
import constants
from constants import SIZE, TABLE, Mode
from safe_inspect.compiling import njit

@numba.njit
def plain(x): return x + constants.SIZE

@njit
def imported(x): return x * SIZE

@njit
def of_module(x): return x * constants.inner.SIZE

@njit
def of_enum(x): return x + Mode.ON.value

@njit
def of_array(x): return x + TABLE[0][2]

@njit
def by_plain(x): return plain(x)

def closure(size):
    @njit
    def of_closure(x): return x + size
    return of_closure

KERNELS = (imported, of_module, of_enum, of_array, by_plain, closure(SIZE))
"""


def test_a_kernel_is_compiled_again_when_a_value_that_it_names_has_changed(tmp_path: Path) -> None:
    (tmp_path / "values.py").write_text(VALUES, encoding="utf-8")
    code = "from values import KERNELS\nfor f in KERNELS: print(f(1), sum(f.dispatcher.stats.cache_hits.values()))"
    named = {"NUMBA_CACHE_DIR": str(tmp_path / "named"), "PYTHONDONTWRITEBYTECODE": "1"}
    for size, hits in ((1, 0), (1, 1), (4, 0)):
        source = "from enum import IntEnum\nimport types\nimport numpy as np\nclass Mode(IntEnum): ON = {0}\n"
        source += "inner = types.ModuleType('inner'); inner.SIZE = {0}\nSIZE = {0}\nTABLE = (np.array([0, 0, {0}]),)\n"
        (tmp_path / "constants.py").write_text(source.format(size), encoding="utf-8")
        expected = [size, size, 1 + size, 1 + size, 1 + size, 1 + size]
        assert run(code, tmp_path, **named).splitlines() == [f"{value} {hits}" for value in expected]


def test_machine_code_of_a_users_kernel_belongs_to_the_sources_of_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A kernel of the package is linked into it, so after an update of the package it is compiled again."""
    (tmp_path / "mine.py").write_text(KERNEL, encoding="utf-8")

    def loaded() -> int:
        spec = spec_from_file_location("mine", tmp_path / "mine.py")
        assert spec is not None
        assert spec.loader is not None
        spec.loader.exec_module(module := module_from_spec(spec))
        assert module.double(2.0) == 4.0
        return sum(module.double.dispatcher.stats.cache_hits.values())

    assert [loaded(), loaded()] == [0, 1]
    kept = tmp_path / "an update"
    monkeypatch.setattr("safe_inspect.compiling.kernel.machine_code_folder", lambda digest, given: kept / digest)
    assert [loaded(), loaded()] == [0, 1]
    monkeypatch.setattr("safe_inspect.compiling.kernel.digest_of", lambda: "another")
    assert [loaded(), loaded()] == [0, 1]


def test_an_exception_in_a_kernel_that_a_kernel_calls_reaches_python(tmp_path: Path) -> None:
    (tmp_path / "frozen.py").write_text(
        "from safe_inspect.compiling import njit\n"
        "@njit\ndef inner(x):\n    if x < 0.0:\n        raise ValueError('negative')\n    return 2.0 * x\n"
        "@njit\ndef outer(x): return inner(x) + 1.0\n",
        encoding="utf-8",
    )
    code = (
        "from frozen import inner, outer\nprint(outer(3.0), inner(3.0))\ntry:\n    outer(-1.0)\n"
        "except ValueError as error:\n    print(error)"
    )
    for _ in range(2):  # compiled, and from the folder
        assert run(code, tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "named")) == "7.0 6.0\nnegative"


def test_the_users_folder_follows_the_platform(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for variable in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.setenv(variable, str(tmp_path / variable))
    monkeypatch.setenv("HOME", str(tmp_path))
    found = {}
    for platform in ("linux", "darwin", "win32"):
        monkeypatch.setattr(folders.sys, "platform", platform)
        found[platform] = folders.user_folder()
    assert found == {
        "linux": tmp_path / "XDG_CACHE_HOME" / "safe_inspect",
        "darwin": tmp_path / "Library" / "Caches" / "safe_inspect",
        "win32": tmp_path / "LOCALAPPDATA" / "safe_inspect",
    }
