"""Completion of an inspection, and whether coasting is safe afterwards."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from safe_inspect.compiling import njit
from safe_inspect.dynamics.coasting import grid, least_coasting_range
from safe_inspect.plugins.plugin import Plugin, PointsName
from safe_inspect.simulators.row_terms import EnvironmentArray, OwnArray, RowInput, RowTerm
from safe_inspect.simulators.world import World
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveAngularRate, PositiveDuration, PositiveLength


@njit
def has_reached(value: float, limit: float) -> bool:
    """Return whether a number is at least a limit."""
    return value >= limit


@njit
def _verdict(
    rule: FloatArray, inspected: float, limit: float, position: FloatArray, velocity: FloatArray, table: FloatArray
) -> float:
    """Return rule[2] if the inspection is complete and coasting is safe, rule[3] if it is unsafe, 0 before completion.

    Coasting is safe if the range stays at rule[1] [m] or above, for the mean motion rule[0] [rad/s].
    """
    if inspected < limit:
        return 0.0
    clear = least_coasting_range(position, velocity, table, rule[0]) >= rule[1]
    verdict: float = rule[2] if clear else rule[3]
    return verdict


class Completion(Plugin):
    """Fields of the plugins that test whether an inspection is complete.

    Attributes:
        inspection_entity_name: Name of the body with the points.
        weight_threshold: Total weight of inspected points that is sufficient, in (0, 1]; None requires all points.
    """

    inspection_entity_name: PointsName = "chief"
    weight_threshold: Annotated[float | None, Field(gt=0, le=1)] = None

    def completion(self, world: World) -> tuple[RowInput, RowInput]:
        """Return the present and the required amount of inspection, the inputs of `has_reached`."""
        entity = self.inspection_entity_name
        if self.weight_threshold is None:
            return EnvironmentArray(f"points/{entity}/team_count"), float(world.points[entity].num_points)
        return EnvironmentArray(f"points/{entity}/team_score"), self.weight_threshold


class PassiveSafety(Completion):
    """Fields of the plugins that test whether a deputy that coasts for an orbit stays away from the origin.

    The least range is that of the closed-form motion over all times; see `least_coasting_range`.

    Attributes:
        crash_region_radius: Smallest range [m].
        mean_motion: Mean motion of the chief's orbit [rad/s]; by default, that of the simulator.
        fft_time_step: Key of safe-autonomy-sims, the step of its grid of times [s]; no effect, all times are tested.
    """

    crash_region_radius: PositiveLength = 10.0
    mean_motion: PositiveAngularRate | None = None
    fft_time_step: PositiveDuration = 1.0

    def verdict(self, world: World, safe: float, unsafe: float) -> RowTerm:
        """Return the row kernel: 0 before the inspection is complete, then a number that depends on coasting.

        Args:
            world: The constant data of the simulation.
            safe: The number if the deputy would stay away from the origin.
            unsafe: The number if it would not.
        """
        n = float(world.mean_motion if self.mean_motion is None else self.mean_motion)
        rule = np.array([n, self.crash_region_radius, safe, unsafe])
        coasting = OwnArray("position"), OwnArray("velocity"), grid(n, 2.0 * math.pi / n)
        return RowTerm(_verdict, (rule, *self.completion(world), *coasting))
