"""A file that a user names holds what it held before, or the whole new content."""

from __future__ import annotations

import errno
import os
import stat
import threading

import pytest

from safe_inspect.errors import OutputError
from safe_inspect.outputs import check_writable, is_full, new_file, new_folder


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


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_folder_that_is_not_finished_leaves_the_former_one_alone(tmp_path, error):
    target = tmp_path / "a"
    target.mkdir()
    (target / "old").touch()
    with pytest.raises(error), new_folder(target) as work:  # noqa: PT012
        (work / "new").touch()
        raise error
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a", "old"]
    with new_folder(target) as work:
        (work / "new").touch()
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a", "new"]


def test_a_folder_that_cannot_be_moved_to_its_place_leaves_the_former_one(tmp_path, monkeypatch):
    target = tmp_path / "a"
    target.mkdir()
    (target / "old").touch()
    replace, calls = os.replace, []

    def stopped(source, place):
        calls.append(place)
        if len(calls) == 2:  # the former folder has left its place, the new one is not there yet
            raise KeyboardInterrupt
        replace(source, place)

    monkeypatch.setattr(os, "replace", stopped)
    with pytest.raises(KeyboardInterrupt), new_folder(target) as work:
        (work / "new").touch()
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a", "old"]


def test_what_cannot_be_written_is_found_before(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="it is a folder"):
        check_writable(tmp_path)
    with pytest.raises(OutputError, match="Not a directory"):
        check_writable(tmp_path / "file" / "a")
    check_writable(tmp_path / "new" / "a")
    assert not list((tmp_path / "new").iterdir())


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
