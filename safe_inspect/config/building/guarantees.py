"""Checks for anything that would void the guarantee of an enabled safety filter, made before the first step."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from safe_inspect.config.building.disturbances import check_motion, kept_by
from safe_inspect.config.building.world import WorldValues, distinct, plugins_of
from safe_inspect.config.messages.report import ENVIRONMENT_PATH, KeyTuple, ReportProblem
from safe_inspect.config.models.experiment import AgentEntry, ExperimentConfig
from safe_inspect.config.spec import AgentSpec
from safe_inspect.dones.range import CrashDoneFunction, MaxDistanceDoneFunction
from safe_inspect.dones.shared import CollisionDoneFunction
from safe_inspect.errors import SafetyFilterWarning
from safe_inspect.platforms.base import Controller, Part
from safe_inspect.platforms.entity_sensors import EntityPositionSensor, EntityVelocitySensor
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rta.base import SafetyGlue, TeamSafety
from safe_inspect.rta.constraints.parameters import TaskParameters
from safe_inspect.rta.docking import RTAGlueCWHDocking3d
from safe_inspect.rta.rejection_sampler import RejectionSampler
from safe_inspect.simulators.resets.parameters import ConstantParameter, SimAttributeAccessor
from safe_inspect.simulators.resets.plan import BodyReset, ResetPlan
from safe_inspect.simulators.simulator import Simulator
from safe_inspect.tasks.inspection.sun import Sun, leaves_plane
from safe_inspect.types import FloatArray

_AXES = "xyz"


def check_guarantees(
    config: ExperimentConfig, worlds: Sequence[WorldValues], reset: ResetPlan, report: ReportProblem
) -> None:
    """Check that simulation, controllers and done functions match the guarantee of each enabled safety filter.

    The method ``continuous`` gives no guarantee and is not checked.

    Args:
        config: The validated models.
        worlds: The world of each agent.
        reset: The distribution of initial states.
        report: Function that is called with the path and the message of every mistake.
    """
    environment = config.environment
    for index, entry in enumerate(config.agent_config):
        base = ("agent_config", index, "config", "config")
        own = [(path, plugin) for path, plugin in plugins_of(entry, base) if _filters(plugin)]
        for path, _ in own[1:]:
            text = "another safety filter of this agent is enabled, but only one of them would act"
            report((*path, "config", "enabled"), f"{text}; put the constraints of both into one of them")
        for path, plugin in own[:1]:
            if path[:-1] != (*base, "glues"):
                text = "this safety filter has no effect, because a glue that does not filter wraps it; list it in "
                report((*path, "config", "enabled"), f"{text}`glues` itself, or enable the outer filter in its place")
            _check_filter(plugin, (*path, "config"), config, worlds[index : index + 1], reset, report)
            if isinstance(plugin, TaskParameters):  # filters of other packages may use fewer axes
                _check_thrusters(entry, (*path, "config", "enabled"), report)
            _check_ends(plugin, entry, base, config, reset, report)
    team = environment.rta
    if team is not None and team.enabled:
        _check_filter(team, (*ENVIRONMENT_PATH, "rta", "config"), config, worlds, reset, report)
        for index, entry in enumerate(config.agent_config):
            base = ("agent_config", index, "config", "config")
            _check_thrusters(entry, (*base, "parts"), report)
            _check_ends(team, entry, base, config, reset, report)


def check_thrusters(agents: Sequence[AgentSpec], team: TeamSafety | None, report: ReportProblem) -> None:
    """Check that weak thrusters can keep at least some states safe, and warn about the fraction.

    Args:
        agents: The agents, with their filters in the world.
        team: The filter of all deputies, in the world.
        report: Function that is called with the path and the message of every mistake.
    """
    filters: list[tuple[KeyTuple, str, Any]] = [
        (("agent_config", index, "config", "config", "glues"), agent.name, glue)
        for index, agent in enumerate(agents)
        for glue in agent.action_glues
        if _filters(glue)
    ]
    if team is not None and team.enabled:
        filters.append(((*ENVIRONMENT_PATH, "rta"), "the team", team))
    asked: list[Any] = []
    for where, name, plugin in filters:
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
            report(where, f"{text}, and the filter cannot keep any of {count} sampled safe states safe; {remedy}")
        else:
            text += f"; of {count} safe states, sampled over all ranges and speeds, the filter can keep safe "
            warnings.warn(f"{text}{100.0 * share:.2g} %", SafetyFilterWarning, stacklevel=2)


def _filters(plugin: Plugin) -> bool:
    return isinstance(plugin, SafetyGlue) and plugin.enabled


def _check_filter(
    plugin: Any,
    where: KeyTuple,
    config: ExperimentConfig,
    worlds: Sequence[WorldValues],
    reset: ResetPlan,
    report: ReportProblem,
) -> None:
    environment, kept = config.environment, kept_by(plugin)
    dynamics, components = environment.simulator.compose()
    orbit = dynamics.offers().get("mean_motion")
    check_motion(plugin, where, environment.simulator, worlds, report)
    for sun in components:
        if "sun" in kept and isinstance(sun, Sun) and orbit and not math.isclose(sun.rate, orbit, rel_tol=1e-9):
            once, rate = distinct(orbit, sun.rate)
            text = f"the constraint `sun` needs a sun with one rotation per orbit, {once} rad/s, but this one has "
            report((*where, "constraints"), f"{text}{rate} rad/s; make them agree, or leave `sun` out")
    if "sun" in kept:
        if leaves_plane(dynamics, components):
            text = "the constraint `sun` needs a sun in the orbital plane of a circular orbit, but this one has a "
            report(
                (*where, "constraints"),
                f"{text}beta angle, or the orbit is not circular; leave `sun` out: `constraints: {{sun: !remove }}`",
            )
        if not any(isinstance(component, Sun) for component in components):
            text = "the constraint `sun` needs the component `Sun`; add it, or leave `sun` out"
            report((*where, "constraints"), text)
        _check_sun_angle(reset, report)
    if kept:
        for name in _moving_bodies(environment.simulator, reset):
            text = f"the filter assumes a chief at rest at the origin, and {name!r} is not"
            report((*where, "enabled"), f"{text}; let it start at rest at the origin, or disable the filter")
    for index, named in enumerate(environment.dones.shared):
        apart = 2.0 * kept["deputy_collision"].deputy_radius if "deputy_collision" in kept else math.inf
        done = named.functor
        if isinstance(done, CollisionDoneFunction) and done.safety_constraint > apart:
            text = f"deputies collide at {done.safety_constraint:g} m, but the filter only keeps them {apart:g} m apart"
            place = (*ENVIRONMENT_PATH, "dones", "shared", index, "config", "safety_constraint")
            report(place, f"{text}; lower this, or raise the filter's `deputy_radius`")


def _check_sun_angle(reset: ResetPlan, report: ReportProblem) -> None:
    """Check that the initial angle of the sun is the one with which the deputies' initial states are tested."""
    starts = [item.parameter for item in reset.environment if item.name == "sun_angle"]
    for name in dict.fromkeys(source for body in reset.deputies.values() for source in body.sources):
        sampler = reset.parameters[name]
        if not isinstance(sampler, RejectionSampler) or sampler.rta is None or "sun_angle" not in sampler.rta.states:
            continue
        if starts != [SimAttributeAccessor(attribute_name=f"{name}.sun_angle")]:
            text = f"`{name}` tests initial states with a sun angle that it samples, but the sun starts at another one"
            place = (*ENVIRONMENT_PATH, "simulator_reset_parameters", "additional_entities", "sun", "config", "theta")
            report(place, f"{text}; use a SimAttributeAccessor of `{name}.sun_angle`")


