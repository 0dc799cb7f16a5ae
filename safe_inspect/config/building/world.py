"""Values that plugins take from the world and must not contradict: the step, the orbit, the mass and the thrust."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from pydantic import ValidationError

from safe_inspect.config.loading.located import Place
from safe_inspect.config.models import ENVIRONMENT_PATH, AgentEntry, ExperimentConfig
from safe_inspect.config.report import text_of
from safe_inspect.platforms.base import Controller, Platform
from safe_inspect.plugins import Plugin
from safe_inspect.plugins.functor import Named
from safe_inspect.rta.base import SafetyGlue, TeamSafety
from safe_inspect.rta.constraints.parameters import FromWorld, TaskParameters
from safe_inspect.rta.rejection_sampler import RejectionSampler
from safe_inspect.simulators.resets.plan import ResetPlan
from safe_inspect.simulators.simulator import Simulator
from safe_inspect.types import FloatArray

#: Values of an agent's world, by the names in `TaskParameters`, in SI units.
WorldValues = Mapping[str, float]

_P = TypeVar("_P", bound=Plugin)

_SOURCES = {
    "n": "the simulator's `mean_motion`",
    "step_size": "1 / `frame_rate`",
    "m": "the platform's `mass`",
    "swept_radius": "that of the simulator's bodies",
}


def worlds_of(config: ExperimentConfig, platforms: Mapping[str, Platform]) -> list[WorldValues]:
    """Return the world of each agent: step, orbit, mass, size of the bodies, and thrust of its controllers."""
    dynamics, components = config.environment.simulator.compose()
    offered, spheres = dynamics.offers(), [radius for component in components for radius in component.radii.values()]
    worlds: list[WorldValues] = []
    for entry in config.agent_config:
        world = {"step_size": 1.0 / entry.body.frame_rate}
        if "mean_motion" in offered:
            world["n"] = offered["mean_motion"]
        if spheres:
            world["swept_radius"] = max(spheres)
        if entry.platforms and entry.platforms[0] in platforms:
            world["m"] = platforms[entry.platforms[0]].mass
        limits = _thrust_limits(entry)
        thrust = min((float(min((-low).min(), high.min())) for low, high in limits), default=0.0)
        if thrust > 0.0:
            world["u_max"] = thrust
        worlds.append(world)
    return worlds


def _thrust_limits(entry: AgentEntry) -> list[tuple[FloatArray, FloatArray]]:
    """Return smallest and largest thrusts of an agent's controllers [N], without those that command moments."""
    parts = entry.body.parts
    return [part.limits for part in parts if isinstance(part, Controller) and part.control_size == 3]


def common_world(worlds: Sequence[WorldValues]) -> WorldValues:
    """Return the world that all agents share: the values that are equal, and the smallest thrust."""
    common = {name: value for name, value in worlds[0].items() if all(world.get(name) == value for world in worlds)}
    if all("u_max" in world for world in worlds):
        common["u_max"] = min(world["u_max"] for world in worlds)
    return common


def in_world(plugin: _P, world: WorldValues, place: Place) -> _P:
    """Return a plugin whose missing fields are taken from the world if it is a `FromWorld`; others are unchanged.

    Only an enabled filter depends on the thrust; other agents may have thrusters that are too weak for a filter.
    """
    if not isinstance(plugin, FromWorld):
        return plugin
    if not getattr(plugin, "enabled", False):
        world = {name: value for name, value in world.items() if name != "u_max"}
    try:
        return plugin.in_world(world)
    except ValidationError as error:
        for problem in error.errors(include_url=False):
            place.report(f"with the values of the simulation: {text_of(problem)}", "config", *problem["loc"])
        return plugin


def reset_in_world(reset: ResetPlan, world: WorldValues, environment: Place) -> ResetPlan:
    """Return the plan with the samplers' safety tests in the world."""
    tested = {
        name: sampler.model_copy(update={"rta": sampler.rta.with_glue(in_world(sampler.rta.glue, world, place))})
        for name, sampler, place in _tests(reset, environment)
    }
    return replace(reset, parameters={**reset.parameters, **tested})


def _tests(reset: ResetPlan, environment: Place) -> Iterator[tuple[str, Any, Place]]:
    """Yield the name of each sampler with a safety test, the sampler, and the position of its test."""
    for name, parameter in reset.parameters.items():
        if isinstance(parameter, RejectionSampler) and parameter.rta is not None:
            yield name, parameter, environment.at("simulator_reset_parameters", name, "config", "rta")


