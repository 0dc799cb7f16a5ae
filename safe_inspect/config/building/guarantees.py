"""Checks for anything that would void the guarantee of an enabled safety filter, made before the first step."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from safe_inspect.config.building.disturbances import check_motion, kept_by
from safe_inspect.config.building.world import WorldValues, distinct, plugins_of
from safe_inspect.config.loading.located import Place
from safe_inspect.config.models import ENVIRONMENT_PATH, AgentEntry, ExperimentConfig
from safe_inspect.config.spec import AgentSpec
from safe_inspect.dones.motion import ContactDoneFunction, CrashDoneFunction, MaxDistanceDoneFunction
from safe_inspect.dones.shared import CollisionDoneFunction
from safe_inspect.errors import SafetyFilterWarning
from safe_inspect.platforms.base import Controller, Part
from safe_inspect.platforms.state_sensors import EntityPositionSensor, EntityVelocitySensor
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rta.base import SafetyGlue, TeamSafety
from safe_inspect.rta.constraints.parameters import FromWorld
from safe_inspect.rta.docking import RTAGlueCWHDocking3d
from safe_inspect.rta.rejection_sampler import RejectionSampler
from safe_inspect.rta.tumbling import RTAGlueTumblingTarget
from safe_inspect.simulators.resets.parameters import ConstantParameter, SimAttributeAccessor
from safe_inspect.simulators.resets.plan import BodyReset, ResetPlan
from safe_inspect.simulators.simulator import Simulator
from safe_inspect.tasks.inspection.sun import Sun, leaves_plane


def check_guarantees(config: ExperimentConfig, worlds: Sequence[WorldValues], reset: ResetPlan, root: Place) -> None:
    """Check that simulation, controllers and done functions match the guarantee of each enabled safety filter.

    The method ``continuous`` gives no guarantee and is not checked.

    Args:
        config: The validated models.
        worlds: The world of each agent.
        reset: The distribution of initial states.
        root: Position of the whole configuration.
    """
    agents = [root.at("agent_config", index, "config", "config") for index in range(len(config.agent_config))]
    for inside, entry, world in zip(agents, config.agent_config, worlds, strict=True):
        own = [(place.at("config"), plugin) for place, plugin in plugins_of(entry, inside) if _filters(plugin)]
        for place, _ in own[1:]:
            text = "another safety filter of this agent is enabled, but only one of them would act"
            place.report(f"{text}; put the constraints of both into one of them", "enabled")
        for place, plugin in own[:1]:
            if place.path[:-2] != (*inside.path, "glues"):
                text = "this safety filter has no effect, because a glue that does not filter wraps it; list it in "
                place.report(f"{text}`glues` itself, or enable the outer filter in its place", "enabled")
            _check_filter(plugin, place, config, [world], reset, root)
            if isinstance(plugin, FromWorld):  # filters of other packages may use fewer axes
                _check_thrusters(entry, place.at("enabled"))
            _check_ends(plugin, entry, inside, config, reset)
    team = config.environment.rta
    if team is not None and team.enabled:
        _check_filter(team, root.at(*ENVIRONMENT_PATH, "rta", "config"), config, worlds, reset, root)
        for inside, entry in zip(agents, config.agent_config, strict=True):
            _check_thrusters(entry, inside.at("parts"))
            _check_ends(team, entry, inside, config, reset)


def check_thrusters(agents: Sequence[AgentSpec], team: TeamSafety | None, root: Place) -> None:
    """Check that weak thrusters can keep at least some states safe, and warn about the fraction.

    Args:
        agents: The agents, with their filters in the world.
        team: The filter of all deputies, in the world.
        root: Position of the whole configuration.
    """
    filters: list[tuple[Place, str, Any]] = [
        (root.at("agent_config", index, "config", "config", "glues"), agent.name, agent.safety_filter)
        for index, agent in enumerate(agents)
        if agent.safety_filter is not None
    ]
    if team is not None and team.enabled:
        filters.append((root.at(*ENVIRONMENT_PATH, "rta"), "the team", team))
    asked: list[Any] = []
    for place, name, plugin in filters:
        if not hasattr(plugin, "recoverable_share") or plugin in asked:
            continue
        asked.append(plugin)
        found = plugin.recoverable_share()
        if found is None:
            continue
        count, share = found
        text = f"{name}: thrusters of {plugin.u_max:g} N cannot brake {plugin.m:g} kg against the tide everywhere"
        if share == 0.0:
            remedy = "raise the thrust, lower `r_max`, or disable the filter"
            place.report(f"{text}, and the filter cannot keep any of {count} sampled safe states safe; {remedy}")
        else:
            text += f"; of {count} safe states, sampled over all ranges and speeds, the filter can keep safe "
            warnings.warn(f"{text}{100.0 * share:.2g} %", SafetyFilterWarning, stacklevel=2)


def _filters(plugin: Plugin) -> bool:
    return isinstance(plugin, SafetyGlue) and plugin.enabled


def _check_filter(
    plugin: Any, place: Place, config: ExperimentConfig, worlds: Sequence[WorldValues], reset: ResetPlan, root: Place
) -> None:
    environment, kept = config.environment, kept_by(plugin)
    check_motion(plugin, place, environment.simulator, worlds)
    if "sun" in kept:
        _check_sun(environment.simulator, place.at("constraints"))
        _check_sun_angle(reset, root)
    if kept:
        for name in {body: None for component in environment.simulator.compose()[1] for body in component.bodies}:
            if name in reset.entities and not _rests_at_origin(reset.entities[name]):
                text = f"the filter assumes a chief at rest at the origin, and {name!r} is not"
                place.report(f"{text}; let it start at rest at the origin, or disable the filter", "enabled")
    for index, named in enumerate(environment.dones.shared):
        apart = 2.0 * kept["deputy_collision"].deputy_radius if "deputy_collision" in kept else math.inf
        done = named.functor
        if isinstance(done, CollisionDoneFunction) and done.safety_constraint > apart:
            text = f"deputies collide at {done.safety_constraint:g} m, but the filter only keeps them {apart:g} m apart"
            where = root.at(*ENVIRONMENT_PATH, "dones", "shared", index, "config", "safety_constraint")
            where.report(f"{text}; lower this, or raise the filter's `deputy_radius`")


def _check_sun(simulator: Simulator, place: Place) -> None:
    """Check that there is a sun, in the orbital plane, that rotates with the orbit."""
    dynamics, components = simulator.compose()
    orbit = dynamics.offers().get("mean_motion")
    suns = [component for component in components if isinstance(component, Sun)]
    for sun in suns:
        if orbit and not math.isclose(sun.rate, orbit, rel_tol=1e-9):
            once, rate = distinct(orbit, sun.rate)
            text = f"the constraint `sun` needs a sun with one rotation per orbit, {once} rad/s, but this one has "
            place.report(f"{text}{rate} rad/s; make them agree, or leave `sun` out")
    if leaves_plane(dynamics, components):
        text = "the constraint `sun` needs a sun in the orbital plane of a circular orbit, but this one has a beta "
        text += "angle, or the orbit is not circular; leave `sun` out: `constraints: {sun: !remove }`"
        place.report(text)
    if not suns:
        place.report("the constraint `sun` needs the component `Sun`; add it, or leave `sun` out")


def _check_sun_angle(reset: ResetPlan, root: Place) -> None:
    """Check that the initial angle of the sun is the one with which the deputies' initial states are tested."""
    place = root.at(*ENVIRONMENT_PATH, "simulator_reset_parameters", "additional_entities", "sun", "config", "theta")
    starts = [item.parameter for item in reset.environment if item.name == "sun_angle"]
    for name in dict.fromkeys(source for body in reset.deputies.values() for source in body.sources):
        sampler = reset.parameters[name]
        if not isinstance(sampler, RejectionSampler) or sampler.rta is None or "sun_angle" not in sampler.rta.states:
            continue
        if starts != [SimAttributeAccessor(attribute_name=f"{name}.sun_angle")]:
            text = f"`{name}` tests initial states with a sun angle that it samples, but the sun starts at another one"
            place.report(f"{text}; use a SimAttributeAccessor of `{name}.sun_angle`")


