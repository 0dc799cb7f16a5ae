"""What fields of plugins may name (`SensorName`, `EntityName`, ...): the names of an environment by kind."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from safe_inspect.dones.base import DoneFunction
from safe_inspect.platforms.base import Controller, Part, Sensor
from safe_inspect.plugins.functor import Named
from safe_inspect.simulators.resets.plan import ResetPlan
from safe_inspect.simulators.simulator import Simulator


def world_names(platforms: Iterable[str], reset: ResetPlan, simulator: Simulator) -> dict[str, set[str]]:
    """Return the names that all agents share, by kind: entities, platforms, and the bodies that components act on."""
    platforms = set(platforms)
    return {
        "entity": {*platforms, *reset.entities},
        "platform": platforms,
        "points": {name for component in simulator.compose()[1] for name in component.bodies},
    }


def agent_names(parts: Mapping[str, Part], dones: Iterable[Named[DoneFunction]]) -> dict[str, set[str]]:
    """Return the names that belong to one agent, by kind: sensors, controllers and done functions."""
    return {
        "sensor": {name for name, part in parts.items() if isinstance(part, Sensor)},
        "controller": {name for name, part in parts.items() if isinstance(part, Controller)},
        "done": {named.name for named in dones},
    }
