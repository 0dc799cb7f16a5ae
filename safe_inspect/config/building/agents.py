"""Construction of an `AgentSpec` from the models of an agent."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from pydantic_core import PydanticCustomError

from safe_inspect.config.building.world import WorldValues, in_world, plugins_of
from safe_inspect.config.loading.located import Place
from safe_inspect.config.models import AgentBody, AgentEntry
from safe_inspect.config.report import functor_problems
from safe_inspect.config.spec import AgentSpec, agent_names
from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.dones.limits import EpisodeLengthDone
from safe_inspect.errors import UnitError, did_you_mean, not_named
from safe_inspect.glues.actions import CoastGlue
from safe_inspect.glues.base import ActionGlue, Glue, ObservationGlue
from safe_inspect.platforms.base import Controller, Part, Platform, Sensor
from safe_inspect.plugins.functor import Named, build
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.policies.base import ScriptedPolicy
from safe_inspect.rewards.base import Reward
from safe_inspect.rewards.timely import WinLoseDoneReward
from safe_inspect.simulators.simulator import Simulator

_Dones = Sequence[Named[DoneFunction]]


@dataclass(frozen=True)
class AgentSetting:
    """Properties that all agents of an experiment have in common.

    Attributes:
        platforms: Platforms by name.
        names: Names that fields of plugins may refer to, by kind, without those that belong to one agent.
        simulator: The simulator.
        horizon: Largest number of steps of an episode.
    """

    platforms: Mapping[str, Platform]
    names: Mapping[str, set[str]]
    simulator: Simulator
    horizon: int


def build_agent(entry: AgentEntry, place: Place, world: WorldValues, setting: AgentSetting) -> AgentSpec | None:
    """Return an agent with the values of its world, or None if it has no platform.

    Args:
        entry: The validated model.
        place: Position of the entry.
        world: The world of the agent.
        setting: The properties that all agents have in common.
    """
    body, inside = entry.body, place.at("config", "config")
    _check_platforms(entry, place.at("platforms"), setting)
    if not entry.platforms:
        return None
    scripted = _scripted_policy(entry, place.at("policy"), setting)
    _check_controls(body, inside, setting)
    dones: _Dones = body.dones
    if not any(isinstance(done.functor, EpisodeLengthDone) for done in dones):
        dones = (*dones, Named("EpisodeLengthDone", EpisodeLengthDone(horizon=setting.horizon)))
    parts = _parts(body, dones, inside.at("parts"), setting)
    _check_carries(entry.platforms[0], parts, inside.at("parts"), setting)
    known = {**setting.names, **agent_names(parts, dones)}
    if len(parts) < len(body.parts):  # the missing part may be one with a duplicate name
        known = {kind: names for kind, names in known.items() if kind not in ("sensor", "controller")}
    sound = _check_references(entry, inside, known) and len(parts) == len(body.parts)
    glues = tuple(in_world(glue, world, inside.at("glues", index)) for index, glue in enumerate(body.glues))
    for key, functors in (("rewards", body.rewards), ("dones", dones)):
        check_unique(key, (named.name for named in functors), inside.at(key))
    for index, named in enumerate(dones):
        status = getattr(named.functor, "status", None)
        if not isinstance(status, DoneStatus) or status == DoneStatus.RUNNING:
            text = f"{named.name} has no `status` of an end; define one in its class, such as DoneStatus.LOSE"
            inside.report(text, "dones", index)
    if sound:
        _check_glues(body.glues, parts, inside.at("glues"), observes=scripted is None)
    return AgentSpec(
        entry.name,
        entry.platforms[0],
        parts,
        tuple(glue for glue in glues if glue.exported),
        _rewards(body.rewards, dones, inside.at("rewards")),
        tuple(dones),
        policy=entry.flown_by,
        scripted_policy=scripted,
    )


def _check_platforms(entry: AgentEntry, place: Place, setting: AgentSetting) -> None:
    for index, platform in enumerate(entry.platforms):
        if platform not in setting.platforms:
            place.report(f"there is no platform {platform!r}; {did_you_mean(platform, setting.platforms)}", index)
    if not entry.platforms:
        place.report("an agent needs a platform; give the name of one")
    if len(entry.platforms) > 1:
        place.report("an agent controls only one platform; remove the others", 1)


def _check_controls(body: AgentBody, inside: Place, setting: AgentSetting) -> None:
    """Report controllers that do not match the vehicle's inputs."""
    size = setting.simulator.compose()[0].control_size
    for index, part in enumerate(body.parts):
        if isinstance(part, Controller) and part.control_size > size:
            message = f"{part.part_name!r} commands a moment, but the platforms have no attitude"
            inside.report(f"{message}; use `platform: six-dof`, or remove the controller", "parts", index)


def _parts(body: AgentBody, dones: _Dones, place: Place, setting: AgentSetting) -> dict[str, Part]:
    """Return the parts by name, with the values that sensors need from the task."""
    horizon = min(done.functor.horizon for done in dones if isinstance(done.functor, EpisodeLengthDone))
    parts: dict[str, Part] = {}
    check_unique("parts", (part.part_name for part in body.parts), place)
    for index, part in enumerate(body.parts):
        try:
            parts[part.part_name] = part.in_task(setting.simulator, horizon) if isinstance(part, Sensor) else part
            _check_reading(parts[part.part_name])
        except ValueError as error:
            place.report(str(error), index, "config")
            parts[part.part_name] = part
    return parts


