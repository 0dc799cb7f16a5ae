"""Sealed checkpoints: the newest good one is found, whatever happened to the others."""

from __future__ import annotations

import pytest

from safe_inspect.errors import CheckpointError
from safe_inspect.experiments.modules.checkpoints import SEAL, Checkpoint, find_newest


def save(folder, iteration, digest="d", sealed=True):
    """Write something with the shape of a checkpoint."""
    path = folder / f"checkpoint_{iteration:06d}"
    (path / "learner").mkdir(parents=True)
    (path / "algorithm_state.pkl").write_bytes(bytes([iteration]) * 100)
    (path / "learner" / "state.pkl").write_bytes(bytes([iteration]) * 1000)
    if sealed:
        Checkpoint(path, iteration, 64 * iteration, 1.5 * iteration, digest).seal()
    return path


def test_what_was_sealed_is_read(tmp_path):
    path = save(tmp_path, 5)
    assert Checkpoint.read(path) == Checkpoint(path, 5, 320, 7.5, "d")


def flip(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize(
    ("damage", "text"),
    [
        (lambda path: flip(path / "learner" / "state.pkl"), "learner/state.pkl is not what was saved"),
        (lambda path: (path / "algorithm_state.pkl").write_bytes(b""), "algorithm_state.pkl is not what was saved"),
        (lambda path: (path / "learner" / "state.pkl").unlink(), "learner/state.pkl is missing"),
        (lambda path: (path / SEAL).unlink(), "incomplete, because saving it was interrupted"),
        (lambda path: (path / SEAL).write_text("{"), "seal .* is damaged"),
        (lambda path: path.rename(path.with_name("elsewhere")), "there is no such checkpoint"),
    ],
)
def test_damage_is_found_and_named(tmp_path, damage, text):
    path = save(tmp_path, 5)
    damage(path)
    with pytest.raises(CheckpointError, match=text):
        Checkpoint.read(path)


def test_the_newest_is_the_highest_iteration_of_all_attempts(tmp_path):
    save(tmp_path / "000" / "trial_00000", 8)
    expected = save(tmp_path / "001" / "trial_00000", 9)
    save(tmp_path / "002" / "trial_00000", 7)
    assert find_newest(tmp_path)[0].path == expected


def test_damaged_unfinished_and_foreign_ones_are_passed_over(tmp_path):
    good = save(tmp_path, 3)
    flip(save(tmp_path, 4) / "algorithm_state.pkl")
    save(tmp_path, 5, digest="another")
    save(tmp_path, 6, sealed=False)
    newest, refused = find_newest(tmp_path, "d")
    assert newest.path == good
    assert len(refused) == 3
    assert any("another configuration" in sentence for sentence in refused)


def test_nothing_is_found_where_nothing_is(tmp_path):
    assert find_newest(tmp_path) == (None, [])
