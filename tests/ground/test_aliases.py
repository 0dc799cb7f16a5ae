from __future__ import annotations

import pytest

from safe_inspect.config.models.compat import Provider
from safe_inspect.config.models.experiment import (
    AgentConfig,
    EntityConfig,
    PlatformConfig,
    TaskBody,
    TaskConfig,
)
from safe_inspect.platforms.controllers import RateController
from safe_inspect.plugins.aliases import ALIASES
from safe_inspect.plugins.registry import registry

#: Names of the grammar that do not mean a plugin, each with the check of the model that takes it.
_GRAMMAR = {
    "TrainableBaseAgent": lambda name: AgentConfig.__pydantic_validator__.validate_assignment(
        AgentConfig.model_construct(), "agent", name
    ),
    "SimpleParameterProvider": lambda name: Provider(type=name),
    "RllibExperiment": lambda name: TaskConfig.__pydantic_validator__.validate_assignment(
        TaskConfig.model_construct(), "experiment_class", name
    ),
    "InspectionCallbacks": lambda name: TaskBody.__pydantic_validator__.validate_assignment(
        TaskBody.model_construct(), "extra_callbacks", [name]
    ),
    "Sun": lambda name: EntityConfig(entity_class=name),
    "CWHPlatform": lambda name: PlatformConfig(platform=name),
    "ThrustProp": lambda name: RateController(property_class=name),
    "MomentProp": lambda name: RateController(axis=3, property_class=name),
}
#: Classes that have another name here.
_RENAMED = {"SunEntity": "Sun"}


@pytest.mark.parametrize("alias", sorted(ALIASES))
def test_alias_means_a_plugin_or_a_name_of_the_grammar(alias: str) -> None:
    name = ALIASES[alias]
    kinds = [kind for kind in registry.kinds() if name in dict(registry.items(kind))]
    if name in _GRAMMAR:
        _GRAMMAR[name](alias)
    else:
        assert len(kinds) == 1, name
        assert registry.get(kinds[0], alias).registered_name == name


@pytest.mark.parametrize("alias", sorted(ALIASES))
def test_alias_is_a_dotted_path_whose_class_keeps_its_name(alias: str) -> None:
    peers = ("corl", "safe_autonomy_sims", "safe_autonomy_simulation", "safe_autonomy_dynamics")
    assert alias.split(".")[0] in peers
    name = alias.rpartition(".")[2]
    assert _RENAMED.get(name, name) == ALIASES[alias]
