"""From validated models to an `EnvironmentSpec`, with the checks that need more than one part of the experiment."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import ValidationError
from pydantic_core import PydanticCustomError

from safe_inspect.config.building.attitude import check_controls, with_attitude
from safe_inspect.config.building.guarantees import check_guarantees, check_thrusters
from safe_inspect.config.building.policies import policy_name
from safe_inspect.config.building.reporting import KeyTuple, ReportProblem
from safe_inspect.config.building.resets import reset_plan
from safe_inspect.config.building.team import check_agents, safe_initial_states
from safe_inspect.config.building.world import (
    WorldValues,
    check_world,
    common_world,
    in_world,
    plugins_of,
    reset_in_world,
    worlds_of,
)
from safe_inspect.config.messages.messages import message
from safe_inspect.config.models.experiment import AgentBody, AgentEntry, ExperimentConfig
from safe_inspect.config.names import agent_names, world_names
from safe_inspect.config.spec import AgentSpec, EnvironmentSpec
from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.dones.time_limit import EpisodeLengthDone
from safe_inspect.errors import UnitError, did_you_mean, not_named
from safe_inspect.glues.base import ActionGlue, Glue, ObservationGlue
from safe_inspect.glues.coast_glue import CoastGlue
from safe_inspect.platforms.base import Part, Platform, Sensor
from safe_inspect.platforms.cwh import CWHPlatform
from safe_inspect.plugins.functor import Named, build
from safe_inspect.policies.base import ScriptedPolicy
from safe_inspect.rewards.base import Reward
from safe_inspect.rewards.timely import WinLoseDoneReward
from safe_inspect.simulators.simulator import Simulator

_ENVIRONMENT: KeyTuple = ("config", "config", "env_config")


def assemble(config: ExperimentConfig, horizon: int, report: ReportProblem, *, seed: int) -> EnvironmentSpec | None:
    """Assemble the environment of an experiment.

    Args:
        config: The validated models.
        horizon: Largest number of steps of an episode.
        report: Takes the path and the message of every mistake that is found.
        seed: Seed of the run.

    Returns:
        The environment; None when a mistake leaves none.
    """
    mistakes = 0

    def note(where: KeyTuple, message: str) -> None:
        nonlocal mistakes
        mistakes += 1
        report(where, message)

    platforms = _platforms(config, note)
    config = with_attitude(config, note)
    reset = reset_plan(config, note)
    environment = config.config.config.env_config
    names = world_names(platforms, reset, environment.simulator)
    for component in environment.simulator.compose()[1]:
        for name in component.bodies:
            if name not in names["entity"]:
                where: KeyTuple = (*_ENVIRONMENT, "simulator")
                if "inspection_points_map" in type(environment.simulator).model_fields:
                    where = (*where, "config", "inspection_points_map", name)
                note(where, f"no body is named {name!r}; {did_you_mean(name, names['entity'])}")
                names["points"] |= names["entity"]  # who names the right body makes no mistake
    controlled = {name for agent in config.agent_config for name in agent.platforms}
    for index, platform in enumerate(config.platform_config):
        if platform.name not in controlled and controlled and controlled <= set(platforms):
            note(("platform_config", index), f"no agent controls the platform {platform.name!r}; remove it")
    worlds, simulator = worlds_of(config, platforms), environment.simulator
    agents = [
        agent
        for index, entry in enumerate(config.agent_config)
        if (agent := _agent(entry, ("agent_config", index), platforms, names, horizon, worlds[index], simulator, note))
        is not None
    ]
    check_agents(config, agents, note)
    check_world(config, reset, worlds, note)
    if not mistakes:  # it draws on what the others have checked
        check_guarantees(config, worlds, reset, note)
    common = common_world(worlds)
    reset = reset_in_world(reset, common, note)
    if environment.rta is not None:
        where = (*_ENVIRONMENT, "rta")
        environment = environment.model_copy(update={"rta": in_world(environment.rta, common, where, note)})
    if not mistakes:  # it works out plans
        check_thrusters(agents, environment.rta, note)
    if mistakes:
        return None
    frame_rate = config.agent_config[0].config.config.frame_rate
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


def _platforms(config: ExperimentConfig, report: ReportProblem) -> dict[str, Platform]:
    platforms: dict[str, Platform] = {}
    for index, entry in enumerate(config.platform_config):
        where: KeyTuple = ("platform_config", index)
        if entry.name in platforms:
            report((*where, "name"), f"two platforms are named {entry.name!r}")
        try:
            platforms[entry.name] = entry.config.functor.model_validate(entry.config.config)
        except ValidationError as error:
            platforms[entry.name] = CWHPlatform()  # the name is known all the same
            for problem in error.errors(include_url=False):
                text = "; ".join(filter(None, message(problem)))
                if problem["type"] == "extra_forbidden":
                    key = str(problem["loc"][-1])
                    text = f"unknown key `{key}`; {did_you_mean(key, entry.config.functor.model_fields)}"
                report((*where, "config", "config", *problem["loc"]), text)
    return platforms


def _agent(
    entry: AgentEntry,
    where: KeyTuple,
    platforms: Mapping[str, Platform],
    names: Mapping[str, set[str]],
    horizon: int,
    world: WorldValues,
    simulator: Simulator,
    report: ReportProblem,
) -> AgentSpec | None:
    for index, platform in enumerate(entry.platforms):
        if platform not in platforms:
            message = f"no platform is named {platform!r}; {did_you_mean(platform, platforms)}"
            report((*where, "platforms", index), message)
    if not entry.platforms:
        report((*where, "platforms"), "an agent needs a platform; name one")
        return None
    if len(entry.platforms) > 1:
        report((*where, "platforms", 1), "an agent controls one platform; remove the others")
    body, base = entry.config.config, (*where, "config", "config")
    scripted = _scripted_policy(entry, where, names, report)
    check_controls(body, simulator, base, report)
    dones = list(body.dones)
    if not any(isinstance(done.functor, EpisodeLengthDone) for done in dones):
        dones.append(Named("EpisodeLengthDone", EpisodeLengthDone(horizon=horizon)))
    horizon = min(done.functor.horizon for done in dones if isinstance(done.functor, EpisodeLengthDone))
    parts: dict[str, Part] = {}
    for index, part in enumerate(body.parts):
        if part.part_name in parts:
            message = f"two parts are named {part.part_name!r}; give one of them a `name` of its own"
            report((*base, "parts", index), message)
        try:
            parts[part.part_name] = part.in_task(simulator, horizon) if isinstance(part, Sensor) else part
        except ValueError as error:
            report((*base, "parts", index, "config"), str(error))
            parts[part.part_name] = part
    if entry.platforms[0] in platforms:
        try:
            platforms[entry.platforms[0]](tuple(parts.values()))
        except ValueError as error:
            report((*base, "parts"), f"the platform {entry.platforms[0]!r}: {error}")
    known = {**names, **agent_names(parts, dones)}
    sound = True
    for path, plugin in plugins_of(entry, base):
        for field, kind in plugin.references().items():
            value = getattr(plugin, field)
            if len(parts) < len(body.parts) and kind in ("sensor", "controller"):
                sound = False  # the part that is meant may be one of those whose name is taken
            elif value is not None and value not in known[kind]:
                sound = False
                report((*path, "config", field), not_named(kind, value, known[kind]))
    glues = tuple(in_world(glue, world, (*base, "glues", index), report) for index, glue in enumerate(body.glues))
    for key, functors in (("rewards", body.rewards), ("dones", dones)):
        seen: set[str] = set()
        for index, named in enumerate(functors):
            if named.name in seen:
                report((*base, key, index), f"two {key} are named {named.name!r}; give one of them a `name` of its own")
            seen.add(named.name)
            if key == "dones" and not isinstance(getattr(named.functor, "status", None), DoneStatus):
                report(
                    (*base, key, index), f"{named.name} has no `status`; give its class one, such as DoneStatus.LOSE"
                )
    if sound:
        _check_glues(body.glues, parts, (*base, "glues"), report, observes=scripted is None)
    return AgentSpec(
        entry.name,
        entry.platforms[0],
        parts,
        _exported(glues),
        _rewards(body, dones, base, report),
        tuple(dones),
        policy=policy_name(entry),
        scripted_policy=scripted,
    )


def _rewards(
    body: AgentBody, dones: list[Named[DoneFunction]], where: KeyTuple, report: ReportProblem
) -> tuple[Named[Reward], ...]:
    """Return the rewards, those of an end with the done function that they name."""
    known = {named.name: named.functor for named in dones}
    found = []
    for index, named in enumerate(body.rewards):
        functor = named.functor
        if isinstance(functor, WinLoseDoneReward) and (functor.done_name is None or functor.done_name in known):
            try:
                functor = functor.with_dones(known)
                if type(functor.done).remember is not DoneFunction.remember:
                    raise ValueError(f"{functor.done_name} remembers earlier steps, which a reward cannot ask for")
            except ValueError as error:
                report((*where, "rewards", index), str(error))
        found.append(Named(named.name, functor))
    return tuple(found)


def _scripted_policy(
    entry: AgentEntry, where: KeyTuple, names: Mapping[str, set[str]], report: ReportProblem
) -> ScriptedPolicy | None:
    """Return the scripted policy that flies an agent; None when its actions come from outside."""
    if entry.policy is None or entry.policy.functor is None:
        return None
    try:
        scripted = build("policy", {"functor": entry.policy.functor, "config": entry.policy.config})
    except PydanticCustomError as error:
        for problem in (error.context or {})["errors"]:
            report((*where, "policy", *problem["loc"]), "; ".join(filter(None, message(problem))))
        return None
    assert isinstance(scripted, ScriptedPolicy), "the registry gives a plugin of the kind that is asked for"
    for field, kind in scripted.references().items():
        value = getattr(scripted, field)
        if value is not None and value not in names.get(kind, {value}):
            text = not_named(kind, value, names[kind])
            report((*where, "policy", "config", field), text)
    return scripted


def _check_glues(
    glues: tuple[Glue, ...], parts: Mapping[str, Part], where: KeyTuple, report: ReportProblem, *, observes: bool
) -> None:
    commanded: set[str] = set()
    discrete: set[bool] = set()
    for index, glue in enumerate(glues):
        try:
            glue.bounds(parts)
        except (ValueError, UnitError) as error:
            report((*where, index), str(error))
            continue
        if isinstance(glue, ActionGlue):
            for name in glue.names(parts):
                if name in commanded:
                    report((*where, index), f"the controller {name!r} is commanded twice; remove one of the glues")
                commanded.add(name)
            discrete |= {
                bool(count)
                for leaf in glue.leaves()
                if not isinstance(leaf, CoastGlue)
                for count in leaf.choices(parts)
            }
    leaves = [leaf for glue in glues if isinstance(glue, ActionGlue) for leaf in glue.leaves()]
    if any(isinstance(leaf, CoastGlue) for leaf in leaves[:-1]):
        report(where, "CoastGlue stands before the glue of a controller; move it behind the last of them")
    if len(discrete) > 1:
        report(where, "some action glues choose among levels and others give real numbers; use one kind for all")
    for base, what in ((ObservationGlue, "observes a sensor"), (ActionGlue, "commands a controller")):
        if not any(isinstance(glue, base) for glue in _exported(glues)) and (observes or base is ActionGlue):
            report(where, f"no glue {what}; add one")


def _exported(glues: tuple[Glue, ...]) -> tuple[Glue, ...]:
    """Return the glues without the observations that are kept from the policy."""
    return tuple(
        glue for glue in glues if not (isinstance(glue, ObservationGlue) and glue.training_export_behavior == "EXCLUDE")
    )
