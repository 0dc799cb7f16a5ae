"""From validated models to an `EnvironmentSpec`, with the checks that need more than one part of the experiment."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from pydantic import ValidationError
from pydantic_core import PydanticCustomError

from safe_inspect.config.models import AgentEntry, ExperimentConfig
from safe_inspect.config.spec import AgentSpec, EnvironmentSpec
from safe_inspect.dones.time_limit import EpisodeLengthDone
from safe_inspect.errors import UnitError, did_you_mean
from safe_inspect.functor import Named
from safe_inspect.glues.base import ActionGlue, Glue, ObservationGlue
from safe_inspect.platforms.base import Controller, Part, Platform, Sensor
from safe_inspect.platforms.cwh import CWHPlatform
from safe_inspect.plugin import Plugin
from safe_inspect.rta.rejection_sampler import RejectionSampler, check_parameters
from safe_inspect.simulators.inspection_simulator import InspectionSimulator
from safe_inspect.simulators.parameters import Parameter, SimAttributeAccessor
from safe_inspect.simulators.reset import BodyReset, ResetPlan

Path = tuple[Any, ...]
Report = Callable[[Path, str], None]

_ENVIRONMENT: Path = ("config", "config", "env_config")
_RESET: Path = (*_ENVIRONMENT, "simulator_reset_parameters")


def assemble(config: ExperimentConfig, horizon: int, report: Report, *, seed: int) -> EnvironmentSpec | None:
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

    def tell(where: Path, message: str) -> None:
        nonlocal mistakes
        mistakes += 1
        report(where, message)

    platforms = _platforms(config, tell)
    reset = _reset(config, tell)
    environment = config.config.config.env_config
    names = {
        "entity": {*platforms, *reset.entities},
        "platform": set(platforms),
        "points": set(getattr(environment.simulator, "inspection_points_map", ())),
    }
    if isinstance(environment.simulator, InspectionSimulator):
        for name in environment.simulator.inspection_points_map:
            if name not in names["entity"]:
                where = (*_ENVIRONMENT, "simulator", "config", "inspection_points_map", name)
                tell(where, f"no body is named {name!r}; {did_you_mean(name, names['entity'])}")
    if environment.dones.shared:
        tell((*_ENVIRONMENT, "dones", "shared"), "shared dones concern several agents; this version trains one")
    if len(config.agent_config) > 1:
        tell(("agent_config", 1), "this version trains one agent; remove the others")
    agents = [
        agent
        for index, entry in enumerate(config.agent_config)
        if (agent := _agent(entry, ("agent_config", index), platforms, names, horizon, tell)) is not None
    ]
    if mistakes:
        return None
    frame_rate = config.agent_config[0].config.config.frame_rate
    return EnvironmentSpec(environment.simulator, platforms, tuple(agents), reset, 1.0 / frame_rate, seed)


def _platforms(config: ExperimentConfig, report: Report) -> dict[str, Platform]:
    platforms: dict[str, Platform] = {}
    for index, entry in enumerate(config.platform_config):
        where: Path = ("platform_config", index)
        if entry.name in platforms:
            report((*where, "name"), f"two platforms are named {entry.name!r}")
        try:
            platforms[entry.name] = CWHPlatform.model_validate(entry.config.config)
        except ValidationError as error:
            for problem in error.errors(include_url=False):
                report((*where, "config", "config", *problem["loc"]), problem["msg"])
    return platforms


def _reset(config: ExperimentConfig, report: Report) -> ResetPlan:
    drawn = config.config.config.env_config.simulator_reset_parameters
    parameters: dict[str, Parameter] = dict(drawn.__pydantic_extra__ or {})
    entities: dict[str, BodyReset] = {}
    sun: Parameter | None = None
    for name, entity in drawn.additional_entities.items():
        where = (*_RESET, "additional_entities", name)
        if entity.entity_class == "Sun":
            for key in entity.config:
                if key != "theta":
                    report((*where, "config", key), "the sun takes `theta` alone")
            sun = entity.config.get("theta")
            if sun is None:
                report(where, "the sun needs `theta`, its angle at the reset")
        elif entity.initializer is None:
            report(where, "a body needs an `initializer`, and the sun `entity_class: Sun`")
        else:
            entities[name] = BodyReset(entity.initializer, entity.config)
            _fits(entities[name], (*where, "config"), report)
        for key, parameter in entity.config.items():
            _accesses(parameter, parameters, (*where, "config", key), report)
    deputies: dict[str, BodyReset] = {}
    for index, agent in enumerate(config.agent_config):
        where = ("agent_config", index, "config", "config", "simulator_reset_parameters", "config")
        begin = agent.config.config.simulator_reset_parameters
        body = BodyReset(begin.initializer, begin.config)
        _fits(body, where, report)
        for key, parameter in begin.config.items():
            _accesses(parameter, parameters, (*where, key), report)
        deputies |= dict.fromkeys(agent.platforms[:1], body)
    used = {"priority_vector_azimuth_angle", "priority_vector_elevation_angle"} | {
        accessor.attribute_name.split(".")[0]
        for body in (*deputies.values(), *entities.values())
        for accessor in body.parameters.values()
        if isinstance(accessor, SimAttributeAccessor)
    }
    used |= {sun.attribute_name.split(".")[0]} if isinstance(sun, SimAttributeAccessor) else set()
    for name in parameters:
        if name not in used:
            report((*_RESET, name), f"nothing uses the reset parameter {name!r}; {did_you_mean(name, used)}")
    return ResetPlan(parameters, deputies, entities, sun)


def _fits(body: BodyReset, where: Path, report: Report) -> None:
    try:
        check_parameters(body.initializer, body.parameters, where[-1])
    except PydanticCustomError as error:
        for problem in (error.context or {})["errors"]:
            report((*where[:-1], *problem["loc"]), problem["msg"])


def _accesses(parameter: Parameter, parameters: Mapping[str, Parameter], where: Path, report: Report) -> None:
    """Check that an accessor names something that is drawn before it."""
    if not isinstance(parameter, SimAttributeAccessor):
        return
    name, _, state = parameter.attribute_name.partition(".")
    where = (*where, "config", "attribute_name")
    if name not in parameters:
        report(where, f"no reset parameter is named {name!r}; {did_you_mean(name, parameters)}")
        return
    source = parameters[name]
    states = source.initializer.gives if isinstance(source, RejectionSampler) else ()
    if state and state not in states:
        report(where, f"{name!r} has no state {state!r}; {did_you_mean(state, states)}")


def _agent(
    entry: AgentEntry,
    where: Path,
    platforms: Mapping[str, Platform],
    names: Mapping[str, set[str]],
    horizon: int,
    report: Report,
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
    parts: dict[str, Part] = {}
    for index, part in enumerate(body.parts):
        if part.part_name in parts:
            message = f"two parts are named {part.part_name!r}; give one of them a `name` of its own"
            report((*base, "parts", index), message)
        parts[part.part_name] = part
    known = {
        **names,
        "sensor": {name for name, part in parts.items() if isinstance(part, Sensor)},
        "controller": {name for name, part in parts.items() if isinstance(part, Controller)},
    }
    sound = True
    for path, plugin in _plugins(entry, base):
        for field, kind in plugin.references().items():
            value = getattr(plugin, field)
            if value is not None and value not in known[kind]:
                sound = False
                report((*path, "config", field), f"no {kind} is named {value!r}; {did_you_mean(value, known[kind])}")
    dones = list(body.dones)
    if not any(isinstance(done.functor, EpisodeLengthDone) for done in dones):
        dones.append(Named("EpisodeLengthDone", EpisodeLengthDone(horizon=horizon)))
    for key, functors in (("rewards", body.rewards), ("dones", dones)):
        seen: set[str] = set()
        for index, named in enumerate(functors):
            if named.name in seen:
                report((*base, key, index), f"two {key} are named {named.name!r}; give one of them a `name` of its own")
            seen.add(named.name)
    if sound:
        _check_glues(body.glues, parts, (*base, "glues"), report)
    return AgentSpec(entry.name, entry.platforms[0], parts, body.glues, body.rewards, tuple(dones))


def _check_glues(glues: tuple[Glue, ...], parts: Mapping[str, Part], where: Path, report: Report) -> None:
    commanded: set[str] = set()
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
    for base, what in ((ObservationGlue, "observes a sensor"), (ActionGlue, "commands a controller")):
        if not any(isinstance(glue, base) for glue in glues):
            report(where, f"no glue {what}; add one")


def _plugins(entry: AgentEntry, base: Path) -> Iterator[tuple[Path, Plugin]]:
    """Yield every plugin of an agent that may name something, with its path."""
    body = entry.config.config
    for key in ("parts", "glues"):
        for index, plugin in enumerate(getattr(body, key)):
            yield from _nested((*base, key, index), plugin)
    for key in ("rewards", "dones"):
        for index, named in enumerate(getattr(body, key)):
            yield (*base, key, index), named.functor


def _nested(path: Path, plugin: Plugin) -> Iterator[tuple[Path, Plugin]]:
    yield path, plugin
    for index, inner in enumerate(getattr(plugin, "wrapped", ())):
        yield from _nested((*path, "wrapped", index), inner)
