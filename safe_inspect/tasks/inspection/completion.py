"""Completion of an inspection, and whether coasting is safe afterwards."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import Field

from safe_inspect.dynamics.coasting import grid
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators.row_terms.inputs import EnvironmentArray, OwnArray, RowInput
from safe_inspect.simulators.world import World
from safe_inspect.units import PositiveAngularRate, PositiveDuration, PositiveLength

#: Summed weight of inspected points that completes an inspection, in (0, 1]; None: all points are required.
WeightThreshold = Annotated[float | None, Field(gt=0, le=1)]


def completion(world: World, entity: str, weight_threshold: float | None) -> tuple[RowInput, RowInput]:
    """Return the required and the present amount of inspection, as inputs of a row kernel.

    Args:
        world: The constant data of the simulation.
        entity: The body that carries the points.
        weight_threshold: The summed weight that is required; None: all points.
    """
    if weight_threshold is None:
        return float(world.points[entity].num_points), EnvironmentArray(f"points/{entity}/team_count")
    return weight_threshold, EnvironmentArray(f"points/{entity}/team_score")


class PassiveSafety(Plugin):
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

    def coasting_inputs(self, world: World) -> tuple[float, float, Any, Any, Any]:
        """Return mean motion, smallest range, and the inputs of `least_coasting_range` except the last."""
        n = float(world.mean_motion if self.mean_motion is None else self.mean_motion)
        table = grid(n, 2.0 * math.pi / n)
        return n, self.crash_region_radius, OwnArray("position"), OwnArray("velocity"), table
