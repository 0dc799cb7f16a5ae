from __future__ import annotations

import copy

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safe_inspect.config.loading.loader import load
from safe_inspect.config.loading.located import Removal, locate
from safe_inspect.config.loading.merge import merge
from safe_inspect.errors import ConfigError

keys = st.sampled_from("abc")
leaves = st.integers(0, 3) | st.lists(st.integers(0, 3), max_size=2)
mappings = st.dictionaries(
    keys, st.recursive(leaves, lambda inner: st.dictionaries(keys, inner, max_size=3), max_leaves=6), max_size=3
)
#: Mappings in which a key holds a mapping (upper case) or a leaf (lower case) wherever it stands.
shaped = st.recursive(
    st.dictionaries(keys, leaves, max_size=3),
    lambda inner: st.builds(
        lambda low, high: low | high,
        st.dictionaries(keys, leaves, max_size=3),
        st.dictionaries(st.sampled_from("AB"), inner, max_size=2),
    ),
    max_leaves=5,
)


def test_later_wins_key_by_key_and_lists_replace():
    first = {"lr": 1, "model": {"fcnet": [256, 256], "act": "tanh"}, "old": {"x": 1}}
    second = {"lr": 2, "model": {"fcnet": [64]}, "old": 3, "new": None}
    assert merge([first, second]) == {"lr": 2, "model": {"fcnet": [64], "act": "tanh"}, "old": 3, "new": None}


@settings(max_examples=60, deadline=None)
@given(mappings)
def test_the_empty_mapping_is_the_identity(mapping):
    assert merge(mapping) == merge([mapping]) == merge([mapping, {}]) == merge([{}, mapping]) == mapping
    assert merge([mapping, mapping]) == mapping


@settings(max_examples=60, deadline=None)
@given(mappings, mappings, mappings)
def test_merging_goes_from_left_to_right(a, b, c):
    assert merge([a, b, c]) == merge([merge([a, b]), c])


@settings(max_examples=60, deadline=None)
@given(shaped, shaped, shaped)
def test_merging_is_associative_where_keys_keep_their_kind(a, b, c):
    assert merge([merge([a, b]), c]) == merge([a, merge([b, c])])


@settings(max_examples=30, deadline=None)
@given(mappings, mappings)
def test_nothing_is_changed_in_place(a, b):
    before = copy.deepcopy((a, b))
    merge([a, b])
    assert (a, b) == before


def test_no_items_are_the_empty_mapping():
    assert merge([]) == {}


def test_marks_follow_the_winning_value(write):
    write(
        {
            "a.yml": "- !include b.yml\n- lr: 2\n  model:\n    act: relu\n",
            "b.yml": "lr: 1\nmodel:\n  width: 8\n  act: tanh\n",
        }
    )
    tree = load("a.yml")
    merged = merge(tree)
    assert merged == {"lr": 2, "model": {"width": 8, "act": "relu"}}
    assert str(locate(merged, ("lr",))) == "a.yml:2"
    assert str(locate(merged, ("model", "width"))) == "b.yml:3"
    assert str(locate(merged, ("model", "act"))) == "a.yml:4"
    assert str(locate(tree, (0, "model", "act"))) == "b.yml:4"


def test_items_that_are_no_mappings_are_errors(write):
    write({"a.yml": "x:\n  - {a: 1}\n  - 3\n  - b\n"})
    tree = load("a.yml")
    with pytest.raises(ConfigError) as caught:
        merge(tree["x"])
    assert [str(problem) for problem in caught.value.problems] == [
        "a.yml:3: item 1 of a merged list must be a mapping, not 3",
        "a.yml:4: item 2 of a merged list must be a mapping, not 'b'",
    ]
    with pytest.raises(ConfigError, match="expected a mapping or a list of mappings, got 'abc'"):
        merge("abc")


def test_an_empty_item_adds_nothing(write):
    write({"a.yml": "x:\n  - {a: 1}\n  -\n  - {b: 2}\n"})
    assert merge(load("a.yml")["x"]) == {"a": 1, "b": 2}


def test_a_key_with_a_plus_appends_to_the_list():
    base = {"config": {"rewards": [1, 2], "dones": [3]}}
    merged = merge([base, {"config": {"rewards+": [4]}}, {"config": {"rewards+": [5], "dones": []}}])
    assert merged == {"config": {"rewards": [1, 2, 4, 5], "dones": []}}
    assert base == {"config": {"rewards": [1, 2], "dones": [3]}}


def test_mistakes_of_a_list_are_located_where_it_was_appended_to(write):
    write({"a.yml": "x:\n  - {a: [1]}\n  - b: 2\n    a+: [2]\n"})
    merged = merge(load("a.yml")["x"])
    assert str(locate(merged, ("a",))) == "a.yml:4"
    assert [str(locate(merged, ("a", index))) for index in (0, 1)] == ["a.yml:2", "a.yml:4"]


def test_appending_to_no_list_is_an_error():
    with pytest.raises(ConfigError, match=r"`rewards\+` must be a list, not 4"):
        merge([{"rewards": [1]}, {"rewards+": 4}])


