from __future__ import annotations

from typing import Any

import pytest
import yaml
from pydantic import BaseModel, ValidationError
from pydantic_core import PydanticCustomError

from safe_inspect.glues.actions import ControllerGlue
from safe_inspect.plugins.functor import build, describe, errors_of, functor_field, name_key
from safe_inspect.rewards import Reward
from safe_inspect.rewards.inspection import ObservedPointsReward
from safe_inspect.rta import RTAGlueCWHInspection1v1
from safe_inspect.simulators.resets.initializers import CWH3DRadialWithSunInitializer
from safe_inspect.simulators.resets.parameters import UniformParameter


def mistakes(kind: str, value: Any) -> dict[tuple[Any, ...], str]:
    """Return the messages of a wrong functor by the path of keys."""

    class Holder(BaseModel):
        item: functor_field(kind)  # type: ignore[valid-type]

    with pytest.raises(ValidationError) as caught:
        Holder(item=value)
    found = {problem["loc"]: problem["msg"] for problem in errors_of(caught.value)}
    assert all(loc[0] == "item" for loc in found)
    return {loc[1:]: message for loc, message in found.items()}


def uniform(low: float, high: float, **more: Any) -> dict[str, Any]:
    return {"type": "UniformParameter", "config": {"low": low, "high": high, **more}}


def test_a_mapping_a_name_and_a_plugin_build_the_same() -> None:
    plugin = ObservedPointsReward()
    assert build("reward", {"functor": "ObservedPointsReward"}) == plugin
    assert build("reward", {"functor": "ObservedPointsReward", "name": "label", "config": None}) == plugin
    assert build("reward", "ObservedPointsReward") == plugin
    assert build("reward", "safe_inspect.rewards.inspection.ObservedPointsReward") == plugin
    assert build("reward", plugin) is plugin


@pytest.mark.parametrize(
    ("kind", "key"),
    [
        ("reward", "functor"),
        ("part", "part"),
        ("parameter", "type"),
        ("simulator", "type"),
        ("platform", "platform_class"),
    ],
)
def test_the_key_of_the_name_is_that_of_the_grammar(kind: str, key: str) -> None:
    assert name_key(kind) == key
    assert name_key(kind, ("functor",)) == "functor"
    assert name_key(kind, ("functor", key)) == key


def test_a_name_may_have_the_key_functor_in_every_kind() -> None:
    expected = build("parameter", {"type": "ConstantParameter", "config": {"value": 2.0}})
    assert build("parameter", {"functor": "ConstantParameter", "config": {"value": 2.0}}) == expected


@pytest.mark.parametrize(
    ("value", "path", "text"),
    [
        ({"functor": "ObservedPointReward"}, ("functor",), "did you mean `ObservedPointsReward`"),
        ({"functr": "ObservedPointsReward"}, ("functr",), "did you mean `functor`"),
        ({"config": {}}, (), "needs the key `functor`"),
        ({"functor": 3}, ("functor",), "must be a string, not 3"),
        ({"functor": "ObservedPointsReward", "config": [1]}, ("config",), "must be a mapping of the reward's fields"),
        ({"functor": "ObservedPointsReward", "config": {"scael": 1}}, ("config", "scael"), "did you mean `scale`"),
        ({"functor": "ObservedPointsReward", "config": {"scale": "x"}}, ("config", "scale"), "valid number"),
        ({"functor": "ObservedPointsReward", "wrapped": []}, ("wrapped",), "takes no `wrapped`"),
        ([1, 2], (), "a reward must be a mapping with the key `functor`"),
        (None, (), "a reward must be a mapping"),
        (UniformParameter(), (), "expected a reward, got the parameter UniformParameter"),
    ],
)
def test_every_mistake_has_its_path(value: Any, path: tuple[Any, ...], text: str) -> None:
    found = mistakes("reward", value)
    assert text in found[path]


def test_all_mistakes_of_a_functor_are_reported_together() -> None:
    value = {"functor": "ObservedPointsReward", "nam": "x", "config": {"scale": "x", "scael": 1}, "wrapped": {}}
    assert set(mistakes("reward", value)) == {("nam",), ("config", "scale"), ("config", "scael"), ("wrapped",)}


