"""Construction of an `EnvironmentSpec` from validated models, with the checks that involve several parts of them."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import ValidationError

from safe_inspect.config.building.agents import AgentSetting, build_agent, check_unique
from safe_inspect.config.building.guarantees import check_guarantees, check_thrusters
from safe_inspect.config.building.resets import reset_plan
from safe_inspect.config.building.team import check_agents, safe_initial_states
from safe_inspect.config.building.world import check_world, common_world, in_world, reset_in_world, worlds_of
from safe_inspect.config.loading.located import Place
from safe_inspect.config.models import ENVIRONMENT_PATH, ExperimentConfig
from safe_inspect.config.report import text_of
from safe_inspect.config.spec import EnvironmentSpec, world_names
from safe_inspect.errors import did_you_mean
from safe_inspect.platforms.base import Platform
from safe_inspect.simulators.simulator import Simulator


def assemble(config: ExperimentConfig, horizon: int, root: Place, *, seed: int) -> EnvironmentSpec | None:
    """Return the specification of an experiment's environment.

    Args:
        config: The validated models.
        horizon: Largest number of steps of an episode.
        root: Position of the whole configuration.
        seed: Seed of the run.

    Returns:
        The specification, or None if there were mistakes.
    """
    before = len(root.problems)
    place = root.at(*ENVIRONMENT_PATH)
    platforms = _platforms(config, root.at("platform_config"))
    config = _with_attitude(config, root)
    reset = reset_plan(config, root)
    environment = config.environment
    names = world_names(platforms, reset, environment.simulator)
    _check_bodies(environment.simulator, names, place.at("simulator"))
    _check_controlled(config, platforms, root.at("platform_config"))
    worlds = worlds_of(config, platforms)
    setting = AgentSetting(platforms, names, environment.simulator, horizon)
    built = [
        build_agent(entry, root.at("agent_config", index), worlds[index], setting)
        for index, entry in enumerate(config.agent_config)
    ]
    agents = [agent for agent in built if agent is not None]
    check_agents(config, agents, root)
    check_world(config, reset, worlds, root)
    if len(root.problems) == before:  # this check needs the results of the others
        check_guarantees(config, worlds, reset, root)
    common = common_world(worlds)
    reset = reset_in_world(reset, common, place)
    if environment.rta is not None:
        environment = environment.model_copy(update={"rta": in_world(environment.rta, common, place.at("rta"))})
    if len(root.problems) == before:  # this check computes plans, which is expensive
        check_thrusters(agents, environment.rta, root)
    if len(root.problems) > before:
        return None
    return EnvironmentSpec(
        environment.simulator,
        {agent.platform: platforms[agent.platform] for agent in agents},
        tuple(agents),
        safe_initial_states(reset, agents, environment),
        1.0 / config.agent_config[0].body.frame_rate,
        seed,
        shared_dones=environment.dones.shared,
        team_safety=environment.rta,
        ended_thrust_on=environment.ended_deputies == "hold_thrust",
    )


def _with_attitude(config: ExperimentConfig, root: Place) -> ExperimentConfig:
    """Return the experiment with a simulator with attitude dynamics, if its platforms have an attitude."""
    turning = [entry.config.functor.turns for entry in config.platform_config]
    simulator, place = config.environment.simulator, root.at(*ENVIRONMENT_PATH, "simulator")
    if not any(turning):
        field = simulator.attitude_field
        if field and not simulator.turns:
            text = f"`{field}` needs platforms with attitude; use `platform: six-dof`, or remove it"
            place.report(text, "config", field)
        return config
    for index, entry in enumerate(config.platform_config):
        if not turning[index]:
            message = f"{entry.name} has no attitude but others do; use `platform: six-dof` for all of them or for none"
            root.report(message, "platform_config", index, "config", "platform")
    try:
        made = simulator.with_attitude()
    except ValueError as error:
        place.report(str(error))
        return config
    task = config.config.config
    environment = task.env_config.model_copy(update={"simulator": made})
    body = task.model_copy(update={"env_config": environment})
    return config.model_copy(update={"config": config.config.model_copy(update={"config": body})})


def _platforms(config: ExperimentConfig, entries: Place) -> dict[str, Platform]:
    platforms: dict[str, Platform] = {}
    check_unique("platforms", (entry.name for entry in config.platform_config), entries)
    for index, entry in enumerate(config.platform_config):
        cls = entry.config.functor
        try:
            platforms[entry.name] = cls.model_validate(entry.config.config)
        except ValidationError as error:
            platforms[entry.name] = cls.model_construct()  # so that the name is known
            for problem in error.errors(include_url=False):
                text, key = text_of(problem), str(problem["loc"][-1])
                if problem["type"] == "extra_forbidden":
                    text = f"unknown key `{key}`; {did_you_mean(key, cls.model_fields)}"
                entries.report(text, index, "config", "config", *problem["loc"])
    return platforms


def _check_bodies(simulator: Simulator, names: dict[str, set[str]], place: Place) -> None:
    """Check that the bodies of components exist; mistakes are reported at the simulator's key for the component."""
    for name in (body for component in simulator.compose()[1] for body in component.bodies):
        if name not in names["entity"]:
            given = {field: getattr(simulator, field) for field in type(simulator).model_fields}
            fields = [field for field, value in given.items() if isinstance(value, Mapping) and name in value]
            where = place.at("config", fields[0], name) if fields else place
            where.report(f"there is no body {name!r}; {did_you_mean(name, names['entity'])}")
            names["points"] |= names["entity"]  # so that correct names are not reported


def _check_controlled(config: ExperimentConfig, platforms: Mapping[str, Platform], entries: Place) -> None:
    controlled = {name for agent in config.agent_config for name in agent.platforms}
    if controlled and controlled <= set(platforms):
        for index, platform in enumerate(config.platform_config):
            if platform.name not in controlled:
                entries.report(f"no agent controls the platform {platform.name!r}; remove it", index)