def _rests_at_origin(body: BodyReset | None) -> bool:
    if body is None or not all(isinstance(parameter, ConstantParameter) for parameter in body.parameters.values()):
        return False
    constants: Mapping[str, Any] = body.parameters
    values = {name: np.array([constant.value * constant.factor]) for name, constant in constants.items()}
    states = body.initializer(values)
    return not any(states[name].any() for name in ("position", "velocity") if name in states)


def _check_thrusters(entry: AgentEntry, place: Place) -> None:
    """Check that the controllers can apply thrust along each axis, as the filters assume."""
    least, largest = np.zeros(3), np.zeros(3)
    for part in entry.body.parts:
        if isinstance(part, Controller) and part.control_size == 3:
            shares = [part(limit[None])[0] for limit in part.limits]
            least, largest = least + np.minimum(*shares), largest + np.maximum(*shares)
    missing = [axis for axis, low, high in zip("xyz", least, largest, strict=True) if not low < 0.0 < high]
    if missing:
        axes = " and ".join(missing)
        text = f"the safety filter needs thrust along all axes, but {entry.name} has no controller along {axes}"
        place.report(f"{text}; add one, or disable the filter")


def _check_ends(plugin: Any, entry: AgentEntry, inside: Place, config: ExperimentConfig, reset: ResetPlan) -> None:
    """Check that a done function does not end an episode as lost in states that the filter allows."""
    kept, parts = kept_by(plugin), entry.body.parts
    orbit = config.environment.simulator.compose()[0].offers().get("mean_motion", 0.0)
    far, clear = kept["r_max"].r_max if "r_max" in kept else 0.0, math.inf
    if isinstance(plugin, RTAGlueTumblingTarget):
        far, clear = plugin.r_max, plugin.radius
    for index, named in enumerate(entry.body.dones):
        done, place = named.functor, inside.at("dones", index, "config")
        if isinstance(done, CrashDoneFunction) and _check_crash(plugin, done, orbit, place):
            _check_references(done, parts, reset, place)
        if isinstance(done, ContactDoneFunction) and done.radius > clear:
            text = f"a chaser loses at a clearance of {done.radius:g} m, but the filter only keeps {clear:g} m"
            place.report(f"{text}; raise the filter's `radius`, or lower this", "radius")
        if isinstance(done, MaxDistanceDoneFunction) and far:
            _check_references(done, parts, reset, place)
            if done.max_distance < far:
                text = f"a deputy loses beyond {done.max_distance:g} m, but the filter allows up to {far:g} m"
                place.report(f"{text}; lower the filter's `r_max`, or raise this value", "max_distance")


