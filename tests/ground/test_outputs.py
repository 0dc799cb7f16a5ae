"""A file that a user names holds what it held before, or the whole new content."""

from __future__ import annotations

import errno
import os
import stat
import threading
from pathlib import Path

import pytest

from safe_inspect.errors import OutputError
from safe_inspect.outputs import MARKER, check_parent, check_writable, is_full, new_file, new_folder, remove_written


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_a_file_that_is_not_finished_leaves_the_former_one_alone(tmp_path, error):
    target = tmp_path / "a.json"
    target.write_text("old")
    with pytest.raises(error), new_file(target) as work:  # noqa: PT012
        work.write_text("half")
        assert target.read_text() == "old"
        raise error
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_finished_file_takes_its_place_in_a_folder_that_is_made(tmp_path):
    target = tmp_path / "new" / "a.svg"
    with new_file(target) as work:
        assert work.suffix == ".svg"  # it says the format
        work.write_text("new")
        assert not target.exists()
    assert target.read_text() == "new"
    assert list(target.parent.iterdir()) == [target]


@pytest.mark.parametrize("new", [new_file, lambda path: new_folder(path, "test")])
def test_folders_that_are_made_for_an_output_go_when_it_is_not_finished(tmp_path, new):
    with pytest.raises(ValueError, match="stopped"), new(tmp_path / "some" / "where" / "a.txt"):
        raise ValueError("stopped")
    assert list(tmp_path.iterdir()) == []


def test_a_check_leaves_no_folder(tmp_path):
    check_writable(tmp_path / "some" / "where" / "a.txt")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "some").mkdir()
    check_writable(tmp_path / "some" / "where" / "a.txt")
    assert list(tmp_path.rglob("*")) == [tmp_path / "some"]


def test_a_link_stays_and_leads_to_the_new_file(tmp_path):
    (tmp_path / "there").write_text("old")
    (tmp_path / "link").symlink_to("there")
    with new_file(tmp_path / "link") as work:
        work.write_text("new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "there").read_text() == "new"


def test_a_pipe_is_written_to_and_not_replaced(tmp_path):
    pipe, found = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: found.append(pipe.read_text()))
    reader.start()
    with new_file(pipe) as work:
        work.write_text("new")
    reader.join()
    assert found == ["new"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_is_named_with_what_to_do(tmp_path, number):
    with pytest.raises(OutputError) as caught, new_file(tmp_path / "a") as work:  # noqa: PT012
        work.write_text("half")
        raise OSError(number, "worded otherwise")
    reason = os.strerror(number)
    wanted = f"{tmp_path / 'a'}: the file cannot be written ({reason}); free some space, or give another file"
    assert str(caught.value) == wanted
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="only Linux has it")
def test_the_device_that_is_always_full():
    message = r"/dev/full: the file cannot be written \(No space left on device\)"
    with pytest.raises(OutputError, match=message), new_file("/dev/full") as work:
        work.write_text("text")
    assert stat.S_ISCHR(os.stat("/dev/full").st_mode)


def written(path, *names):
    with new_folder(path, "record", force=path.exists()) as work:
        for name in names:
            (work / name).parent.mkdir(exist_ok=True)
            (work / name).touch()


