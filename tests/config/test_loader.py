from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from safe_inspect.config.loading.loader import load
from safe_inspect.config.loading.located import locate
from safe_inspect.config.loading.syntax import FLOAT
from safe_inspect.errors import ConfigError, Location, Problem

FLOW = """\
"agent": "TrainableAgent"  # a comment
"config": {
    "frame_rate": 0.1,  # Hz
    "parts": [
        {"part": "Thruster", "config": {"name": "X", "axis": 0, properties: {name: "x"}}},
        {"part": "Camera"},
    ],
    # a comment between
    "light" : {'ambient': [.1, 0, 0], 'on': True, 'off': False, "pitch": 5.6e-3},
    "rewards": [
      {
          "name": "Points",
          "config": {
              "scale": 0.01
          }
      },
    ],
    "reference_store": !include configs/task/parameters.yml
}
"""


def problems(name: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        load(name)
    return [str(problem) for problem in caught.value.problems]


def test_flow_style_with_trailing_commas_and_comments(write):
    write({"configs/task/agent.yml": FLOW, "configs/task/parameters.yml": "mass: {value: 12, units: kg}\n"})
    tree = load("configs/task/agent.yml")
    config = tree["config"]
    assert tree["agent"] == "TrainableAgent"
    assert config["parts"][0]["config"] == {"name": "X", "axis": 0, "properties": {"name": "x"}}
    assert config["light"] == {"ambient": [0.1, 0, 0], "on": True, "off": False, "pitch": 5.6e-3}
    assert config["reference_store"] == {"mass": {"value": 12, "units": "kg"}}
    assert locate(tree, ("config", "rewards", 0, "config", "scale")) == Location("configs/task/agent.yml", 14)
    assert locate(tree, ("config", "parts", 1)) == Location("configs/task/agent.yml", 6)
    assert locate(tree, ("config", "reference_store", "mass", "units")) == Location("configs/task/parameters.yml", 1)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3), ("5e-05", 5e-5), ("-1e3", -1000.0), ("+2E+4", 2e4), ("1.5e3", 1500.0), (".5e2", 50.0),
        ("1.e2", 100.0), ("1_0e2", 1000.0), (".inf", float("inf")), ("0x1F", 31), ("yes", True),
        ("~", None), ("=", "="),
        ("e5", "e5"), ("1e", "1e"), ("'1e5'", "1e5"), ("!!str 1e5", "1e5"), ("!!float 3", 3.0), ("1.2.3e4", "1.2.3e4"),
    ],
)  # fmt: skip
def test_scalars(write, text, value):
    write({"a.yml": f"x: {text}\n"})
    loaded = load("a.yml")["x"]
    assert loaded == value
    assert type(loaded) is type(value)


texts = st.text(st.characters(exclude_categories=("Cs",)), max_size=8).filter(lambda text: not FLOAT.match(text))
scalars = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | texts
trees = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(texts, inner, max_size=4), max_leaves=15
)


@settings(max_examples=100, deadline=None)
@given(data=trees, flow=st.sampled_from([True, False, None]))
def test_what_yaml_writes_is_loaded_equal(data, flow):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.yml"
        path.write_text(yaml.safe_dump(data, default_flow_style=flow), encoding="utf-8")
        assert load(path) == data


def test_anchors_aliases_and_merge_keys(write):
    write(
        {
            "a.yml": "base: &base {lr: 1, gamma: 2}\n"
            "other: &other {gamma: 3, clip: 4}\n"
            "one:\n  <<: *base\n  lr: 5\n"
            "two:\n  <<: [*base, *other]\n"
            "three: *other\n"
        }
    )
    tree = load("a.yml")
    assert tree["one"] == {"lr": 5, "gamma": 2}
    assert tree["two"] == {"lr": 1, "gamma": 2, "clip": 4}
    assert tree["three"] == {"gamma": 3, "clip": 4}
    assert locate(tree, ("one", "lr")) == Location("a.yml", 5)
    assert locate(tree, ("one", "gamma")) == Location("a.yml", 1)
    assert locate(tree, ("two", "clip")).line == 2


