from __future__ import annotations

from typing import ClassVar

import pytest
from pydantic import Field, ValidationError

from safe_inspect.glues.observations import ObserveSensor
from safe_inspect.plugins import DoneName, EntityName, Plugin, SensorName
from safe_inspect.plugins.registry import registry
from safe_inspect.rewards import Reward
from safe_inspect.rewards.inspection import ObservedPointsReward

pytestmark = pytest.mark.usefixtures("clean_registry")


def test_a_plugin_is_frozen_and_refuses_unknown_keys_and_wrong_types() -> None:
    reward = ObservedPointsReward(scale=0.5)
    with pytest.raises(ValidationError, match="frozen"):
        reward.scale = 1.0
    with pytest.raises(ValidationError, match="Extra inputs"):
        ObservedPointsReward(scael=0.5)
    with pytest.raises(ValidationError, match="valid number"):
        ObservedPointsReward(scale="much")


def test_defaults_are_checked() -> None:
    class OddReward(Reward):
        scale: float = Field(default=-1.0, ge=0)

        def __call__(self, step):
            return self.scale

    with pytest.raises(ValidationError):
        OddReward()


def test_a_method_takes_what_it_is_called_with() -> None:
    with pytest.raises(TypeError, match=r"Sparse\.__call__ cannot be called as \(self, step\): too many positional"):

        class Sparse(Reward):
            def __call__(self):
                return 1.0

    with pytest.raises(TypeError, match=r"Greedy\.row cannot be called as \(self, world, group\): missing a required"):

        class Greedy(Reward):
            def row(self, world, group, more):
                return None

            def __call__(self, step):
                return 1.0

    class Wide(Reward):
        def __call__(self, step, share=1.0, *rest):
            return share

    assert Wide()(None) == 1.0


def test_a_concrete_plugin_is_final() -> None:
    with pytest.raises(TypeError, match="ObservedPointsReward, which is final"):

        class DearReward(ObservedPointsReward):
            price: float = 1.0


def test_an_abstract_class_is_not_registered() -> None:
    class ScaledReward(Reward):
        scale: float = 1.0

    class HalfReward(ScaledReward):
        def __call__(self, step):
            return self.scale / 2.0

    names = dict(registry.items("reward"))
    assert "ScaledReward" not in names
    assert names["HalfReward"] is HalfReward
    assert HalfReward.registered_name == "HalfReward"


def test_a_kind_without_a_name_is_not_registered() -> None:
    class Kindless(Plugin):
        def __call__(self):
            return 0

    assert Kindless.registered_name == ""
    assert all("Kindless" not in dict(registry.items(kind)) for kind in registry.kinds())


def test_references_are_found_also_where_a_field_may_be_none() -> None:
    class NamingReward(Reward):
        sensor: SensorName = "a"
        other: SensorName | None = None
        body: EntityName = "chief"
        done: DoneName | None = None
        scale: float = 1.0

        def __call__(self, step):
            return self.scale

    expected = {"sensor": "sensor", "other": "sensor", "body": "entity", "done": "done"}
    assert NamingReward.references() == expected
    assert ObserveSensor.references() == {"sensor": "sensor"}


def test_the_kind_of_a_base_is_that_of_its_plugins() -> None:
    class KindReward(Reward):
        extra: ClassVar[int] = 1

        def __call__(self, step):
            return 0.0

    assert KindReward.kind == "reward"
    assert "extra" not in KindReward.model_fields
