"""The models of an experiment's files: environment, platform, agent, policy, task and experiment.

Plugins in them are built by the plugins' own validation. Some keys of safe-autonomy-sims have no effect here and are
only checked; they are the first fields of their models, under a comment.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, InstanceOf, WithJsonSchema, model_validator

from safe_inspect.dones.base import DoneFunction
from safe_inspect.dones.limits import MAX_HORIZON
from safe_inspect.dones.shared import SharedDoneFunction
from safe_inspect.errors import RegistryError, did_you_mean
from safe_inspect.platforms.base import Platform
from safe_inspect.plugins.functor import SCHEMA_KIND, Named, build, functor_field
from safe_inspect.plugins.plugin import Plugin, StrictNumbers
from safe_inspect.plugins.registry import own_name, registry
from safe_inspect.rewards.base import Reward
from safe_inspect.simulators.component import Component
from safe_inspect.simulators.resets.parameters import ConstantParameter
from safe_inspect.units import PositiveFrequency


def _named_field(base: type[Plugin], otherwise: str = "") -> Any:
    """Return a field type for ``{name: ..., functor: ..., config: {...}}``: the plugin with its name.

    The default name is the registered name of the plugin.

    Args:
        base: Base class of the plugins.
        otherwise: What to write for a plugin of the same kind with another base class.
    """
    kind = base.kind

    def convert(value: Any) -> Named[Plugin]:
        if isinstance(value, Named):
            return value
        plugin = build(kind, value)
        if not isinstance(plugin, base):
            raise ValueError(f"{plugin.registered_name} {otherwise}")
        name = value.get("name") if isinstance(value, Mapping) else None
        return Named(str(name) if name else plugin.registered_name, plugin)

    return Annotated[
        InstanceOf[Named[Any]], BeforeValidator(convert), WithJsonSchema({"type": "object", SCHEMA_KIND: kind})
    ]


_FOR_ALL = "is for all agents together; give it in `dones: {shared: [...]}` of the environment"


def _one_of(*names: str) -> Any:
    """Return a field type for a class name of which only some are supported; a module before it has no effect."""

    def check(value: str) -> str:
        name = value.rpartition(".")[2]
        if name not in names:
            raise ValueError(f"unknown class {value!r}; {did_you_mean(name, names)}")
        return name

    return Annotated[str, AfterValidator(check)]


def _number(value: Any) -> Any:
    """Return a constant parameter for a plain number; other values are unchanged."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return ConstantParameter(value=value)
    return value


#: Field type of a reset parameter; a plain number is a constant.
ParameterField: Any = Annotated[
    functor_field("parameter"),
    BeforeValidator(_number),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "object", SCHEMA_KIND: "parameter"}]}),
]


#: Path of the environment in an experiment.
ENVIRONMENT_PATH = ("config", "config", "env_config")


class Model(StrictNumbers):
    """Base of the models: frozen, with unknown keys forbidden."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)


class Provider(Model):
    """The source of episode parameters in safe-autonomy-sims; here all parameters are sampled at every reset."""

    type: _one_of("SimpleParameterProvider") = "SimpleParameterProvider"  # type: ignore[valid-type]


def _platform_class(name: str) -> type[Platform]:
    """Return the platform class of a name: its short name, such as `cwh`, its registered name or a dotted path.

    Raises:
        RegistryError: There is no such platform.
    """
    for _, cls in registry.items("platform"):
        if name and cls.short_name == name:
            return cls  # type: ignore[no-any-return]
    return registry.get("platform", name)


def _known_platform(name: str) -> str:
    _platform_class(name)
    return name


def _is_a_point(name: str) -> str:
    if _platform_class(name).turns:
        raise ValueError(f"{name!r} has an attitude; a body in addition to the deputies must be a point")
    return name


def _has_an_entity(name: str) -> str:
    known = [other for other, cls in registry.items("component") if cls.entity]
    name = own_name(name)
    try:
        cls = registry.get("component", name)
    except RegistryError:
        cls = Component
    if not cls.entity:
        raise ValueError(f"{name!r} is not a component with reset parameters; {did_you_mean(name, known)}")
    return str(cls.registered_name)


class EntityConfig(Model):
    """A coasting body in addition to the deputies, or the parameters of a component.

    Attributes:
        platform: Name of a platform without attitude.
        entity_class: Name of a component with the field `entity`, such as ``Sun``.
        initializer: Initialiser of a body. Default for a body with a `platform`: `PositionVelocityInitializer`.
        config: Parameters of the initialiser or of the component.
    """

    platform: Annotated[str, AfterValidator(_is_a_point)] | None = None
    entity_class: Annotated[str, AfterValidator(_has_an_entity)] | None = None
    initializer: functor_field("initializer") | None = None  # type: ignore[valid-type]
    config: dict[str, ParameterField] = Field(default_factory=dict)  # type: ignore[valid-type]


def _known_initializer(value: Any) -> Any:
    name = value.get("functor") if isinstance(value, Mapping) else value
    if name is not None:
        registry.get("initializer", str(name))
    return value


class ResetParameters(Model):
    """Distributions that are sampled at a reset: named parameters, and the bodies in addition to the deputies."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, ParameterField]  # type: ignore[valid-type]

    # of safe-autonomy-sims; the initialisers of the agents replace it
    initializer: Annotated[Any, AfterValidator(_known_initializer)] = None

    additional_entities: dict[str, EntityConfig] = Field(default_factory=dict)


