"""The models of an experiment's files: environment, platform, agent, policy, task and experiment.

They hold the peer's grammar; what they contain is built by the plugins' own validation.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from safe_inspect.aliases import ALIASES
from safe_inspect.config.fields_of_functors import ParameterField, named_field
from safe_inspect.errors import did_you_mean
from safe_inspect.functor import functor_field
from safe_inspect.units import PositiveFrequency


class Model(BaseModel):
    """Base of the models: frozen, unknown keys forbidden."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)


def _one_of(*names: str) -> Any:
    """Return a field type for a class that the grammar names and this package has one of; aliases count."""

    def check(value: str) -> str:
        name = ALIASES.get(value, value)
        if name.rpartition(".")[2] not in names and name not in names:
            raise ValueError(f"{value!r} is not known here; {did_you_mean(name.rpartition('.')[2], names)}")
        return name.rpartition(".")[2]

    return Annotated[str, AfterValidator(check)]


class Provider(Model):
    """The peer's source of episode parameters; reset parameters are drawn afresh at every reset."""

    type: _one_of("SimpleParameterProvider") = "SimpleParameterProvider"  # type: ignore[valid-type]


class EntityConfig(Model):
    """A body beside the deputies, or the sun.

    Attributes:
        platform: ``cwh``: a body that coasts in Clohessy-Wiltshire dynamics.
        entity_class: ``Sun``.
        initializer: Initialiser of a body.
        config: Parameters of the initialiser; ``theta`` of the sun [rad].
    """

    platform: _one_of("cwh") | None = None  # type: ignore[valid-type]
    entity_class: _one_of("Sun") | None = None  # type: ignore[valid-type]
    initializer: functor_field("initializer") | None = None  # type: ignore[valid-type]
    config: dict[str, ParameterField] = Field(default_factory=dict)  # type: ignore[valid-type]


class ResetParameters(Model):
    """What is drawn at a reset: named parameters, and the bodies beside the deputies."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, ParameterField]  # type: ignore[valid-type]

    additional_entities: dict[str, EntityConfig] = Field(default_factory=dict)


class SharedDones(Model):
    """Done functions that concern all agents."""

    shared: tuple[named_field("done"), ...] = ()  # type: ignore[valid-type]


class EnvironmentConfig(Model):
    """``environment.yml``.

    Attributes:
        horizon: Largest number of steps of an episode; 1224 (two orbits) unless the RLlib configuration gives it.
        simulator: The simulator.
        simulator_reset_parameters: What is drawn at a reset.
        platforms: Name of the peer's set of platforms.
        plugin_paths: Modules with further plugins, imported before any name is looked up.
        episode_parameter_provider: The peer's source of episode parameters.
        dones: Done functions that concern all agents.
        TrialName: Name of the run's folder.
        output_path: Folder in which run folders are made.
    """

    horizon: int | None = Field(default=None, ge=1)
    simulator: functor_field("simulator")  # type: ignore[valid-type]
    simulator_reset_parameters: ResetParameters = ResetParameters()
    platforms: _one_of("CWHSimulator_Platforms") = "CWHSimulator_Platforms"  # type: ignore[valid-type]
    plugin_paths: tuple[str, ...] = ()
    episode_parameter_provider: Provider = Provider()
    dones: SharedDones = SharedDones()
    TrialName: str = Field(default="experiment", min_length=1, pattern=r"^[\w.-]+$")
    output_path: str = "output"


class PlatformConfig(Model):
    """``platform.yml``: ``name`` is a label, ``platform`` is ``cwh``, ``config`` holds the platform's fields."""

    name: str = ""
    platform: _one_of("cwh", "CWHPlatform") = "cwh"  # type: ignore[valid-type]
    config: dict[str, Any] = Field(default_factory=dict)


class AgentReset(Model):
    """Initial state of the agent's platform: an initialiser and its parameters."""

    initializer: functor_field("initializer")  # type: ignore[valid-type]
    config: dict[str, ParameterField] = Field(default_factory=dict)  # type: ignore[valid-type]


class AgentBody(Model):
    """What an agent is made of; see `AgentConfig`."""

    frame_rate: PositiveFrequency = 0.1
    parts: tuple[functor_field("part"), ...]  # type: ignore[valid-type]
    episode_parameter_provider: Provider = Provider()
    simulator_reset_parameters: AgentReset
    glues: tuple[functor_field("glue"), ...]  # type: ignore[valid-type]
    dones: tuple[named_field("done"), ...] = ()  # type: ignore[valid-type]
    rewards: tuple[named_field("reward"), ...] = ()  # type: ignore[valid-type]
    reference_store: dict[str, Any] = Field(default_factory=dict)


class AgentConfig(Model):
    """``agent.yml``: the agent's class, and its parts, glues, rewards and dones."""

    agent: _one_of("TrainableBaseAgent") = "TrainableBaseAgent"  # type: ignore[valid-type]
    config: AgentBody


class PolicyConfig(Model):
    """``ppo.yml``: the learning algorithm, and what it is configured with beside the task's RLlib configuration.

    Attributes:
        algorithm: Name of an RLlib algorithm.
        config: RLlib keys, merged over the task's.
    """

    algorithm: str = Field(default="PPO", min_length=1)
    config: dict[str, Any] = Field(default_factory=dict)


class PlatformEntry(Model):
    """A platform of the experiment."""

    name: str = Field(min_length=1)
    config: PlatformConfig = PlatformConfig()


class AgentEntry(Model):
    """An agent of the experiment: the platforms that it controls, its configuration and its policy."""

    name: str = Field(min_length=1)
    platforms: tuple[str, ...]
    config: AgentConfig
    policy: PolicyConfig = PolicyConfig()


class TaskBody(Model):
    """The task's configurations, lists of mappings already merged; see `TaskConfig`."""

    rllib_configs: dict[str, dict[str, Any]] = Field(default_factory=dict)
    ray_config: dict[str, Any] = Field(default_factory=dict)
    env_config: EnvironmentConfig
    tune_config: dict[str, Any] = Field(default_factory=dict)
    extra_callbacks: tuple[_one_of("InspectionCallbacks"), ...] = ()  # type: ignore[valid-type]
    rllib_config_updates: dict[str, Any] | None = None
    ray_config_updates: dict[str, Any] | None = None
    env_config_updates: dict[str, Any] | None = None
    tune_config_updates: dict[str, Any] | None = None


class TaskConfig(Model):
    """``task.yml``: RLlib, Ray, the environment and Tune. Keys that end in ``_updates`` only hold anchors."""

    experiment_class: _one_of("RllibExperiment") = "RllibExperiment"  # type: ignore[valid-type]
    config: TaskBody


class ExperimentConfig(Model):
    """``experiment.yml``: the task, the platforms and the agents."""

    config: TaskConfig
    platform_config: tuple[PlatformEntry, ...]
    agent_config: tuple[AgentEntry, ...]