def test_duplicate_keys_name_both_lines(write):
    write({"a.yml": "lr: 1\nb:\n  c: 1\n  d: 2\n  c: 3\n\nlr: 2\n"})
    assert problems("a.yml") == [
        "a.yml:5: the key `c` is given twice; the first is in line 3; remove one of them",
        "a.yml:7: the key `lr` is given twice; the first is in line 1; remove one of them",
    ]


def test_two_merge_keys_are_duplicates(write):
    write({"a.yml": "a: &a {x: 1}\nb:\n  <<: *a\n  <<: *a\n"})
    assert problems("a.yml") == ["a.yml:4: the key `<<` is given twice; the first is in line 3; remove one of them"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x: 1\ny: [1, 2\n", "a.yml:2: not valid YAML: the brackets `[` are not closed before here"),
        ("x: 1\ny: {a: 1\n", "a.yml:2: not valid YAML: the braces `{` are not closed before here"),
        ("x: {a: 1\n b: 2}\n", "a.yml:2: not valid YAML: "),
        ("x: 1\ny: {a: b: c}\n", "a.yml:2: not valid YAML: "),
        ("x:\n\ty: 1\n", "a.yml:2: not valid YAML: there is a tab here; indent with spaces (column 1"),
        ("x: 1\ny: 'abc\nz: 2\n", "a.yml:2: not valid YAML: a quote is opened but not closed (column 4"),
        ("x: 1\nlr\n", "a.yml:2: not valid YAML: a key without a `:` after it (column 1"),
        ("x: 1\n\ny: *base\n", "a.yml:3: not valid YAML: an alias `*` without an anchor `&` before it in this file"),
        ("x: 1\n---\ny: 2\n", "a.yml:2: not valid YAML: a second document begins here"),
        ("x: a: b\n", "a.yml:1: not valid YAML: a `:` where no key can be"),
        ("x:\n  - 1\n  y: 2\n", "a.yml:3: not valid YAML: no "),
        ("x: 1\ny: \x07\n", "a.yml:2: not valid YAML: the control character U+0007 is not allowed; remove it"),
        ("{x: 1}}\n", "a.yml:1: not valid YAML: there is text after the end of the document"),
        ("x: @y\n", "a.yml:1: not valid YAML: nothing in YAML begins with this character; quote the string (column 4"),
        ("y: !!python/object/apply:os.system [ls]\n", "a.yml:1: unknown tag `!!python/object/apply:os.system`"),
        ("x: !env HOME\n", "a.yml:1: unknown tag `!env`; the tags are `!include FILE`"),
        ("x: !!set {a}\n", "a.yml:1: unknown tag `!!set`"),
        ("x: !!map 3\n", "a.yml:1: the tag `!!map` is not valid for the value after it; remove it"),
        ("x: !!int abc\n", "a.yml:1: 'abc' is not a valid whole number; quote it if it is a string"),
        ("x: 2024-13-45\n", "a.yml:1: '2024-13-45' is not a valid date; quote it if it is a string"),
        ("x: &x\n  - *x\n", "a.yml:1: an alias inside this value refers to the value itself; write it out"),
        ("x: 1\n? [a]\n: 2\n", "a.yml:2: a list or a mapping cannot be a key; quote it if it is a string"),
        ("x:\n  <<: 3\n", "a.yml:2: `<<` needs a mapping or a list of mappings; give it an alias `*name` of one"),
        ("x: 1\ny: !include\n", "a.yml:2: `!include` names no file; write `!include FILE`"),
        ("x: 1\ny: !include [a.yml]\n", "a.yml:2: `!include` takes the name of one file; write `!include FILE`"),
        ("", "a.yml:1: the file is empty; write a mapping, or `{}` for an empty one"),
        ("# only a comment\n", "a.yml:1: the file is empty"),
        ("[" * 400 + "]" * 400, "a.yml:1: the values are nested too deeply; put a part of them into a separate file"),
    ],
)  # fmt: skip
def test_one_mistake_is_one_message(write, text, message):
    write({"a.yml": text})
    (problem,) = problems("a.yml")
    assert problem.startswith(message)


