"""What would void the guarantee of a safety filter that is enabled, found before the first step."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from typing import Any

import numpy as np

from safe_inspect.config.building.reporting import KeyTuple, ReportProblem
from safe_inspect.config.building.world import plugins_of
from safe_inspect.config.models.experiment import AgentEntry, ExperimentConfig
from safe_inspect.dones.range import CrashDoneFunction, MaxDistanceDoneFunction
from safe_inspect.dones.shared import CollisionDoneFunction
from safe_inspect.platforms.base import Controller
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.rta.constraints.parameters import TaskParameters
from safe_inspect.rta.constraints.sets import name_of
from safe_inspect.simulators.component import Component
from safe_inspect.simulators.resets.parameters import ConstantParameter
from safe_inspect.simulators.resets.plan import BodyReset, ResetPlan
from safe_inspect.simulators.simulator import Simulator
from safe_inspect.tasks.disturbances.bounds import DisturbanceBounds
from safe_inspect.tasks.inspection.sun import Sun
from safe_inspect.types import FloatArray

_ENVIRONMENT: KeyTuple = ("config", "config", "env_config")
_AXES = "xyz"


def check_guarantees(config: ExperimentConfig, reset: ResetPlan, report: ReportProblem) -> None:
    """Check that each enabled safety filter keeps what the simulation, the controllers and the done functions ask.

    The method ``continuous`` gives no guarantee and is not checked.

    Args:
        config: The validated models.
        reset: What initial states are drawn from.
        report: Takes the path and the message of every mistake that is found.
    """
    environment = config.config.config.env_config
    for index, entry in enumerate(config.agent_config):
        base = ("agent_config", index, "config", "config")
        own = [(path, plugin) for path, plugin in plugins_of(entry, base) if _filters(plugin)]
        for path, _ in own[1:]:
            text = "another safety filter of this agent is enabled, and only one would act"
            report((*path, "config", "enabled"), f"{text}; name the constraints of both in one of them")
        for path, plugin in own[:1]:
            _check_filter(plugin, (*path, "config"), config, reset, report)
            if isinstance(plugin, TaskParameters):  # those of other packages may use fewer axes
                _check_thrusters(entry, (*path, "config", "enabled"), report)
            _check_ends(plugin, entry, base, report)
    team = environment.rta
    if team is not None and team.enabled:
        _check_filter(team, (*_ENVIRONMENT, "rta", "config"), config, reset, report)
        for index, entry in enumerate(config.agent_config):
            base = ("agent_config", index, "config", "config")
            _check_thrusters(entry, (*base, "parts"), report)
            _check_ends(team, entry, base, report)


def _filters(plugin: Plugin) -> bool:
    return isinstance(plugin, SafetyGlue) and plugin.enabled


def _kept(plugin: Plugin) -> Collection[str]:
    """Return the names of the constraints that a filter guarantees."""
    if not isinstance(plugin, TaskParameters) or getattr(plugin, "method", None) == "continuous":
        return ()
    return {name_of(entry) for entry in getattr(plugin, "constraints", ())}


def _check_filter(
    plugin: Any, where: KeyTuple, config: ExperimentConfig, reset: ResetPlan, report: ReportProblem
) -> None:
    environment, kept = config.config.config.env_config, _kept(plugin)
    components = environment.simulator.compose()[1]
    orbit = environment.simulator.compose()[0].offers().get("mean_motion")
    _check_disturbance(plugin, where, environment.simulator.disturbance, report)
    for sun in components:
        if "sun" in kept and isinstance(sun, Sun) and orbit and not math.isclose(sun.rate, orbit, rel_tol=1e-9):
            text = f"the constraint `sun` needs a sun that turns once an orbit, at {orbit:g} rad/s, and this one turns "
            report((*where, "constraints"), f"{text}at {sun.rate:g} rad/s; make them agree, or leave `sun` out")
    if kept:
        for name in _moving_bodies(environment.simulator, reset):
            text = f"the filter keeps deputies safe about the origin, and {name!r} does not rest there"
            report((*where, "enabled"), f"{text}; let it begin at rest at the origin, or switch the filter off")
    for index, named in enumerate(environment.dones.shared):
        apart = 2.0 * getattr(plugin, "deputy_radius", 0.0)
        done = named.functor
        if "deputy_collision" in kept and isinstance(done, CollisionDoneFunction) and done.safety_constraint > apart:
            text = f"deputies collide within {done.safety_constraint:g} m, and the filter keeps them {apart:g} m apart"
            place = (*_ENVIRONMENT, "dones", "shared", index, "config", "safety_constraint")
            report(place, f"{text}; lower this, or raise the filter's `deputy_radius`")


def _check_disturbance(plugin: Any, where: KeyTuple, disturbance: Component | None, report: ReportProblem) -> None:
    """Check that a filter withstands what disturbs the simulation."""
    if disturbance is None or getattr(plugin, "method", None) == "continuous":
        return
    bounds = getattr(plugin, "disturbance", None)
    if bounds is None:
        text = "the simulation is disturbed, and this filter promises nothing then; "
        if "disturbance" in type(plugin).model_fields:
            report((*where, "disturbance"), f"{text}give it the bounds, or switch it off")
        else:
            report((*where, "enabled"), f"{text}switch it off, or remove the simulator's `disturbance`")
    elif isinstance(disturbance, DisturbanceBounds):
        for name in bounds.exceeded(disturbance):
            text = f"the simulator's `{name}` is {getattr(disturbance, name):g}, beyond this bound"
            report((*where, "disturbance", name), f"{text}; raise it, or lower the simulator's")


def _moving_bodies(simulator: Simulator, reset: ResetPlan) -> Iterator[str]:
    """Yield the bodies that components act on and that do not rest at the origin."""
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
    """Check that the controllers can give thrust along each axis, as the filters plan with."""
    least, largest = np.zeros(3), np.zeros(3)
    for part in entry.config.config.parts:
        if isinstance(part, Controller) and part.control_size == 3:
            low, high = part.limits
            shares = [part(limit[None])[0] for limit in (low, high)]
            least, largest = least + np.minimum(*shares), largest + np.maximum(*shares)
    missing = [_AXES[k] for k in range(3) if not (least[k] < 0.0 < largest[k])]
    if missing:
        axes = " and ".join(missing)
        text = f"the safety filter thrusts along all axes, and {entry.name} has no controller along {axes}"
        report(where, f"{text}; add one, or switch the filter off")


def _check_ends(plugin: Any, entry: AgentEntry, base: KeyTuple, report: ReportProblem) -> None:
    """Check that an episode is not lost within what the filter allows."""
    kept = _kept(plugin)
    for index, named in enumerate(entry.config.config.dones):
        done, where = named.functor, (*base, "dones", index, "config")
        crashes = "chief_collision" in kept and isinstance(done, CrashDoneFunction)
        if crashes and done.crash_region_radius > plugin.collision_radius:
            text = f"a deputy crashes within {done.crash_region_radius:g} m of the chief, and the filter keeps it only "
            text += f"beyond {plugin.collision_radius:g} m"
            report((*where, "crash_region_radius"), f"{text}; raise the filter's `collision_radius`, or lower this")
        if "r_max" in kept and isinstance(done, MaxDistanceDoneFunction) and done.max_distance < plugin.r_max:
            text = f"a deputy is lost beyond {done.max_distance:g} m, and the filter lets it fly to {plugin.r_max:g} m"
            report((*where, "max_distance"), f"{text}; lower the filter's `r_max`, or raise this")
