"""Values that plugins take from the world and must not contradict: the step, the orbit, the mass and the thrust."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from pydantic import ValidationError

from safe_inspect.config.messages.messages import text_of
from safe_inspect.config.messages.report import ENVIRONMENT_PATH, KeyTuple, ReportProblem
from safe_inspect.config.models.experiment import AgentEntry, ExperimentConfig
from safe_inspect.platforms.base import Controller, Platform
from safe_inspect.plugins import Plugin
from safe_inspect.rta.base import SafetyGlue, TeamSafety
from safe_inspect.rta.constraints.parameters import TaskParameters
from safe_inspect.rta.rejection_sampler import RejectionSampler
from safe_inspect.simulators.resets.plan import ResetPlan
from safe_inspect.types import FloatArray

#: Values of an agent's world, by the names in `TaskParameters`, in SI units.
WorldValues = Mapping[str, float]

_P = TypeVar("_P", bound=Plugin)

_SOURCES = {"n": "the simulator's `mean_motion`", "step_size": "1 / `frame_rate`", "m": "the platform's `mass`"}


def worlds_of(config: ExperimentConfig, platforms: Mapping[str, Platform]) -> list[WorldValues]:
    """Return the world of each agent: step, mean motion, mass, and the thrust that its controllers can apply."""
    offered = config.environment.simulator.compose()[0].offers()
    worlds: list[WorldValues] = []
    for entry in config.agent_config:
        world = {"step_size": 1.0 / entry.body.frame_rate}
        if "mean_motion" in offered:
            world["n"] = offered["mean_motion"]
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


def in_world(plugin: _P, world: WorldValues, where: KeyTuple, report: ReportProblem) -> _P:
    """Return a plugin whose missing fields of `TaskParameters` are taken from the world; other plugins are unchanged.

    Only an enabled filter depends on the thrust; other agents may have thrusters that are too weak for a filter.
    """
    if not isinstance(plugin, TaskParameters):
        return plugin
    if not getattr(plugin, "enabled", False):
        world = {name: value for name, value in world.items() if name != "u_max"}
    try:
        return plugin.in_world(world)
    except ValidationError as error:
        for problem in error.errors(include_url=False):
            report((*where, "config", *problem["loc"]), f"with the values of the simulation: {text_of(problem)}")
        return plugin


def reset_in_world(reset: ResetPlan, world: WorldValues, report: ReportProblem) -> ResetPlan:
    """Return the plan with the samplers' safety tests in the world."""
    parameters = dict(reset.parameters)
    for name, parameter in parameters.items():
        if isinstance(parameter, RejectionSampler) and parameter.rta is not None:
            glue = in_world(parameter.rta.glue, world, _sampler(name), report)
            parameters[name] = parameter.model_copy(update={"rta": parameter.rta.with_glue(glue)})
    return replace(reset, parameters=parameters)