def _check_reading(part: Part) -> None:
    """Check the elements and the bounds of a sensor.

    Raises:
        ValueError: The elements are one text, or the bounds are reversed.
    """
    if not isinstance(part, Sensor):
        return
    if isinstance(part.element_names, str):
        name = part.element_names
        raise ValueError(f"the elements of {part.registered_name} are the text {name!r}; write the tuple ({name!r},)")
    low, high = part.limits
    if low > high:
        raise ValueError(f"the bounds of {part.registered_name} are reversed: {low:g} is above {high:g}; swap them")


def _check_carries(platform: str, parts: Mapping[str, Part], place: Place, setting: AgentSetting) -> None:
    """Report parts that the platform does not support."""
    if platform in setting.platforms:
        try:
            setting.platforms[platform](tuple(parts.values()))
        except ValueError as error:
            place.report(f"the platform {platform!r}: {error}")


def _check_references(entry: AgentEntry, inside: Place, known: Mapping[str, set[str]]) -> bool:
    """Check that the names in plugins exist, if names of their kind are known; return whether all of them do."""
    sound = True
    inexact = {part.part_name for part in entry.body.parts if isinstance(part, Sensor) and part.errors}
    for place, plugin in plugins_of(entry, inside):
        sound = _names_exist(plugin, place, known) and sound
        for field, kind in plugin.references().items():
            value = getattr(plugin, field)
            if kind == "sensor" and value in inexact and not isinstance(plugin, ObservationGlue | Sensor):
                text = f"the sensor {value!r} has `errors`, but a {plugin.kind} needs exact values"
                place.report(f"{text}; name a second sensor of the same kind without errors", "config", field)
    return sound


def _names_exist(plugin: Plugin, place: Place, known: Mapping[str, set[str]]) -> bool:
    """Return whether the names in a plugin exist, if names of their kind are known; the others are reported."""
    wrong = {
        field: not_named(kind, value, known[kind])
        for field, kind in plugin.references().items()
        if (value := getattr(plugin, field)) is not None and kind in known and value not in known[kind]
    }
    for field, message in wrong.items():
        place.report(message, "config", field)
    return not wrong


def check_unique(what: str, names: Iterable[str], place: Place) -> None:
    """Report names that occur more than once in a list."""
    seen: set[str] = set()
    for index, name in enumerate(names):
        if name in seen:
            place.report(f"two {what} are named {name!r}; give one of them a unique `name`", index)
        seen.add(name)


def _rewards(rewards: Iterable[Named[Reward]], dones: _Dones, place: Place) -> tuple[Named[Reward], ...]:
    """Return the rewards; a reward for an end gets the done function that it names."""
    known = {named.name: named.functor for named in dones}
    found = []
    for index, named in enumerate(rewards):
        functor = named.functor
        if isinstance(functor, WinLoseDoneReward) and (functor.done_name is None or functor.done_name in known):
            try:
                functor = functor.with_dones(known)
                if type(functor.done).remember is not DoneFunction.remember:
                    raise ValueError(f"{functor.done_name} stores earlier steps, which a reward cannot read")
            except ValueError as error:
                place.report(str(error), index)
        found.append(Named(named.name, functor))
    return tuple(found)


def _scripted_policy(entry: AgentEntry, place: Place, setting: AgentSetting) -> ScriptedPolicy | None:
    """Return the scripted policy that controls an agent, or None if its actions come from the caller."""
    if entry.policy is None or entry.policy.functor is None:
        return None
    try:
        scripted = build("policy", {"functor": entry.policy.functor, "config": entry.policy.config})
    except PydanticCustomError as error:
        for where, text in functor_problems(error):
            place.report(text, *where)
        return None
    assert isinstance(scripted, ScriptedPolicy), "the registry returns a plugin of the requested kind"
    _names_exist(scripted, place, setting.names)
    return scripted


def _check_glues(glues: Sequence[Glue], parts: Mapping[str, Part], place: Place, *, observes: bool) -> None:
    """Check that glues match the parts, command each controller once, and include observations and commands.

    Args:
        glues: The glues of an agent.
        parts: Its parts, by name.
        place: Position of the glues.
        observes: Whether the agent's policy needs an observation.
    """
    commanded: set[str] = set()
    discrete: set[bool] = set()
    for index, glue in enumerate(glues):
        if attributes := [name for name in ("names", "bounds") if not callable(getattr(glue, name))]:
            place.report(f"`{attributes[0]}` of {glue.registered_name} is not a method; define it with `def`", index)
            continue
        try:
            glue.bounds(parts)
        except (ValueError, UnitError) as error:
            place.report(str(error), index)
            continue
        if isinstance(glue, ActionGlue):
            for name in glue.names(parts):
                if name in commanded:
                    place.report(f"the controller {name!r} is commanded twice; remove one of the glues", index)
                commanded.add(name)
            controlling = [leaf for leaf in glue.leaves() if not isinstance(leaf, CoastGlue)]
            discrete |= {bool(count) for leaf in controlling for count in leaf.choices(parts)}
    leaves = [leaf for glue in glues if isinstance(glue, ActionGlue) for leaf in glue.leaves()]
    if any(isinstance(leaf, CoastGlue) for leaf in leaves[:-1]):
        place.report("CoastGlue is before the glue of a controller; move it to the end of the list")
    if len(discrete) > 1:
        place.report("discrete and continuous action glues are mixed; use one kind for all of them")
    for base, what in ((ObservationGlue, "observes a sensor"), (ActionGlue, "commands a controller")):
        if not any(isinstance(glue, base) and glue.exported for glue in glues) and (observes or base is ActionGlue):
            place.report(f"there is no glue that {what}; add one")