@pytest.mark.parametrize("base", [{"rewards": [1]}, {"config": {"config": {"rewards": [1]}}}])
def test_a_misspelt_list_to_append_to_is_suggested(base):
    with pytest.raises(ConfigError, match=r"there is no list `rewads` to append to; did you mean `rewards`\?"):
        merge([base, {"rewads+": [4]}])


def test_a_list_that_a_reference_gives_is_appended_to_in_the_store():
    base = {"config": {"enabled": True}, "references": {"constraints": "limits"}}
    with pytest.raises(ConfigError, match=r"is given by a reference; .*`reference_store: \{limits\+: \[...\]\}`"):
        merge([base, {"config": {"constraints+": [4]}}])
    assert merge([base, {"config": {"enabled": False}}])["config"] == {"enabled": False}


def test_all_mistakes_of_a_layer_are_reported_at_once():
    base = {"rewards": [{"functor": "A"}], "config": {"lr": 1}, "parts": [1]}
    layer = {"rewads+": [4], "config": {"lrr": Removal()}, "rewards": {"B": {"config": {}}, "C": {}}, "parts": [2]}
    with pytest.raises(ConfigError) as caught:
        merge([base, layer])
    words = ("no list `rewads`", "no such key to remove", "no item named 'B'", "no item named 'C'")
    assert [one for one in words if one in str(caught.value)] == list(words)


def test_a_list_within_the_list_is_merged_first():
    assert merge([[{"a": 1}, {"b": [2]}], {"b+": [3]}]) == {"a": 1, "b": [2, 3]}
    with pytest.raises(ConfigError, match="must be a mapping, not 7"):
        merge([{"a": 1}, [{"b": 2}, 7]])


def test_a_key_may_be_removed(write):
    write({"a.yml": "x:\n- {a: {b: 1, c: 2}, d: [3]}\n- a: {b: !remove }\n  d: !remove\n"})
    assert merge(load("a.yml")["x"]) == {"a": {"c": 2}}
    write({"b.yml": "x:\n- {a: 1}\n- {aa: !remove }\n"})
    with pytest.raises(ConfigError, match=r"b.yml:3 aa: there is no such key to remove; did you mean `a`\?|known: `a`"):
        merge(load("b.yml")["x"])


PARTS = [
    {"part": "RateController", "config": {"name": "X", "axis": 0}},
    {"part": "RateController", "config": {"name": "Y", "axis": 1}},
    {"part": "my.Sensor_Position", "config": {}},
]


def test_a_mapping_merges_into_the_items_that_its_keys_name():
    over = {"parts": {"Y": {"config": {"axis": 2}}, "Sensor_Position": {"name": "p"}, "X": Removal()}}
    assert merge([{"parts": PARTS}, over])["parts"] == [
        {"part": "RateController", "config": {"name": "Y", "axis": 2}},
        {"part": "my.Sensor_Position", "config": {}, "name": "p"},
    ]
    assert PARTS[1]["config"]["axis"] == 1


def test_a_mapping_removes_and_replaces_plain_names_of_a_list():
    names = ["range", "sun", {"functor": "my.Wall", "config": {"offset": 1}}]
    over = {"sun": Removal(), "Wall": {"config": {"offset": 2}}, "range": {"functor": "range", "config": {"r_max": 3}}}
    assert merge([{"kept": names}, {"kept": over}])["kept"] == [
        {"functor": "range", "config": {"r_max": 3}}, {"functor": "my.Wall", "config": {"offset": 2}}
    ]  # fmt: skip
    with pytest.raises(ConfigError, match=r"the list has no item named 'sum'; did you mean `sun`\?"):
        merge([{"kept": names}, {"kept": {"sum": Removal()}}])
    with pytest.raises(ConfigError, match="2 items of the list are named 'sun'"):
        merge([{"kept": ["sun", "sun"]}, {"kept": {"sun": Removal()}}])
    assert merge([{"kept": [1, 2]}, {"kept": {"a": 1}}])["kept"] == {"a": 1}, "numbers have no names"


@pytest.mark.parametrize(
    ("name", "words"), [("Z", "the list has no item named 'Z'"), ("RateController", "2 items of the list are named")]
)
def test_the_name_of_no_item_or_of_several_is_an_error(name, words):
    with pytest.raises(ConfigError, match=words):
        merge([{"parts": PARTS}, {"parts": {name: {}}}])


def test_items_keep_their_places(tmp_path):
    (tmp_path / "a.yml").write_text("- a:\n  - {name: one, x: 1}\n  - {name: two, x: 1}\n- a:\n    two: {x: 2}\n")
    tree = merge(load(tmp_path / "a.yml"))
    assert locate(tree, ("a", 0)).line == 2
    assert locate(tree, ("a", 1)).line == 3
    assert locate(tree, ("a", 1, "x")).line == 5


def test_a_mapping_replaces_a_list_without_names():
    assert merge([{"a": [{"b": 1}]}, {"a": {"c": 2}}])["a"] == {"c": 2}