class TestNesting:
    def test_parameters_in_a_sampler_in_a_mapping(self) -> None:
        names = CWH3DRadialWithSunInitializer.parameters
        value = {
            "type": "RejectionSampler",
            "config": {"initializer": {"functor": "CWH3DRadialWithSunInitializer"}},
            "wrapped": {name: uniform(0.0, 1.0) for name in names},
        }
        built = build("parameter", value)
        assert built.wrapped["radius"] == UniformParameter()
        wrong = {**value, "wrapped": {**value["wrapped"], "radius": uniform(1.0, "x"), "sun_angle": {"type": "Unifrm"}}}
        found = mistakes("parameter", wrong)
        assert "valid number" in found["wrapped", "radius", "config", "high"]
        assert ("wrapped", "sun_angle", "type") in found

    def test_glues_in_a_glue_in_a_list(self) -> None:
        glue = {"functor": "ControllerGlue", "config": {"controller": "X Thrust"}}
        built = build("glue", {"functor": "RTAGlueCWHInspection1v1", "wrapped": [glue, glue]})
        assert built == RTAGlueCWHInspection1v1(wrapped=(ControllerGlue(controller="X Thrust"),) * 2)
        wrong = {"functor": "ControllerGlue", "config": {"controler": "X Thrust"}}
        found = mistakes("glue", {"functor": "RTAGlueCWHInspection1v1", "wrapped": [glue, wrong]})
        assert list(found) == [("wrapped", 1, "config", "controler")]
        assert "did you mean `controller`" in found["wrapped", 1, "config", "controler"]

    def test_two_levels(self) -> None:
        inner = {"functor": "RTAGlueCWHInspection1v1", "wrapped": [{"functor": "ControlerGlue"}]}
        found = mistakes("glue", {"functor": "RTAGlueCWHInspection1v1", "wrapped": [inner]})
        assert list(found) == [("wrapped", 0, "wrapped", 0, "functor")]


def test_description_survives_yaml() -> None:
    wrapped = {name: uniform(0.0, 2.0, name="label") for name in CWH3DRadialWithSunInitializer.parameters}
    wrapped["radius"] = uniform(50, 100, units="m")
    plugins = [
        build("reward", {"functor": "ObservedPointsReward", "config": {"scale": 0.25}}),
        RTAGlueCWHInspection1v1(wrapped=(ControllerGlue(controller="X Thrust"),), r_max="0.9 km"),
        build("parameter", {"type": "TruncatedNormalParameter", "config": {"low": -1.0}}),
        build(
            "parameter",
            {
                "type": "RejectionSampler",
                "config": {"initializer": "CWH3DRadialWithSunInitializer"},
                "wrapped": wrapped,
            },
        ),
    ]
    for plugin in plugins:
        mapping = yaml.safe_load(yaml.safe_dump(describe(plugin)))
        assert mapping[name_key(plugin.kind)] == plugin.registered_name
        assert build(plugin.kind, mapping) == plugin


def test_a_field_writes_the_mapping_that_it_reads() -> None:
    class Holder(BaseModel):
        item: functor_field("reward")  # type: ignore[valid-type]

    holder = Holder(item={"functor": "ObservedPointsReward", "config": {"scale": 2.0}})
    written = holder.model_dump(mode="json")
    assert written["item"]["functor"] == "ObservedPointsReward"
    assert Holder(**written) == holder


def test_build_itself_raises_with_every_problem() -> None:
    with pytest.raises(PydanticCustomError) as caught:
        build("reward", {"functor": "Nothing", "extra": 1})
    assert len(caught.value.context["errors"]) == 2


class _Ends(Reward):
    """Its author's check of the fields raises what no check should."""

    how: str

    def model_post_init(self, context: Any, /) -> None:
        raise {"exit": SystemExit(3), "key": KeyError("x")}[self.how]

    def __call__(self, step: Any) -> Any:
        raise NotImplementedError


@pytest.mark.parametrize(("how", "what"), [("exit", "SystemExit: 3"), ("key", "KeyError: 'x'")])
def test_a_plugin_that_fails_or_ends_the_program_when_it_is_made_is_named(how: str, what: str) -> None:
    found = mistakes("reward", {"functor": f"{__name__}._Ends", "config": {"how": how}})
    assert f"cannot be built: {__file__}:" in found[()]
    assert found[()].endswith(what)
