from __future__ import annotations

import copy
import pickle

from safe_inspect.config.loading.located import LocatedDict, LocatedList, locate, path_text, plain
from safe_inspect.errors import Location


def tree():
    inner = LocatedDict({"scale": 1}, {"scale": Location("b.yml", 7)}, Location("b.yml", 3))
    items = LocatedList([inner], {0: Location("a.yml", 5)}, Location("a.yml", 4))
    same = LocatedDict({"x": 1}, {"x": Location("a.yml", 9)}, Location("a.yml", 9))
    return LocatedDict(
        {"rewards": items, "same": same},
        {"rewards": Location("a.yml", 2), "same": Location("a.yml", 8)},
        Location("a.yml", 1),
    )


def test_locate_follows_the_path_as_far_as_it_exists():
    assert locate(tree(), ()) == Location("a.yml", 1)
    assert locate(tree(), ("rewards",)) == Location("a.yml", 2)
    assert locate(tree(), ("rewards", 0, "scale")) == Location("b.yml", 7)
    assert locate(tree(), ("rewards", 0, "scale", "deeper")) == Location("b.yml", 7)
    assert locate(tree(), ("rewards", 4)) == Location("a.yml", 2)
    assert locate(tree(), ("nothing", "rewards")) == Location("a.yml", 1)


def test_a_key_missing_in_an_included_file_is_located_in_that_file():
    assert locate(tree(), ("rewards", 0, "missing")) == Location("b.yml", 3)
    assert locate(tree(), ("same", "missing")) == Location("a.yml", 8)


def test_locate_works_without_marks():
    assert locate({"a": [1]}, ("a", 0)) is None


def test_copies_keep_their_marks():
    original = tree()
    for twin in (copy.deepcopy(original), pickle.loads(pickle.dumps(original))):
        assert twin == original
        assert twin["rewards"] is not original["rewards"]
        assert locate(twin, ("rewards", 0, "scale")) == Location("b.yml", 7)
        assert locate(twin, ("rewards", 0, "missing")) == Location("b.yml", 3)
        twin.marks["rewards"] = Location("c.yml", 1)
        assert original.marks["rewards"] == Location("a.yml", 2)
    for shallow in (copy.copy(original), original.copy()):
        assert shallow["rewards"] is original["rewards"]
        assert locate(shallow, ("rewards",)) == Location("a.yml", 2)
    assert copy.copy(original["rewards"]).marks == {0: Location("a.yml", 5)}


def test_plain_gives_plain_containers():
    converted = plain(tree())
    assert converted == {"rewards": [{"scale": 1}], "same": {"x": 1}}
    assert type(converted) is dict
    assert type(converted["rewards"]) is list
    assert type(converted["rewards"][0]) is dict


def test_paths_are_printed_with_indices_in_brackets():
    assert path_text(("rewards", 0, "config", "scael")) == "rewards[0].config.scael"
    assert path_text((1, "x")) == "[1].x"


def test_locations_of_files_and_of_the_command_line():
    assert str(Location("configs/a.yml", 41)) == "configs/a.yml:41"
    assert str(Location("command line", 0, text="lr=abc")) == "command line: lr=abc"