def check_world(config: ExperimentConfig, reset: ResetPlan, worlds: Sequence[WorldValues], root: Place) -> None:
    """Check that the step, mass, orbit and thrust that plugins assume are those of the simulation."""
    environment, place = config.environment, root.at(*ENVIRONMENT_PATH)
    common = common_world(worlds)
    shared: list[tuple[Place, Plugin]] = []
    if environment.rta is not None and environment.rta.enabled:
        shared.append((place.at("rta"), environment.rta))
    shared += [(where, sampler.rta.glue) for _, sampler, where in _tests(reset, place)]
    for index, entry in enumerate(config.agent_config):
        own = plugins_of(entry, root.at("agent_config", index, "config", "config"))
        taken = [(where, plugin, worlds[index]) for where, plugin in own]
        for where, plugin, world in taken + [(where, plugin, common) for where, plugin in shared]:
            _check_filter(plugin, environment.simulator, world, worlds[index], entry, where.at("config"))
            _check_values(plugin, world, worlds[index], where.at("config"))


def _check_filter(
    plugin: Any, simulator: Simulator, taken: WorldValues, world: WorldValues, entry: AgentEntry, place: Place
) -> None:  # fmt: skip
    """Check that what a safety filter assumes about bodies, dynamics and thrust holds in the simulation."""
    dynamics, components = simulator.compose()
    radius = _value(getattr(plugin, "kept", {}).get("chief_collision", plugin), "collision_radius", taken)
    for name, own in (pair for component in components for pair in component.radii.items()):
        if radius is not None and radius < own:
            text = f"`collision_radius` is {radius:g} m, inside the sphere of {name!r} ({own:g} m)"
            place.report(f"{text}; make it at least as large as that", "collision_radius")
    if not isinstance(plugin, SafetyGlue | TeamSafety) or not plugin.enabled:
        return
    if plugin.dynamics and dynamics.registered_name not in plugin.dynamics:
        text = f"the filter assumes {' or '.join(plugin.dynamics)} dynamics, but these deputies move by "
        place.report(f"{text}{dynamics.registered_name}; disable the filter", "enabled")
    elif isinstance(plugin, TaskParameters) and "n" not in world:
        text = "the filter assumes Clohessy-Wiltshire dynamics, but these deputies move by "
        place.report(f"{text}{dynamics.registered_name}; disable the filter", "enabled")
    elif simulator.turns:
        text = "the filter assumes thrust along the axes of Hill's frame, but these deputies have an attitude"
        place.report(f"{text}; disable the filter", "enabled")
    simulated = {component.registered_name for component in components}
    for name in (name for name in plugin.components if name not in simulated):
        place.report(
            f"the filter needs the component `{name}`; add it to the simulator, or disable the filter", "enabled"
        )
    thrust = _value(plugin, "u_max", taken)
    if thrust is not None and any(thrust > min((-low).min(), high.min()) for low, high in _thrust_limits(entry)):
        text = f"the filter assumes {thrust:g} N along each axis, which a controller cannot apply"
        place.report(f"{text}; lower `u_max`, or raise the controller's limits", "u_max")


def _check_values(plugin: Plugin, taken: WorldValues, world: WorldValues, place: Place) -> None:
    """Check that the values of a plugin are those of the world."""
    for field in ("n", "step_size", "mass", "m", "swept_radius"):
        source = "m" if field == "mass" else field
        given, value = _value(plugin, field, taken), world.get(source)
        if given is not None and value is not None and not math.isclose(given, value, rel_tol=1e-9):
            here, there = distinct(given, value)
            place.report(f"`{field}` is {here} here, but {_SOURCES[source]} is {there}; use the same value", field)


def plugins_of(entry: AgentEntry, inside: Place) -> Iterator[tuple[Place, Plugin]]:
    """Yield every plugin of an agent that may refer to others by name, with its position."""
    for key in ("parts", "glues", "rewards", "dones"):
        for index, item in enumerate(getattr(entry.body, key)):
            yield from _nested(inside.at(key, index), item.functor if isinstance(item, Named) else item)


def _nested(place: Place, plugin: Plugin) -> Iterator[tuple[Place, Plugin]]:
    """Yield a plugin and those that it wraps, which are one plugin, a list or a mapping."""
    yield place, plugin
    wrapped: Any = getattr(plugin, "wrapped", ())
    if isinstance(wrapped, Plugin):
        yield from _nested(place.at("wrapped"), wrapped)
        return
    for key, inner in wrapped.items() if isinstance(wrapped, Mapping) else enumerate(wrapped):
        yield from _nested(place.at("wrapped", key), inner)


def distinct(one: float, other: float) -> tuple[str, str]:
    """Return two numbers with six digits, or with as many as are needed to tell them apart."""
    for digits in range(6, 18):
        texts = f"{one:.{digits}g}", f"{other:.{digits}g}"
        if texts[0] != texts[1]:
            break
    return texts


def _value(plugin: Plugin, field: str, world: WorldValues) -> float | None:
    """Return a field of a plugin, or of the world if it is taken from there; None if there is nothing to compare.

    A disabled filter has no value for a field that is not given, because the deputies of a team may differ.
    """
    if field not in type(plugin).model_fields:
        return None
    if isinstance(plugin, FromWorld) and field not in plugin.model_fields_set:
        if field in world:
            return world[field]
        if field in _SOURCES and not getattr(plugin, "enabled", False):
            return None
    value: float | None = getattr(plugin, field)
    return value