def content(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_folder_that_is_not_finished_leaves_the_former_one_alone(tmp_path, error):
    target = tmp_path / "a"
    written(target, "old", "deep/old")
    with pytest.raises(error), new_folder(target, "record", force=True) as work:  # noqa: PT012
        (work / "new").touch()
        raise error
    assert content(tmp_path) == ["a", f"a/{MARKER}", "a/deep", "a/deep/old", "a/old"]
    written(target, "new")
    assert content(tmp_path) == ["a", f"a/{MARKER}", "a/new"]


def test_a_folder_that_cannot_be_moved_to_its_place_leaves_the_former_one(tmp_path, monkeypatch):
    target = tmp_path / "a"
    written(target, "old")
    replace, calls = os.replace, []

    def stopped(source, place):
        calls.append(place)
        if len(calls) == 3:  # the marker is written, the former folder has left its place, the new one is not there yet
            raise KeyboardInterrupt
        replace(source, place)

    monkeypatch.setattr(os, "replace", stopped)
    with pytest.raises(KeyboardInterrupt), new_folder(target, "record", force=True) as work:
        (work / "new").touch()
    assert content(tmp_path) == ["a", f"a/{MARKER}", "a/old"]


def test_what_exists_is_no_new_folder(tmp_path, monkeypatch):
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to("empty")
    (tmp_path / "dangling").symlink_to("nowhere")
    (tmp_path / "loop").symlink_to("loop")
    monkeypatch.chdir(tmp_path)
    before = content(tmp_path)
    for name in ("empty", "file", "link", "dangling", "loop", ".", "..", "/", "empty/..", str(tmp_path)):
        for force in (False, True):
            with pytest.raises(OutputError), new_folder(name, "record", force=force):
                pytest.fail("there is something already")
    assert content(tmp_path) == before


def test_a_finished_folder_is_replaced_by_force_alone(tmp_path):
    with new_folder(tmp_path / "own", "record") as work:
        (work / "a").write_text("first")
    with pytest.raises(OutputError, match="the folder exists already"), new_folder(tmp_path / "own", "record"):
        pytest.fail("there is something already")
    assert (tmp_path / "own" / "a").read_text() == "first"
    with new_folder(tmp_path / "own", "record", force=True) as work:
        (work / "b").write_text("second")
    assert not (tmp_path / "own" / "a").exists()


FOREIGN = {
    "a file": lambda folder: (folder / "thesis.tex").write_text("mine"),
    "a file in a folder": lambda folder: (folder / "deep" / "thesis.tex").write_text("mine"),
    "a folder": lambda folder: (folder / "mine").mkdir(),
    "a link": lambda folder: (folder / "mine").symlink_to("/"),
    "a folder in place of a file": lambda folder: (
        (folder / "old").unlink(),
        (folder / "old" / "x").mkdir(parents=True),
    ),
    "no marker": lambda folder: (folder / MARKER).unlink(),
    "a damaged marker": lambda folder: (folder / MARKER).write_text("{"),
    "a marker that lists nothing": lambda folder: (folder / MARKER).write_text('{"command": "record", "files": []}'),
}


@pytest.mark.parametrize("change", FOREIGN.values(), ids=FOREIGN)
def test_a_folder_with_anything_of_another_origin_is_not_replaced(tmp_path, change):
    target = tmp_path / "a"
    written(target, "old", "deep/old")
    change(target)
    before = content(tmp_path)
    with (
        pytest.raises(OutputError, match="is not replaced"),
        new_folder(target, "record", force=True),
    ):
        pytest.fail("it is refused before anything is done")
    assert content(tmp_path) == before


def test_a_folder_of_another_command_is_not_replaced(tmp_path):
    written(tmp_path / "a", "old")
    message = "this folder is not marked as written by `fly`, so it is not replaced"
    with pytest.raises(OutputError, match=message), new_folder(tmp_path / "a", "fly", force=True):
        pytest.fail("it is refused before anything is done")


@pytest.mark.parametrize("force", [False, True])
def test_what_appears_while_a_folder_is_written_is_kept_and_so_is_the_new_folder(tmp_path, force):
    target = tmp_path / "a"
    if force:
        written(target, "old")
    with pytest.raises(OutputError) as caught, new_folder(target, "record", force=force) as work:  # noqa: PT012
        (work / "new").touch()
        target.mkdir(exist_ok=True)
        (target / "thesis.tex").write_text("mine")
    assert (target / "thesis.tex").read_text() == "mine"
    assert (Path(str(caught.value).rpartition("; what was written is in ")[2]) / "new").exists()


def test_only_what_is_listed_is_removed(tmp_path):
    written(tmp_path / "a", "old", "deep/old", "kept")
    (tmp_path / "a" / "deep" / "thesis.tex").touch()
    remove_written(tmp_path / "a", leave=["kept"])
    assert content(tmp_path) == ["a", "a/deep", "a/deep/thesis.tex", "a/kept"]


def test_a_file_of_another_format_is_not_replaced(tmp_path):
    for name in ("thesis.tex", "a.json"):
        (tmp_path / name).touch()
    with pytest.raises(OutputError, match=r"thesis.tex: the file exists, and only files that end in .json"):
        check_writable(tmp_path / "thesis.tex", [".json"])
    check_writable(tmp_path / "a.json", [".json"])
    check_writable(tmp_path / "new", [".json"])


def test_what_cannot_be_written_is_found_before(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="it is a folder"):
        check_writable(tmp_path)
    with pytest.raises(OutputError, match="Not a directory"):
        check_writable(tmp_path / "file" / "a")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_folder_without_room(tmp_path):
    resource = pytest.importorskip("resource")
    assert not is_full(tmp_path)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        assert is_full(tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_made_is_found_before(tmp_path):
    check_parent(tmp_path / "new" / "runs")
    assert not list(tmp_path.iterdir())
    file = tmp_path / "file"
    file.touch()
    for place in (Path("/proc/nowhere"), file / "runs", file):
        with pytest.raises(OutputError, match="the output folder cannot be written"):
            check_parent(place)