class SharedDones(Model):
    """Done functions of all agents together."""

    shared: tuple[_named_field(SharedDoneFunction, "is for one agent; give it in an agent's `dones`"), ...] = ()  # type: ignore[valid-type]


class EnvironmentConfig(Model):
    """``environment.yml``.

    Attributes:
        horizon: Largest number of steps of an episode. Default: that of the RLlib configuration, or 1224 (two orbits).
        simulator: The simulator.
        simulator_reset_parameters: Distributions that are sampled at a reset.
        plugin_paths: Modules with additional plugins, which are imported before any name is looked up.
        dones: Done functions of all agents together.
        rta: Safety filter of all deputies together.
        ended_deputies: Behaviour of the spacecraft of an agent that has ended, until the episode ends for all:
            ``coast``, or ``hold_thrust`` as in safe-autonomy-sims.
        TrialName: Name of the run's folder.
        output_path: Folder in which run folders are created.
    """

    # of safe-autonomy-sims
    platforms: _one_of("CWHSimulator_Platforms") = "CWHSimulator_Platforms"  # type: ignore[valid-type]
    episode_parameter_provider: Provider = Provider()

    horizon: int | None = Field(default=None, ge=1, le=MAX_HORIZON)
    simulator: functor_field("simulator")  # type: ignore[valid-type]
    simulator_reset_parameters: ResetParameters = ResetParameters()
    plugin_paths: tuple[str, ...] = ()
    dones: SharedDones = SharedDones()
    rta: functor_field("rta") | None = None  # type: ignore[valid-type]
    ended_deputies: Literal["coast", "hold_thrust"] = "coast"
    TrialName: str = Field(default="experiment", min_length=1, pattern=r"^[\w.-]+$")
    output_path: str = "output"


class PlatformConfig(Model):
    """``platform.yml``: a label, the name of the platform's class, and in ``config`` the platform's fields."""

    name: str = ""
    platform: Annotated[str, AfterValidator(_known_platform)] = "cwh"
    config: dict[str, Any] = Field(default_factory=dict)

    @property
    def functor(self) -> type[Platform]:
        """The class of the platform."""
        return _platform_class(self.platform)


class AgentReset(Model):
    """Initial state of the agent's platform: an initialiser and its parameters."""

    initializer: functor_field("initializer")  # type: ignore[valid-type]
    config: dict[str, ParameterField] = Field(default_factory=dict)  # type: ignore[valid-type]


class AgentBody(Model):
    """Body of an agent's configuration; see `AgentConfig`."""

    # of safe-autonomy-sims
    episode_parameter_provider: Provider = Provider()

    frame_rate: PositiveFrequency = 0.1
    parts: tuple[functor_field("part"), ...]  # type: ignore[valid-type]
    simulator_reset_parameters: AgentReset
    glues: tuple[functor_field("glue"), ...]  # type: ignore[valid-type]
    dones: tuple[_named_field(DoneFunction, _FOR_ALL), ...] = ()  # type: ignore[valid-type]
    rewards: tuple[_named_field(Reward), ...] = ()  # type: ignore[valid-type]
    reference_store: dict[str, Any] = Field(default_factory=dict)


