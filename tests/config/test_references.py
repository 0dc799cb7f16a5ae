from __future__ import annotations

import copy

from safe_inspect.config.loading.loader import load
from safe_inspect.config.loading.located import locate
from safe_inspect.config.loading.references import expand_references
from safe_inspect.errors import Problem

AGENT = """\
agent: A
config:
  glues:
    - functor: Rta
      config: {enabled: false}
      references:
        radius: collision_radius
        v0: speed_limit
      wrapped:
        - functor: Inner
          references: {step_size: step_size}
  rewards:
    - functor: Fuel
      references: {mass: mass, name: sensor, count: count, limits: limits}
  reference_store: !include ./parameters.yml
"""
STORE = """\
collision_radius: {value: 10, units: m}
speed_limit: 0.2
step_size: {type: corl.libraries.parameters.ConstantParameter, config: {name: dt, units: seconds, value: 10}}
mass: {type: ConstantParameter, config: {value: 12}}
sensor: {type: corl.libraries.parameters.ConstantParameter, config: {units: none, value: reference_position}}
count: {type: ConstantParameter, config: {units: dimensionless, value: 5}}
limits: [1, 2]
"""


def problems(tree) -> list[str]:
    found: list[Problem] = []
    expand_references(tree, found)
    return [str(problem) for problem in found]


def test_references_become_fields(write):
    write({"agent.yml": AGENT, "parameters.yml": STORE})
    tree = load("agent.yml")
    before = copy.deepcopy(tree)
    expanded = expand_references(tree, [])["config"]
    rta, fuel = expanded["glues"][0], expanded["rewards"][0]
    assert rta["config"] == {"enabled": False, "radius": {"value": 10, "units": "m"}, "v0": 0.2}
    assert rta["wrapped"] == [{"functor": "Inner", "config": {"step_size": {"value": 10, "units": "seconds"}}}]
    assert fuel == {
        "functor": "Fuel",
        "config": {"mass": 12, "name": "reference_position", "count": 5, "limits": [1, 2]},
    }
    assert expanded["reference_store"] == before["config"]["reference_store"]
    assert tree == before


def test_a_value_is_located_in_the_store(write):
    write({"agent.yml": AGENT, "parameters.yml": STORE})
    expanded = expand_references(load("agent.yml"), [])
    glue = ("config", "glues", 0)
    assert str(locate(expanded, (*glue, "config", "v0"))) == "parameters.yml:2"
    assert str(locate(expanded, (*glue, "config", "radius"))) == "parameters.yml:1"
    assert str(locate(expanded, (*glue, "config", "radius", "value"))) == "parameters.yml:1"
    assert str(locate(expanded, (*glue, "config", "enabled"))) == "agent.yml:5"
    assert str(locate(expanded, (*glue, "wrapped", 0, "config", "step_size"))) == "parameters.yml:3"
    assert str(locate(expanded, ("config", "rewards", 0, "config", "limits"))) == "parameters.yml:7"


def test_all_wrong_references_are_reported_together(write):
    write(
        {
            "a.yml": "config:\n"
            "  reference_store: {max_distance: 800}\n"
            "  dones:\n"
            "    - functor: Far\n"
            "      config: {max_distance: 5}\n"
            "      references:\n"
            "        max_distance: max_distance\n"
            "        other: max_distanse\n"
            "        third: 3\n"
            "    - functor: Far\n"
            "      references: [max_distance]\n"
            "    - functor: Far\n"
            "      config: 3\n"
            "      references: {max_distance: max_distance}\n"
        }
    )
    assert problems(load("a.yml")) == [
        "a.yml:7 config.dones[0].references.max_distance: `max_distance` is also in `config` (a.yml:5); "
        "remove it there, and set `reference_store.max_distance` instead",
        "a.yml:8 config.dones[0].references.other: the `reference_store` has no key `max_distanse`; "
        "did you mean `max_distance`?",
        "a.yml:9 config.dones[0].references.third: expected a key of the `reference_store`, got 3; "
        "put the value itself into `config.third`",
        "a.yml:11 config.dones[1].references: expected a mapping of fields to keys of the `reference_store`, "
        "got ['max_distance']",
        "a.yml:13 config.dones[2].config: expected a mapping of fields, got 3",
    ]


def test_references_without_a_store(write):
    write({"a.yml": "rewards:\n  - functor: X\n    references: {a: b}\n"})
    assert problems(load("a.yml")) == [
        "a.yml:3 rewards[0].references: there is no `reference_store` to refer to; "
        "add a mapping `reference_store` to the agent's `config`"
    ]


def test_a_constant_with_an_unknown_unit_stays_a_quantity():
    store = {"r": {"type": "ConstantParameter", "config": {"value": 1, "units": "parsecs"}}}
    tree = {"reference_store": store, "rewards": [{"functor": "X", "references": {"radius": "r"}}]}
    assert expand_references(tree, [])["rewards"][0]["config"] == {"radius": {"value": 1, "units": "parsecs"}}
