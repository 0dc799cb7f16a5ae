"""What does not change while N environments run: names, sizes, points, light and constants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from safe_inspect.geometry.light import Light
from safe_inspect.types import AnyArray, BoolArray, FloatArray


@dataclass(frozen=True)
class PointsModel:
    """The inspection points of one body.

    Attributes:
        entity: Name of the body.
        body: Index of the body in the state's body axis.
        points: Positions relative to the body's centre [m], Hill frame, shape (P, 3).
        radius: Radius of the sphere that carries them [m].
        light: The rule of light, for the compiled kernels.
    """

    entity: str
    body: int
    points: FloatArray
    radius: float
    light: Light

    @property
    def num_points(self) -> int:
        """Number of points, P."""
        return len(self.points)

    def lit(self, viewer: FloatArray, sun: FloatArray) -> BoolArray:
        """Return which points are lit well enough to be inspected, shape (R, P).

        Args:
            viewer: Position of the viewer relative to the centre [m], Hill frame, shape (R, 3).
            sun: Unit vector to the sun, Hill frame, shape (R, 3).
        """
        from safe_inspect.geometry.visibility import lit  # compiled: not when only validated

        found: BoolArray = lit(np.ascontiguousarray(viewer), sun, self.points, self.radius, self.light)
        return found

    def candidates(self, viewer: FloatArray, sun: FloatArray, inspector: AnyArray) -> BoolArray:
        """Return which points are lit well enough and not inspected, shape (R, P).

        Args:
            viewer: Position of the viewer relative to the centre [m], Hill frame, shape (R, 3).
            sun: Unit vector to the sun, Hill frame, shape (R, 3).
            inspector: Index of the deputy that inspected each point, -1 for none, shape (R, P).
        """
        from safe_inspect.geometry.visibility import lit_and_uninspected  # compiled: not when only validated

        viewer = np.ascontiguousarray(viewer)
        found: BoolArray = lit_and_uninspected(viewer, sun, self.points, self.radius, self.light, inspector)
        return found


@dataclass(frozen=True)
class World:
    """The constants of a simulation.

    Attributes:
        platforms: Names of the deputies, in agent order.
        bodies: Index of every body by name, the deputies first.
        masses: Mass of each deputy [kg], shape (D,).
        step_size: Length of a step [s].
        mean_motion: Mean motion of the chief's orbit [rad/s].
        points: Points by the body that carries them.
    """

    platforms: tuple[str, ...]
    bodies: Mapping[str, int]
    masses: FloatArray
    step_size: float
    mean_motion: float
    points: Mapping[str, PointsModel] = field(default_factory=dict)

    @property
    def num_deputies(self) -> int:
        """Number of deputies, D."""
        return len(self.platforms)
