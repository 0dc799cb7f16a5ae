"""Functions of generated source: one for the same source and kernels, in a file that its machine code belongs to."""

from __future__ import annotations

import pickle
import stat
import sys
from pathlib import Path

import pytest

from safe_inspect.compiling import kernel, njit
from safe_inspect.compiling.kernel import generate

SOURCE = "def doubled(x):\n    return 2.0 * inner(x)\n"


@njit
def one(x: float) -> float:
    """Return x + 1."""
    return x + 1.0


@njit
def two(x: float) -> float:
    """Return x + 2."""
    return x + 2.0


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Let generated files go into a folder of the test's own."""
    monkeypatch.setattr(kernel, "installed_folder", lambda digest: tmp_path / "installed")
    monkeypatch.setattr(kernel, "machine_code_folder", lambda digest, given="": tmp_path / "chosen")
    monkeypatch.setattr(kernel.tempfile, "gettempdir", lambda: str(tmp_path / "temporary"))
    monkeypatch.setattr(kernel, "_functions", {})
    return tmp_path


def test_the_same_source_and_kernels_give_the_same_function() -> None:
    made = generate("doubled", SOURCE, {"inner": one})
    assert generate("doubled", SOURCE, {"inner": one}) is made
    others = [
        generate("doubled", SOURCE, {"inner": two}),
        generate("doubled", SOURCE, {"inner": one}, {"nogil": True}),
        generate("doubled", SOURCE, {"inner": one}, {"nogil": False}),
        generate("doubled", SOURCE + "\n", {"inner": one}),
        generate("doubled", SOURCE, {"inner": one, "other": two}),
    ]
    assert len({id(function) for function in (made, *others)}) == 6
    assert made(3.0) == 8.0
    assert others[0](3.0) == 10.0
    assert made.__wrapped__.__globals__["inner"] is one
    assert pickle.loads(pickle.dumps(made)) is made
    assert made.origin == ("doubled", SOURCE, {"inner": one}, {})


def test_closures_over_different_values_give_different_functions() -> None:
    def adding(size: float) -> kernel.Kernel[[float], float]:
        @njit
        def added(x: float) -> float:
            return x + size

        return added

    made = [generate("doubled", SOURCE, {"inner": adding(size)}) for size in (1.0, 1.0, 2.0)]
    assert made[0] is made[1]
    assert [function(3.0) for function in made] == [8.0, 8.0, 10.0]


def test_the_file_holds_the_source_where_it_can_be_written(folder: Path) -> None:
    made = generate("doubled", SOURCE, {"inner": one})
    (path,) = (folder / "installed" / "generated").glob("*.py")
    assert path.read_text() == SOURCE
    assert path.name.startswith("doubled_")
    assert len(path.stem) == len("doubled_") + 24
    assert made.__wrapped__.__code__.co_filename == str(path)
    assert sys.modules[f"safe_inspect.compiling.kernel.{path.stem}"].doubled is made.__wrapped__
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    before = path.stat().st_mtime_ns
    kernel._functions.clear()
    generate("doubled", SOURCE, {"inner": one})
    assert path.stat().st_mtime_ns == before  # it is not written again


@pytest.mark.parametrize("blocked", [("installed",), ("installed", "chosen")])
def test_another_folder_is_taken_where_one_cannot_be_written(folder: Path, blocked: tuple[str, ...]) -> None:
    for name in blocked:
        (folder / name).write_text("")
    generate("doubled", SOURCE, {"inner": one})
    (path,) = folder.glob("*/**/doubled_*.py")
    assert path.relative_to(folder).parts[0] == ("chosen" if len(blocked) == 1 else "temporary")


def test_where_no_folder_can_be_written_the_folders_are_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel, "machine_code_folder", lambda digest, given="": None)
    for name in ("installed", "temporary"):
        (folder / name).write_text("")
    with pytest.raises(OSError, match="can be written") as caught:
        generate("doubled", SOURCE, {"inner": one})
    assert str(caught.value) == (
        f"neither {folder / 'installed'} nor {folder / 'temporary'} can be written; compiled code needs one of them"
    )