def check_world(
    config: ExperimentConfig, reset: ResetPlan, worlds: Sequence[WorldValues], report: ReportProblem
) -> None:  # fmt: skip
    """Check that the step, mass, orbit and thrust that plugins assume are those of the simulation."""
    environment = config.environment
    common = common_world(worlds)
    shared: list[tuple[KeyTuple, Plugin]] = []
    if environment.rta is not None and environment.rta.enabled:
        shared.append(((*ENVIRONMENT_PATH, "rta"), environment.rta))
    for name, parameter in reset.parameters.items():
        if isinstance(parameter, RejectionSampler) and parameter.rta is not None:
            shared.append((_sampler(name), parameter.rta.glue))
    dynamics, components = environment.simulator.compose()
    bodies = {name: radius for component in components for name, radius in component.radii.items()}
    for index, entry in enumerate(config.agent_config):
        world = worlds[index]
        base = ("agent_config", index, "config", "config")
        largest = _thrust_limits(entry)
        looked = [(path, plugin, world) for path, plugin in plugins_of(entry, base)]
        for path, plugin, taken in looked + [(path, plugin, common) for path, plugin in shared]:
            kept = getattr(plugin, "kept", {})
            radius = _value(kept.get("chief_collision", plugin), "collision_radius", taken)
            for name, own in bodies.items():
                if radius is not None and radius < own:
                    text = f"`collision_radius` is {radius:g} m, inside the sphere of {name!r} ({own:g} m)"
                    report((*path, "config", "collision_radius"), f"{text}; make it at least as large as that")
            filters = isinstance(plugin, SafetyGlue | TeamSafety) and plugin.enabled
            if filters and isinstance(plugin, TaskParameters) and "n" not in world:
                text = "the filter assumes Clohessy-Wiltshire dynamics, but these deputies move by "
                text += dynamics.registered_name
                report((*path, "config", "enabled"), f"{text}; disable the filter")
            elif filters and environment.simulator.turns:
                text = "the filter assumes thrust along the axes of Hill's frame, but these deputies have an attitude"
                report((*path, "config", "enabled"), f"{text}; disable the filter")
            thrust = _value(plugin, "u_max", taken)
            if filters and thrust is not None and any(thrust > min((-low).min(), high.min()) for low, high in largest):
                text = f"the filter assumes {thrust:g} N along each axis, which a controller cannot apply"
                report((*path, "config", "u_max"), f"{text}; lower `u_max`, or raise the controller's limits")
            for field in ("n", "step_size", "mass", "m"):
                source = "m" if field == "mass" else field
                given, value = _value(plugin, field, taken), world.get(source)
                if given is not None and value is not None and not math.isclose(given, value, rel_tol=1e-9):
                    here, there = distinct(given, value)
                    text = f"`{field}` is {here} here, but {_SOURCES[source]} is {there}; use the same value"
                    report((*path, "config", field), text)


def plugins_of(entry: AgentEntry, base: KeyTuple) -> Iterator[tuple[KeyTuple, Plugin]]:
    """Yield every plugin of an agent that may refer to others by name, with its path."""
    body = entry.body
    for key in ("parts", "glues"):
        for index, plugin in enumerate(getattr(body, key)):
            yield from _nested((*base, key, index), plugin)
    for key in ("rewards", "dones"):
        for index, named in enumerate(getattr(body, key)):
            yield from _nested((*base, key, index), named.functor)


def _nested(path: KeyTuple, plugin: Plugin) -> Iterator[tuple[KeyTuple, Plugin]]:
    """Yield a plugin and those that it wraps, which are one plugin, a list or a mapping."""
    yield path, plugin
    wrapped: Any = getattr(plugin, "wrapped", ())
    if isinstance(wrapped, Plugin):
        yield from _nested((*path, "wrapped"), wrapped)
        return
    for key, inner in wrapped.items() if isinstance(wrapped, Mapping) else enumerate(wrapped):
        yield from _nested((*path, "wrapped", key), inner)


def distinct(one: float, other: float) -> tuple[str, str]:
    """Return two numbers with six digits, or with as many as are needed to tell them apart."""
    for digits in range(6, 18):
        texts = f"{one:.{digits}g}", f"{other:.{digits}g}"
        if texts[0] != texts[1]:
            break
    return texts


def _sampler(name: str) -> KeyTuple:
    return (*ENVIRONMENT_PATH, "simulator_reset_parameters", name, "config", "rta")


def _value(plugin: Plugin, field: str, world: WorldValues) -> float | None:
    """Return a field of a plugin, or of the world if it is taken from there; None if there is nothing to compare.

    A disabled filter has no value for a field that is not given, because the deputies of a team may differ.
    """
    if field not in type(plugin).model_fields:
        return None
    if isinstance(plugin, TaskParameters) and field not in plugin.model_fields_set:
        if field in world:
            return world[field]
        if field in _SOURCES and not getattr(plugin, "enabled", False):
            return None
    value: float | None = getattr(plugin, field)
    return value
