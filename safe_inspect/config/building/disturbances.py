"""What disturbs the motion that a safety filter assumes, and whether the filter tolerates it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from safe_inspect.config.building.world import WorldValues
from safe_inspect.config.loading.located import Place
from safe_inspect.dynamics.base import NO_DISTURBANCE, DisturbanceBounds, MotionLimits
from safe_inspect.errors import SafetyFilterWarning
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rta.constraints.parameters import TaskParameters
from safe_inspect.simulators.simulator import Simulator


@dataclass(frozen=True)
class Disturbances:
    """The disturbances of a simulation within the limits of the motion that a safety filter allows.

    Attributes:
        limits: These limits.
        bounds: Bounds of the disturbance by each part of the simulation; None if it has none for these limits.
    """

    limits: MotionLimits
    bounds: Mapping[str, DisturbanceBounds | None]

    @property
    def total(self) -> DisturbanceBounds:
        """Bounds of all parts together, without those that have none."""
        return sum((found for found in self.bounds.values() if found is not None), start=NO_DISTURBANCE)

    @property
    def unknown(self) -> list[str]:
        """Names of the parts that have no bounds."""
        return [name for name, found in self.bounds.items() if found is None]

    def by(self, field: str) -> list[str]:
        """Return the names of the parts that contribute to a field of the total."""
        return [name for name, found in self.bounds.items() if found and getattr(found, field) > 0.0]


def disturbances(simulator: Simulator, plugin: Any, step_size: float, mass: float, thrust: float) -> Disturbances:
    """Return what disturbs the motion that a safety filter assumes.

    Args:
        simulator: The simulator.
        plugin: The filter, for deputies of `mass` [kg] with a `thrust` [N] along each axis.
        step_size: Length of a step of the agents [s].
        mass: Mass of a deputy [kg].
        thrust: Largest thrust along each axis [N].
    """
    dynamics, components = simulator.compose()
    sources: list[Any] = [*simulator.disturbance, *components]
    if isinstance(plugin, TaskParameters):  # the assumptions of other filters are not known
        sources.append(dynamics)
    limits = MotionLimits(step_size, mass, thrust, *_reach(kept_by(plugin)))
    return Disturbances(limits, {source.registered_name: _bounds_of(source, limits) for source in sources})


def kept_by(plugin: Plugin) -> Mapping[str, Any]:
    """Return the constraints that a filter guarantees, by name; empty for other plugins."""
    kept: Mapping[str, Any] = getattr(plugin, "kept", {})
    return kept


def required(total: DisturbanceBounds) -> str:
    """Return the field `disturbance` that a filter needs, as YAML; the numbers are rounded up to two digits."""
    pairs = zip(DisturbanceBounds.model_fields, total.bounds, strict=True)
    return ", ".join(f"{name}: {_rounded_up(value):g}" for name, value in pairs if value > 0.0)


def check_motion(plugin: Any, place: Place, simulator: Simulator, worlds: Sequence[WorldValues]) -> None:
    """Check that a filter allows for every disturbance of the motion that it assumes."""
    if getattr(plugin, "method", None) == "continuous":
        return
    tolerated = getattr(plugin, "disturbance", None)
    silent, exceeded = dict[str, None](), dict[str, tuple[float, list[str]]]()
    for world in worlds:
        found = disturbances(simulator, plugin, world["step_size"], world["m"], world.get("u_max", 0.0))
        silent |= dict.fromkeys(found.unknown)
        for field in (tolerated or NO_DISTURBANCE).exceeded(found.total):
            exceeded[field] = getattr(found.total, field), found.by(field)
    if silent:
        text = f"{' and '.join(silent)} may change the motion that the filter assumes, but has no "
        text += "`disturbance_bounds` for this flight"
        if plugin.undeclared == "warn":
            warnings.warn(f"{text}: the filter gives no guarantee", SafetyFilterWarning, stacklevel=2)
        else:
            remedy = "declare them, disable the filter, or accept that it gives no guarantee with `undeclared: warn`"
            place.report(f"{text}; {remedy}", "enabled")
    if exceeded and tolerated is None:
        by = " and ".join(dict.fromkeys(name for _, names in exceeded.values() for name in names))
        text = f"the simulation is disturbed by {by}, and this filter gives no guarantee then; "
        if "disturbance" in type(plugin).model_fields:
            asked = NO_DISTURBANCE.model_copy(update={field: value for field, (value, _) in exceeded.items()})
            place.report(f"{text}give the filter `disturbance: {{{required(asked)}}}`, or disable it", "disturbance")
        else:
            place.report(f"{text}disable the filter, or remove the disturbance", "enabled")
        return
    for field, (value, names) in exceeded.items():
        text = f"the simulation's `{field}` is {value:g}, from {' and '.join(names)}, which exceeds this bound"
        place.report(f"{text}; raise the bound, or lower the disturbance", "disturbance", field)


def _bounds_of(source: Any, limits: MotionLimits) -> DisturbanceBounds | None:
    try:
        found: DisturbanceBounds | None = source.disturbance_bounds(limits)
    except ValueError:  # a disturbance that grows with the range is unbounded if the range is
        return None
    return found


def _rounded_up(value: float) -> float:
    """Return a positive number, rounded up to two digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.ceil(value / unit - 1e-9) * unit


def _reach(kept: Mapping[str, Any]) -> tuple[float, float]:
    """Return the largest distance [m] and speed [m/s] that a filter allows; infinite if it has no such constraint."""
    axes = [kept[name].vel_limit if name in kept else math.inf for name in ("x_vel", "y_vel", "z_vel")]
    return kept["r_max"].r_max if "r_max" in kept else math.inf, math.hypot(*axes)