def _moving_bodies(simulator: Simulator, reset: ResetPlan) -> Iterator[str]:
    """Yield the bodies that components act on and that are not at rest at the origin."""
    for name in {body: None for component in simulator.compose()[1] for body in component.bodies}:
        body = reset.entities.get(name)
        if body is not None and not _rests_at_origin(body):
            yield name


def _rests_at_origin(body: BodyReset) -> bool:
    values: dict[str, FloatArray] = {}
    for name, parameter in body.parameters.items():
        if not isinstance(parameter, ConstantParameter):
            return False
        values[name] = np.array([parameter.value * parameter.factor])
    states = body.initializer(values)
    return not any(states[name].any() for name in ("position", "velocity") if name in states)


def _check_thrusters(entry: AgentEntry, where: KeyTuple, report: ReportProblem) -> None:
    """Check that the controllers can apply thrust along each axis, as the filters assume."""
    least, largest = np.zeros(3), np.zeros(3)
    for part in entry.body.parts:
        if isinstance(part, Controller) and part.control_size == 3:
            low, high = part.limits
            shares = [part(limit[None])[0] for limit in (low, high)]
            least, largest = least + np.minimum(*shares), largest + np.maximum(*shares)
    missing = [_AXES[k] for k in range(3) if not (least[k] < 0.0 < largest[k])]
    if missing:
        axes = " and ".join(missing)
        text = f"the safety filter needs thrust along all axes, but {entry.name} has no controller along {axes}"
        report(where, f"{text}; add one, or disable the filter")


