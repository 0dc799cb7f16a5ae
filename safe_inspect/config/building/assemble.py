"""Construction of an `EnvironmentSpec` from validated models, with the checks that involve several parts of them."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import ValidationError

from safe_inspect.config.building.agents import AgentSetting, build_agent
from safe_inspect.config.building.guarantees import check_guarantees, check_thrusters
from safe_inspect.config.building.resets import reset_plan
from safe_inspect.config.building.team import check_agents, safe_initial_states
from safe_inspect.config.building.world import check_world, common_world, in_world, reset_in_world, worlds_of
from safe_inspect.config.messages.report import ENVIRONMENT_PATH, KeyTuple, ReportProblem, text_of
from safe_inspect.config.models.experiment import ExperimentConfig
from safe_inspect.config.spec import EnvironmentSpec, world_names
from safe_inspect.errors import did_you_mean
from safe_inspect.platforms.base import Platform
from safe_inspect.simulators.simulator import Simulator


def assemble(config: ExperimentConfig, horizon: int, report: ReportProblem, *, seed: int) -> EnvironmentSpec | None:
    """Return the specification of an experiment's environment.

    Args:
        config: The validated models.
        horizon: Largest number of steps of an episode.
        report: Function that is called with the path and the message of every mistake.
        seed: Seed of the run.

    Returns:
        The specification, or None if there were mistakes.
    """
    mistakes = 0

    def note(where: KeyTuple, message: str) -> None:
        nonlocal mistakes
        mistakes += 1
        report(where, message)

    platforms = _platforms(config, note)
    config = _with_attitude(config, note)
    reset = reset_plan(config, note)
    environment = config.environment
    names = world_names(platforms, reset, environment.simulator)
    _check_bodies(environment.simulator, names, note)
    _check_controlled(config, platforms, note)
    worlds = worlds_of(config, platforms)
    setting = AgentSetting(platforms, names, environment.simulator, horizon, note)
    built = [
        build_agent(entry, ("agent_config", index), worlds[index], setting)
        for index, entry in enumerate(config.agent_config)
    ]
    agents = [agent for agent in built if agent is not None]
    check_agents(config, agents, note)
    check_world(config, reset, worlds, note)
    if not mistakes:  # this check needs the results of the others
        check_guarantees(config, worlds, reset, note)
    common = common_world(worlds)
    reset = reset_in_world(reset, common, note)
    if environment.rta is not None:
        where: KeyTuple = (*ENVIRONMENT_PATH, "rta")
        environment = environment.model_copy(update={"rta": in_world(environment.rta, common, where, note)})
    if not mistakes:  # this check computes plans, which is expensive
        check_thrusters(agents, environment.rta, note)
    if mistakes:
        return None
    frame_rate = config.agent_config[0].body.frame_rate
    return EnvironmentSpec(
        environment.simulator,
        {agent.platform: platforms[agent.platform] for agent in agents},
        tuple(agents),
        safe_initial_states(reset, agents, environment),
        1.0 / frame_rate,
        seed,
        shared_dones=environment.dones.shared,
        team_safety=environment.rta,
        ended_thrust_on=environment.ended_deputies == "hold_thrust",
    )


def _with_attitude(config: ExperimentConfig, report: ReportProblem) -> ExperimentConfig:
    """Return the experiment with a simulator with attitude dynamics, if its platforms have an attitude."""
    turning = [index for index, entry in enumerate(config.platform_config) if entry.config.functor.turns]
    simulator: Simulator = config.environment.simulator
    if not turning:
        field = simulator.attitude_field
        if field and not simulator.turns:
            where = (*ENVIRONMENT_PATH, "simulator", "config", field)
            report(where, f"`{field}` needs platforms with attitude; use `platform: six-dof`, or remove it")
        return config
    for index, entry in enumerate(config.platform_config):
        if index not in turning:
            message = f"{entry.name} has no attitude but others do; use `platform: six-dof` for all of them or for none"
            report(("platform_config", index, "config", "platform"), message)
    try:
        made = simulator.with_attitude()
    except ValueError as error:
        report((*ENVIRONMENT_PATH, "simulator"), str(error))
        return config
    task = config.config.config
    environment = task.env_config.model_copy(update={"simulator": made})
    body = task.model_copy(update={"env_config": environment})
    return config.model_copy(update={"config": config.config.model_copy(update={"config": body})})


def _platforms(config: ExperimentConfig, report: ReportProblem) -> dict[str, Platform]:
    platforms: dict[str, Platform] = {}
    for index, entry in enumerate(config.platform_config):
        where: KeyTuple = ("platform_config", index)
        if entry.name in platforms:
            report((*where, "name"), f"two platforms are named {entry.name!r}")
        try:
            platforms[entry.name] = entry.config.functor.model_validate(entry.config.config)
        except ValidationError as error:
            platforms[entry.name] = entry.config.functor.model_construct()  # so that the name is known
            for problem in error.errors(include_url=False):
                text = text_of(problem)
                if problem["type"] == "extra_forbidden":
                    key = str(problem["loc"][-1])
                    text = f"unknown key `{key}`; {did_you_mean(key, entry.config.functor.model_fields)}"
                report((*where, "config", "config", *problem["loc"]), text)
    return platforms


def _check_bodies(simulator: Simulator, names: dict[str, set[str]], report: ReportProblem) -> None:
    """Check that the bodies of components exist; mistakes are reported at the simulator's key for the component."""
    for component in simulator.compose()[1]:
        for name in component.bodies:
            if name not in names["entity"]:
                where: KeyTuple = (*ENVIRONMENT_PATH, "simulator")
                for field in type(simulator).model_fields:
                    if isinstance(value := getattr(simulator, field), Mapping) and name in value:
                        where = (*where, "config", field, name)
                        break
                report(where, f"there is no body {name!r}; {did_you_mean(name, names['entity'])}")
                names["points"] |= names["entity"]  # so that correct names are not reported


def _check_controlled(config: ExperimentConfig, platforms: Mapping[str, Platform], report: ReportProblem) -> None:
    controlled = {name for agent in config.agent_config for name in agent.platforms}
    if controlled and controlled <= set(platforms):
        for index, platform in enumerate(config.platform_config):
            if platform.name not in controlled:
                report(("platform_config", index), f"no agent controls the platform {platform.name!r}; remove it")
