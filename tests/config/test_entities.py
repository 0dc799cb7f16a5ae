"""Bodies and components of an experiment, by what their classes declare."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import build_experiment, load_experiment
from safe_inspect.environments import BatchedEnvironment
from safe_inspect.errors import ConfigError
from safe_inspect.simulators.component import Component, EntityParameter, RunningComponent
from safe_inspect.types import ArraySpec


class RunningTide(RunningComponent):
    arrays = {"tide": ArraySpec(())}  # noqa: RUF012 - never written

    def reset(self, state, values):
        state["tide"][:] = values["tide_height"]


def tree(entities: dict[str, Any], **fields: Any) -> dict[str, Any]:
    resolved = load_experiment(configs_root() / "docking" / "experiment.yml").resolved
    environment = resolved["config"]["config"]["env_config"]
    environment["simulator"] = {"type": "ComposedSimulator", "config": {"components": [fields or "Tide"]}}
    environment["simulator_reset_parameters"]["additional_entities"] |= entities
    return resolved


@pytest.fixture(autouse=True)
def tide(clean_registry):
    class Tide(Component):
        """A tide."""

        entity: ClassVar = {"height": EntityParameter("m", "tide_height", "tide")}

        def __call__(self, world, num_envs):
            return RunningTide()

    return Tide


UNIFORM = {"type": "UniformParameter", "config": {"units": "km", "low": 1, "high": 2}}


def test_a_component_takes_the_parameters_that_it_declares():
    spec = build_experiment(tree({"sea": {"entity_class": "Tide", "config": {"height": UNIFORM}}})).spec
    environment = BatchedEnvironment(spec, 8)
    environment.reset()
    heights = environment.state["tide"]
    assert len(np.unique(heights)) == 8
    assert (np.abs(heights - 1500.0) <= 500.0).all()


@pytest.mark.parametrize(
    ("entities", "words"),
    [
        ({"sea": {"entity_class": "Tide"}}, "a Tide needs `height`"),
        ({"sea": {"entity_class": "Tide", "config": {"height": 1, "depth": 2}}}, "a Tide takes only `height`"),
        ({"sea": {"entity_class": "Tide", "platform": "cwh", "config": {"height": 1}}}, "takes no `platform`"),
        ({name: {"entity_class": "Tide", "config": {"height": 1}} for name in "ab"}, "there is more than one Tide"),
        ({"sea": {"entity_class": "Tied"}}, "did you mean `Tide`"),
        ({"sea": {"entity_class": "InspectionPoints"}}, "is not a component with reset parameters"),
        ({"moon": {"platform": "six-dof"}}, "a body in addition to the deputies must be a point"),
    ],
)
def test_what_does_not_fit_is_named(entities, words):
    with pytest.raises(ConfigError, match=words):
        build_experiment(tree(entities))


def test_a_body_that_a_component_lacks_stands_where_it_is_named():
    points = {"functor": "InspectionPoints", "config": {"inspection_points_map": {"chef": {}}}}
    with pytest.raises(ConfigError, match=r"simulator: there is no body 'chef'; did you mean `chief`"):
        build_experiment(tree({}, **points))


def test_a_filter_keeps_out_of_the_radius_that_a_component_gives():
    config = configs_root() / "translational-inspection" / "experiment-seed.yml"
    resolved = load_experiment(config, ["RTAGlueCWHInspection1v1.config.enabled=True"]).resolved
    points = {"functor": "InspectionPoints", "config": {"inspection_points_map": {"chief": {"radius": 20}}}}
    simulator = {"type": "ComposedSimulator", "config": {"components": ["Sun", points, "FuelPriceSchedule"]}}
    resolved["config"]["config"]["env_config"]["simulator"] = simulator
    with pytest.raises(ConfigError, match="inside the sphere of 'chief'"):
        build_experiment(resolved)