def test_columns_and_the_opening_line_are_named(write):
    write({"a.yml": "x: {\n a: {b: 1\n}\nb: 2\n"})
    (problem,) = problems("a.yml")
    assert problem.startswith("a.yml:4: ")
    assert "column 1, see line 1 too; the parser says: " in problem


def test_mistakes_are_reported_together(write):
    write({"a.yml": "a: !x 1\nb: !include nowhere.yml\nc: 1\nc: 2\n"})
    assert [problem.split(":")[1] for problem in problems("a.yml")] == ["1", "2", "4"]


def test_text_that_is_not_utf8(write):
    write({"a.yml": b"x: 1\ny: \xe9t\xe9\n"})
    assert problems("a.yml") == ["a.yml:2: the file is not UTF-8 text (the byte 0xe9); save it as UTF-8"]


def test_a_byte_order_mark_and_windows_lines_are_fine(write):
    write({"a.yml": b"\xef\xbb\xbfx: 1\r\ny: 2\r\n"})
    tree = load("a.yml")
    assert tree == {"x": 1, "y": 2}
    assert locate(tree, ("y",)) == Location("a.yml", 2)


def test_a_missing_file_names_the_nearest(write):
    folder = write({"configs/task/experiment.yml": "{}\n"})
    (problem,) = problems("configs/task/experimnt.yml")
    assert problem.startswith("no file 'configs/task/experimnt.yml' (searched: configs/task/experimnt.yml, ")
    assert problem.endswith("; did you mean `configs/task/experiment.yml`?")
    (problem,) = problems(str(folder / "configs/tusk/experiment.yml"))
    assert problem.endswith(f"did you mean `{folder}/configs/task/experiment.yml`?")


def test_a_directory_names_its_files(write):
    write({"configs/b.yml": "{}", "configs/a.yaml": "{}", "empty/readme": ""})
    assert problems("configs") == ["'configs' is a directory; name one of its files: a.yaml, b.yml"]
    assert problems("empty") == ["'empty' is a directory; name a file"]


def test_an_unreadable_file(write, monkeypatch):
    write({"a.yml": "x: 1", "b.yml": "x: !include a.yml"})

    def refuse(path, flags):
        raise PermissionError(13, os.strerror(13))

    monkeypatch.setattr(os, "open", refuse)
    assert problems("a.yml") == ["cannot read 'a.yml': Permission denied"]


def test_aliases_that_mean_billions_of_values_are_refused_at_once(write):
    rows = [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 10)]
    write({"a.yml": "\n".join(["a0: &a0 [1]", *rows])})
    began = time.process_time()
    (text,) = problems("a.yml")
    assert text.startswith("a.yml:1: with its aliases and includes it has ")
    assert "at most 200,000 are allowed" in text
    assert time.process_time() - began < 1.0


def test_a_file_of_megabytes_is_refused_at_once(write):
    write({"a.yml": "x: 1\n" * 3_000_000})
    began = time.process_time()
    assert problems("a.yml") == [
        "'a.yml' is larger than 1 MB; if it is a configuration, split it and `!include` the parts"
    ]
    assert time.process_time() - began < 1.0


def test_not_more_than_fifty_mistakes_are_printed():
    text = str(ConfigError([Problem(f"mistake {number}") for number in range(60)]))
    assert text.splitlines()[-2:] == ["mistake 49", "and 10 more"]


@pytest.mark.parametrize("path", [None, 5, ["a.yml"]])
def test_what_is_no_path_is_refused(path):
    with pytest.raises(ConfigError, match="a configuration must be the path of a file, not"):
        load(path)
