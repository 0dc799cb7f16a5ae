from __future__ import annotations

import copy

import pytest

from safe_inspect.config.loading.loader import load
from safe_inspect.config.loading.located import locate
from safe_inspect.config.loading.overrides import apply_overrides
from safe_inspect.errors import ConfigError

TREE = """\
rllib: {lr: 1, train_batch_size: 1500, 1: one}
agent_config:
  blue0_ctrl: &agent
    config:
      parts:
        - {part: RateController, config: {name: X Thrust, axis: 0}}
        - {part: peer.parts.Sensor_Position}
      glues:
        - {functor: peer.glues.ObserveSensor, config: {sensor: Sensor_Position, scale: 1}}
        - {functor: peer.glues.ObserveSensor, config: {sensor: Sensor_Velocity, scale: 2}}
      rewards:
        - {name: Points, functor: peer.ObservedPointsReward, config: {scale: 0.01}}
        - {name: Crash, functor: Points, config: {scale: -1}}
records:
  - [blue0, [platform0], {agent: A, config: {rewards: {scale: 3}}}, {policy: P, config: {lr: 4}}]
  - [blue1, [platform1], {agent: B, config: {}}, {policy: Q}]
"""


@pytest.fixture
def tree(write):
    write({"a.yml": TREE})
    return load("a.yml")


def problem(tree, override: str) -> str:
    with pytest.raises(ConfigError) as caught:
        apply_overrides(tree, [override])
    (only,) = caught.value.problems
    return str(only)


@pytest.mark.parametrize(
    ("override", "path", "value"),
    [
        ("rllib.lr=1e-4", ("rllib", "lr"), 1e-4),
        ("rllib.1=two", ("rllib", 1), "two"),
        ("rllib.new=[1, {a: b=c}]", ("rllib", "new"), [1, {"a": "b=c"}]),
        ("rllib.lr=", ("rllib", "lr"), None),
        ("train_batch_size=2000", ("rllib", "train_batch_size"), 2000),
        ("records.0.0=red", ("records", 0, 0), "red"),
        ("records.blue0.policy=R", ("records", 0, 3, "policy"), "R"),
        ("records.blue0.config.rewards.scale=5", ("records", 0, 2, "config", "rewards", "scale"), 5),
        ("records.blue0.config.lr=5", ("records", 0, 3, "config", "lr"), 5),
        ("records.blue1.agent=1", ("records", 1, 2, "agent"), 1),
        ("agent_config.blue0_ctrl.config.rewards.1.config.scale=2", ("rewards", 1, "config", "scale"), 2),
        ("agent_config.blue0_ctrl.config.rewards.ObservedPointsReward.name=new", ("rewards", 0, "name"), "new"),
        ("ObservedPointsReward.config.scale=0.02", ("rewards", 0, "config", "scale"), 0.02),
        ("rewards.Points.config.scale=7", ("rewards", 0, "config", "scale"), 7),
        ("glues.Sensor_Velocity.config.scale=8", ("glues", 1, "config", "scale"), 8),
        ("X Thrust.config.axis=2", ("parts", 0, "config", "axis"), 2),
        ("parts.Sensor_Position=3", ("parts", 1), 3),
        ("agent_config.blue0_ctrl.config.parts.RateController.config.extra=9", ("parts", 0, "config", "extra"), 9),
    ],
)  # fmt: skip
def test_one_place_is_replaced(tree, override, path, value):
    if path[0] not in tree:
        path = ("agent_config", "blue0_ctrl", "config", *path)
    before = copy.deepcopy(tree)
    changed = apply_overrides(tree, [override])
    assert tree == before
    node = changed
    for key in path:
        node = node[key]
    assert node == value
    expected = copy.deepcopy(before)
    parent = expected
    for key in path[:-1]:
        parent = parent[key]
    parent[path[-1]] = value
    assert changed == expected
    assert str(locate(changed, path)) == f"command line: {override}"


def test_other_places_keep_their_locations(tree):
    changed = apply_overrides(tree, ["rllib.lr={a: {b: 1}}"])
    assert str(locate(changed, ("rllib", "train_batch_size"))) == "a.yml:1"
    assert str(locate(changed, ("rllib", "lr", "a", "b"))) == "command line: rllib.lr={a: {b: 1}}"


def test_what_an_anchor_shares_is_replaced_in_one_place_only(write):
    write({"a.yml": "a: &a {x: {y: 1}}\nb: *a\n"})
    assert apply_overrides(load("a.yml"), ["b.x.y=2"]) == {"a": {"x": {"y": 1}}, "b": {"x": {"y": 2}}}


def test_overrides_apply_in_order_and_take_includes(tree, write):
    write({"ppo.yml": "lr: 5\n"})
    changed = apply_overrides(tree, ["rllib=!include ppo.yml", "rllib.lr=6", "rllib.clip=7"])
    assert changed["rllib"] == {"lr": 6, "clip": 7}


def test_a_suffix_that_fits_several_places_lists_them(tree):
    assert problem(tree, "lr=2") == (
        "command line: lr=2: `lr` fits 2 places; write one of `rllib.lr`, `records.0.3.config.lr`"
    )
    assert problem(tree, "glues.ObserveSensor.config.scale=2") == (
        "command line: glues.ObserveSensor.config.scale=2: `glues.ObserveSensor.config.scale` fits 2 places; "
        "write one of "
        "`agent_config.blue0_ctrl.config.glues.0.config.scale`, `agent_config.blue0_ctrl.config.glues.1.config.scale`"
    )


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("rllib.lr", "not an override; write it as `path.of.keys=value`"),
        ("rllib..lr=1", "not an override; write it as `path.of.keys=value`"),
        ("=1", "not an override; write it as `path.of.keys=value`"),
        ("train_batch_s=1", "nothing is called `train_batch_s` in the configuration; did you mean `train_batch_size`?"),
        ("rlib.lr=1", "nothing is called `rlib` in the configuration; did you mean `rllib`?"),
        ("rllib.modle.act=1", "nothing is called `modle` in `rllib`; known: `1`, `lr`, `train_batch_size`"),
        ("rllib.lr.x=1", "nothing is called `x` in `rllib.lr`, which holds no keys"),
        ("axis.scale=1", "no path of the configuration ends in `axis.scale`; write it from the root"),
        (
            "agent_config.blue0_ctrl.config.rewards.Pointz.config.scale=1",
            "nothing is called `Pointz` in `agent_config.blue0_ctrl.config.rewards`; did you mean `Points`?",
        ),
        (
            "agent_config.blue0_ctrl.config.parts.7=1",
            "nothing is called `7` in `agent_config.blue0_ctrl.config.parts`; "
            "known: `RateController`, `Sensor_Position`, `X Thrust`",
        ),
    ],
)  # fmt: skip
def test_an_override_that_fits_nothing(tree, override, message):
    assert problem(tree, override) == f"command line: {override}: {message}"


def test_a_value_that_is_no_yaml(tree):
    assert problem(tree, "rllib.lr=[1").startswith("command line: rllib.lr=[1: not valid YAML: the brackets `[`")


def test_all_wrong_overrides_are_reported_together(tree):
    with pytest.raises(ConfigError) as caught:
        apply_overrides(tree, ["nothing=1", "rllib.lr=3", "lr"])
    assert [p.location.text for p in caught.value.problems] == ["nothing=1", "lr"]