class AgentConfig(Model):
    """``agent.yml``: the agent's parts, glues, rewards and dones."""

    # of safe-autonomy-sims
    agent: _one_of("TrainableBaseAgent") = "TrainableBaseAgent"  # type: ignore[valid-type]

    config: AgentBody


class PolicyConfig(Model):
    """``ppo.yml``: the policy of an agent, which is an algorithm to train, a scripted policy, or a checkpoint.

    Attributes:
        algorithm: Name of the RLlib algorithm that trains the policy. Default: PPO, if there is no other policy.
        config: RLlib keys, which override the task's; or the fields of a scripted policy.
        functor: Name of a scripted policy, such as ZeroThrust.
        checkpoint: Folder of a checkpoint whose policy is used without training.
        policy: Name of the policy in that checkpoint, if it contains several.
    """

    algorithm: str = Field(default="", pattern=r"\S|^$")
    config: dict[str, Any] = Field(default_factory=dict)
    functor: str | None = None
    checkpoint: str | None = Field(default=None, min_length=1)
    policy: str | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> PolicyConfig:
        given = [key for key in ("algorithm", "functor", "checkpoint") if getattr(self, key)]
        if len(given) > 1:
            raise ValueError(f"`{given[0]}` and `{given[1]}` are mutually exclusive; remove one of them")
        if self.policy is not None and self.checkpoint is None:
            raise ValueError("`policy` needs a `checkpoint` that contains it; add one, or remove `policy`")
        if self.checkpoint is not None and self.config:
            raise ValueError("`config` has no effect on a checkpoint's policy; remove it")
        if self.functor is None and self.checkpoint is None and not self.algorithm:
            object.__setattr__(self, "algorithm", "PPO")
        return self


class PlatformEntry(Model):
    """A platform of the experiment."""

    name: str = Field(min_length=1)
    config: PlatformConfig = PlatformConfig()


class AgentEntry(Model):
    """An agent of the experiment, or with `count` the template of several; see `safe_inspect.config.loading.templates`.

    Attributes:
        name: Name of the agent; in a template ``#`` is replaced by the number of each agent.
        count: Number of agents that the template defines.
        platforms: The platform that the agent controls.
        config: Parts, glues, rewards and dones.
        policy: The agent's policy. Default: one trained with PPO; with several agents each must have one.
        policy_name: Agents with the same policy name share one policy. Default: the agent's name.
    """

    name: str = Field(min_length=1, pattern=r"^[^/\s]+$")
    count: int | None = None
    platforms: tuple[str, ...]
    config: AgentConfig
    policy: PolicyConfig | None = None
    policy_name: str | None = Field(default=None, pattern=r"^[\w.-]+$")

    @property
    def body(self) -> AgentBody:
        """Parts, glues, rewards and dones of the agent."""
        return self.config.config

    @property
    def flown_by(self) -> str:
        """Name of the agent's policy."""
        return self.policy_name or self.name


class TaskBody(Model):
    """The task's configurations, with lists of mappings already merged; see `TaskConfig`."""

    # of safe-autonomy-sims: callbacks, the choice of a computer, and `_updates`, with anchors
    auto_system_detect_class: Any = None
    extra_callbacks: tuple[_one_of("InspectionCallbacks"), ...] = ()  # type: ignore[valid-type]
    rllib_config_updates: dict[str, Any] | None = None
    ray_config_updates: dict[str, Any] | None = None
    env_config_updates: dict[str, Any] | None = None
    tune_config_updates: dict[str, Any] | None = None

    rllib_configs: dict[str, dict[str, Any]] = Field(default_factory=dict)
    ray_config: dict[str, Any] = Field(default_factory=dict)
    env_config: EnvironmentConfig
    tune_config: dict[str, Any] = Field(default_factory=dict)


class TaskConfig(Model):
    """``task.yml``: RLlib, Ray, the environment and Tune."""

    # of safe-autonomy-sims
    auto_system_detect_class: Any = None
    experiment_class: _one_of("RllibExperiment") = "RllibExperiment"  # type: ignore[valid-type]

    config: TaskBody


class ExperimentConfig(Model):
    """``experiment.yml``: the task, the platforms and the agents."""

    config: TaskConfig
    platform_config: tuple[PlatformEntry, ...]
    agent_config: tuple[AgentEntry, ...]

    @property
    def environment(self) -> EnvironmentConfig:
        """The environment of the task."""
        return self.config.config.env_config