def _check_ends(
    plugin: Any, entry: AgentEntry, base: KeyTuple, config: ExperimentConfig, reset: ResetPlan, report: ReportProblem
) -> None:
    """Check that a done function does not end an episode as lost in states that the filter allows."""
    kept, parts = kept_by(plugin), entry.body.parts
    orbit = config.environment.simulator.compose()[0].offers().get("mean_motion", 0.0)
    far = kept["r_max"].r_max if "r_max" in kept else 0.0
    for index, named in enumerate(entry.body.dones):
        done, where = named.functor, (*base, "dones", index, "config")
        if isinstance(done, CrashDoneFunction) and _check_crash(plugin, done, orbit, where, report):
            _check_references(done, parts, reset, where, report)
        if isinstance(done, MaxDistanceDoneFunction) and far:
            _check_references(done, parts, reset, where, report)
            if done.max_distance < far:
                text = f"a deputy loses beyond {done.max_distance:g} m, but the filter allows up to {far:g} m"
                report((*where, "max_distance"), f"{text}; lower the filter's `r_max`, or raise this value")


def _check_crash(plugin: Any, done: CrashDoneFunction, orbit: float, where: KeyTuple, report: ReportProblem) -> bool:
    """Check that a crash is not within what the filter allows; return whether the filter prevents crashes."""
    kept, radius, limit = kept_by(plugin), done.crash_region_radius, done.velocity_constraint
    near = kept["chief_collision"].collision_radius if "chief_collision" in kept else 0.0
    if near:
        if radius > near:
            text = f"a deputy crashes within {radius:g} m of the chief, but the filter only keeps it beyond {near:g} m"
            report((*where, "crash_region_radius"), f"{text}; raise the filter's `collision_radius`, or lower this")
        return True
    fastest = _speed_limit(plugin, kept, orbit, radius)
    if limit is None or limit.lower_bound or math.isinf(fastest):
        return False
    slope = limit.slope * (orbit if limit.mean_motion is None else limit.mean_motion)
    allowed = limit.velocity_threshold + slope * max(radius - limit.threshold_distance, 0.0)
    if allowed < fastest and not math.isclose(allowed, fastest, rel_tol=1e-9):
        lost, flown = distinct(allowed, fastest)
        text = f"a deputy crashes if it reaches {radius:g} m faster than {lost} m/s, but the filter allows {flown} m/s"
        report((*where, "velocity_constraint"), f"{text} there; lower the filter's limit, or raise this value")
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


def _check_references(
    done: Any, parts: Sequence[Part], reset: ResetPlan, where: KeyTuple, report: ReportProblem
) -> None:
    """Check that a done function measures from a body at rest at the origin, as the filter assumes."""
    known = {part.part_name: part for part in parts}
    for field, kind in done.references().items():
        name = getattr(done, field)
        if kind != "sensor" or name is None:
            continue
        sensor = known.get(name)
        body = None
        if isinstance(sensor, EntityPositionSensor | EntityVelocitySensor):
            body = reset.entities.get(sensor.entity_name)
        if body is None or not _rests_at_origin(body):
            text = f"the filter assumes a chief at rest at the origin, but {name!r} does not read such a body"
            report((*where, field), f"{text}; name a sensor of such a body, remove this key, or disable the filter")
