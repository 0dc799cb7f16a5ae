"""Keys of safe-autonomy-sims that have no effect here: they are only checked.

Each class contains those of one model of `safe_inspect.config.models.experiment`, which extends it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, field_validator

from safe_inspect.errors import did_you_mean
from safe_inspect.platforms.base import Platform
from safe_inspect.plugins.aliases import ALIASES
from safe_inspect.plugins.registry import registry


def _one_of(*names: str) -> Any:
    """Return a field type for a class name of which this package supports only some; aliases are accepted."""

    def check(value: str) -> str:
        name = ALIASES.get(value, value)
        if name.rpartition(".")[2] not in names and name not in names:
            raise ValueError(f"unknown class {value!r}; {did_you_mean(name.rpartition('.')[2], names)}")
        return name.rpartition(".")[2]

    return Annotated[str, AfterValidator(check)]


class Provider(BaseModel):
    """The source of episode parameters in safe-autonomy-sims; here all parameters are sampled at every reset."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    type: _one_of("SimpleParameterProvider") = "SimpleParameterProvider"  # type: ignore[valid-type]


class EnvironmentKeys(BaseModel):
    """Keys of ``environment.yml``: the name of the set of platforms, and the source of episode parameters."""

    platforms: _one_of("CWHSimulator_Platforms") = "CWHSimulator_Platforms"  # type: ignore[valid-type]
    episode_parameter_provider: Provider = Provider()


class ResetKeys(BaseModel):
    """Keys of ``simulator_reset_parameters`` of an environment: an initialiser, which those of the agents replace."""

    initializer: Any = None

    @field_validator("initializer")
    @classmethod
    def _is_known(cls, value: Any) -> Any:
        name = value.get("functor") if isinstance(value, Mapping) else value
        if name is not None:
            registry.get("initializer", str(name))
        return value


def platform_class(name: str) -> type[Platform]:
    """Return the platform class of a name: its short name, such as `cwh`, its registered name or a dotted path.

    Raises:
        RegistryError: There is no such platform.
    """
    for _, cls in registry.items("platform"):
        if name and cls.short_name == name:
            return cls  # type: ignore[no-any-return]
    return registry.get("platform", name)


def _known_platform(name: str) -> str:
    platform_class(name)
    return name


#: Field type of the name of a platform.
KnownPlatform = Annotated[str, AfterValidator(_known_platform)]


class PlatformKeys(BaseModel):
    """Keys of ``platform.yml``: a label, and the name of the platform's class."""

    name: str = ""
    platform: KnownPlatform = "cwh"

    @property
    def functor(self) -> type[Platform]:
        """The class of the platform."""
        return platform_class(self.platform)


class AgentBodyKeys(BaseModel):
    """Keys of the body of ``agent.yml``: the source of episode parameters."""

    episode_parameter_provider: Provider = Provider()


class AgentKeys(BaseModel):
    """Keys of ``agent.yml``: the agent's class."""

    agent: _one_of("TrainableBaseAgent") = "TrainableBaseAgent"  # type: ignore[valid-type]


class TaskBodyKeys(BaseModel):
    """Keys of the body of ``task.yml``: callbacks, the choice of a computer, and ``_updates``, with anchors."""

    auto_system_detect_class: Any = None

    extra_callbacks: tuple[_one_of("InspectionCallbacks"), ...] = ()  # type: ignore[valid-type]
    rllib_config_updates: dict[str, Any] | None = None
    ray_config_updates: dict[str, Any] | None = None
    env_config_updates: dict[str, Any] | None = None
    tune_config_updates: dict[str, Any] | None = None


class TaskKeys(BaseModel):
    """Keys of ``task.yml``: the experiment's class, and the choice of a computer."""

    auto_system_detect_class: Any = None
    experiment_class: _one_of("RllibExperiment") = "RllibExperiment"  # type: ignore[valid-type]