def _check_crash(plugin: Any, done: CrashDoneFunction, orbit: float, place: Place) -> bool:
    """Check that a crash is not within what the filter allows; return whether the filter prevents crashes."""
    kept, radius, limit = kept_by(plugin), done.crash_region_radius, done.velocity_constraint
    near = kept["chief_collision"].collision_radius if "chief_collision" in kept else 0.0
    if near:
        if radius > near:
            text = f"a deputy crashes within {radius:g} m of the chief, but the filter only keeps it beyond {near:g} m"
            place.report(f"{text}; raise the filter's `collision_radius`, or lower this", "crash_region_radius")
        return True
    fastest = _speed_limit(plugin, kept, orbit, radius)
    if limit is None or limit.lower_bound or math.isinf(fastest):
        return False
    slope = limit.slope * (orbit if limit.mean_motion is None else limit.mean_motion)
    allowed = limit.velocity_threshold + slope * max(radius - limit.threshold_distance, 0.0)
    if allowed < fastest and not math.isclose(allowed, fastest, rel_tol=1e-9):
        lost, flown = distinct(allowed, fastest)
        text = f"a deputy crashes if it reaches {radius:g} m faster than {lost} m/s, but the filter allows {flown} m/s"
        place.report(f"{text} there; lower the filter's limit, or raise this value", "velocity_constraint")
    return True


def _speed_limit(plugin: Any, kept: Mapping[str, Any], orbit: float, distance: float) -> float:
    """Return the largest speed that a filter allows at a range [m/s]; infinite if it does not limit the speed."""
    if isinstance(plugin, RTAGlueCWHDocking3d):
        beyond = max(distance - (plugin.v0_distance or 0.0), 0.0)
        return float(min(plugin.v0 + plugin.v1_coef * orbit * beyond, plugin.vel_limit))
    if "rel_vel" in kept:
        line = kept["rel_vel"]
        return float(line.v0 + line.v1 * (distance - line.v0_distance))
    return math.inf


def _check_references(done: Any, parts: Sequence[Part], reset: ResetPlan, place: Place) -> None:
    """Check that a done function measures from a body at rest at the origin, as the filter assumes."""
    entities = {
        part.part_name: reset.entities.get(part.entity_name)
        for part in parts
        if isinstance(part, EntityPositionSensor | EntityVelocitySensor)
    }
    for field, kind in done.references().items():
        name = getattr(done, field)
        if kind == "sensor" and name is not None and not _rests_at_origin(entities.get(name)):
            text = f"the filter assumes a chief at rest at the origin, but {name!r} does not read such a body"
            place.report(f"{text}; name a sensor of such a body, remove this key, or disable the filter", field)
