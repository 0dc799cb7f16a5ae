"""What is said of outputs that cannot be written, whole; the marks, locks and rights of those that are."""

from __future__ import annotations

import errno
import json
import os
import stat
from pathlib import Path
from typing import Any

import pytest

from safe_inspect import outputs
from safe_inspect.errors import OutputError
from safe_inspect.outputs import (
    LOCK,
    MARKER,
    cannot_write,
    check_ending,
    check_new_folder,
    check_parent,
    check_writable,
    exclusive,
    is_full,
    mark_folder,
    new_file,
    new_folder,
    read_marker,
    remove_written,
)


@pytest.mark.parametrize(
    ("error", "more", "shown"),
    [
        (OSError(errno.EACCES, "Denied"), (), "p: the file cannot be written (Denied); give another file"),
        (OSError(errno.EACCES, "Denied"), ("do x", "folder"), "p: the folder cannot be written (Denied); do x"),
        (OSError("no number"), (), "p: the file cannot be written (no number); give another file"),
        (OSError(errno.EFBIG, "?"), ("do x",), f"p: the file cannot be written ({os.strerror(errno.EFBIG)}); "
         "free some space, or do x"),
    ],
)  # fmt: skip
def test_why_an_output_cannot_be_written(error: OSError, more: tuple[str, ...], shown: str) -> None:
    assert str(cannot_write(Path("p"), error, *more)) == shown


def _written(folder: Path, command: str = "record") -> Path:
    with new_folder(folder, command) as work:
        (work / "a").write_text("a")
        (work / "deep").mkdir()
        (work / "deep" / "b").write_text("b")
    return folder


def _foreign(path: Path) -> None:
    (_written(path) / "deep" / "mine").write_text("")


def _empty_folder(path: Path) -> None:
    (_written(path) / "empty").mkdir()


def _link_inside(path: Path) -> None:
    (_written(path) / "link").symlink_to(path.parent)


def _damaged_marker(path: Path) -> None:
    (_written(path) / MARKER).write_text("{")


@pytest.mark.parametrize(
    ("make", "force", "shown"),
    [
        (lambda path: path.write_text(""), True, "this is a file or a symbolic link, so no folder can be written "
         "there; give another folder"),
        (lambda path: path.symlink_to("nowhere"), True, "this is a file or a symbolic link, so no folder can be "
         "written there; give another folder"),
        (_written, False, "the folder exists already; give another folder, or replace what this command wrote: "
         "--force"),
        (lambda path: _written(path, "other"), True, "this folder is not marked as written by `record`, so it is not "
         "replaced; give another folder"),
        (_damaged_marker, True, "this folder is not marked as written by `record`, so it is not replaced; "
         "give another folder"),
        (_foreign, True, "it contains 'deep/mine' of another origin, so it is not replaced; give another folder"),
        (_empty_folder, True, "it contains 'empty' of another origin, so it is not replaced; give another folder"),
        (_link_inside, True, "it contains 'link' of another origin, so it is not replaced; give another folder"),
        (_written, True, ""),
        (lambda path: None, False, ""),
    ],
)  # fmt: skip
def test_a_folder_is_replaced_by_what_wrote_it_alone(tmp_path: Path, make: Any, force: bool, shown: str) -> None:
    path = tmp_path / "f"
    make(path)
    if not shown:
        check_new_folder(path, "record", force=force)
        return
    with pytest.raises(OutputError) as caught:
        check_new_folder(path, "record", force=force)
    assert str(caught.value) == f"{path}: {shown}"


def test_the_folder_of_the_process_is_not_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = _written(tmp_path / "f")
    for place in (path, path / "deep"):
        monkeypatch.chdir(place)
        with pytest.raises(OutputError, match="the working directory is in this folder, so it is not replaced"):
            check_new_folder(path, "record", force=True)
    monkeypatch.chdir(tmp_path)
    check_new_folder(path, "record", force=True)


def test_a_folder_says_what_wrote_it_and_has_the_rights_of_any_other(tmp_path: Path) -> None:
    mask = os.umask(0o027)
    try:
        path = _written(tmp_path / "some" / "f")
    finally:
        assert os.umask(mask) == 0o027  # asking for the mask leaves it
    assert stat.S_IMODE(path.stat().st_mode) == 0o750
    assert json.loads((path / MARKER).read_text()) == {"command": "record", "files": ["a", "deep/b"]}
    assert read_marker(path) == {"command": "record", "files": {"a", "deep/b"}}
    assert [item.name for item in path.parent.iterdir()] == ["f"]
    mark_folder(path, "other", ["z", "y"], seed=Path("s"))
    assert (path / MARKER).read_text() == '{"command": "other", "files": ["y", "z"], "seed": "s"}\n'
    assert read_marker(path)["seed"] == "s"
    for content in ("[]", "3", '{"command": 1}', "{}", "\xff"):
        (path / MARKER).write_text(content, "latin-1")
        assert read_marker(path) == {"command": "", "files": set()}


def test_what_was_written_is_removed_but_for_what_is_left(tmp_path: Path) -> None:
    path = _written(tmp_path / "f")
    (path / LOCK).write_text("")
    (path / "deep" / "mine").write_text("")
    remove_written(path, ["a"])
    assert sorted(str(item.relative_to(path)) for item in path.rglob("*")) == ["a", "deep", "deep/mine"]
    other = _written(tmp_path / "g")
    remove_written(other)
    assert not other.exists()


@pytest.mark.parametrize("exists", [True, False])
def test_a_file_that_is_read_only_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exists: bool) -> None:
    path = tmp_path / "a.json"
    if exists:
        path.write_text("old")
    monkeypatch.setattr(os, "access", lambda target, mode: False)
    if not exists:
        check_writable(path)
        assert not list(tmp_path.iterdir())
        return
    shown = f"{path}: the file cannot be written (Permission denied); give another file"
    with pytest.raises(OutputError) as caught:
        check_writable(path)
    assert str(caught.value) == shown
    with pytest.raises(OutputError) as caught, new_file(path):
        pass
    assert str(caught.value) == shown
    assert [item.name for item in tmp_path.iterdir()] == ["a.json"]
    assert path.read_text() == "old"


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("a.txt", "the name of the figure must end in .png, .svg; give such a name with --plot"),
        ("a", "the name of the figure must end in .png, .svg; give such a name with --plot"),
        ("a.PNG", ""),
        ("new/a.svg", ""),
        ("f.png", "the file cannot be written (it is a folder); give a file"),
        ("file/a.png", "the file cannot be written (Not a directory); give another file"),
    ],
)
def test_the_ending_of_a_file_says_its_format(tmp_path: Path, name: str, shown: str) -> None:
    (tmp_path / "f.png").mkdir()
    (tmp_path / "file").write_text("")
    path = tmp_path / name
    if not shown:
        check_ending(path, (".png", ".svg"), "figure", "--plot")
        assert not path.parent.exists() or path.parent == tmp_path
        return
    with pytest.raises(OutputError) as caught:
        check_ending(path, (".png", ".svg"), "figure", "--plot")
    assert str(caught.value) == f"{path}: {shown}"


def test_a_file_of_another_ending_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    check_writable(path, [".md", ".json"])  # it may be made
    path.write_text("")
    check_writable(path)
    check_writable(path, [".txt"])
    with pytest.raises(OutputError) as caught:
        check_writable(path, [".md", ".json"])
    shown = "the file exists, and only files that end in .md or .json are replaced; give another file"
    assert str(caught.value) == f"{path}: {shown}"


def test_a_folder_is_locked_for_one_process(tmp_path: Path) -> None:
    with exclusive(tmp_path, "flying"), pytest.raises(OutputError) as caught, exclusive(tmp_path, "flying"):
        pass
    assert str(caught.value) == f"{tmp_path}: another process is flying this folder; wait for its end"
    with exclusive(tmp_path, "flying"):
        assert (tmp_path / LOCK).is_file()


def test_a_parent_is_looked_for_upwards(tmp_path: Path) -> None:
    check_parent(tmp_path / "a" / "b" / "c")
    assert not list(tmp_path.iterdir())
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError) as caught:
        check_parent(tmp_path / "file" / "a")
    assert str(caught.value) == (
        f"{tmp_path / 'file' / 'a'}: the output folder cannot be written (Not a directory); give another with --output"
    )


@pytest.mark.parametrize(("number", "full"), [(errno.ENOSPC, True), (errno.EDQUOT, True), (errno.EACCES, False)])
def test_a_folder_is_full_where_a_small_file_finds_no_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, full: bool
) -> None:
    assert not is_full(tmp_path)

    def refuse(**_: Any) -> Any:
        raise OSError(number, "")

    monkeypatch.setattr(outputs.tempfile, "TemporaryFile", refuse)
    assert is_full(tmp_path) is full


def test_a_folder_whose_move_fails_comes_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = _written(tmp_path / "f")
    replace, moved = os.replace, []

    def fail(old: Any, new: Any) -> None:
        moved.append(Path(new))
        if len(moved) == 3:  # after the marker and the former folder, the new one
            raise OSError(errno.EIO, "Broken")
        replace(old, new)

    monkeypatch.setattr(os, "replace", fail)
    shown = f"{path}: the folder cannot be written (Broken); give another folder"
    with pytest.raises(OutputError) as caught, new_folder(path, "record", force=True) as work:
        (work / "new").write_text("")
    assert str(caught.value) == shown
    assert (path / "a").read_text() == "a"
    assert [item.name for item in tmp_path.iterdir()] == ["f"]
