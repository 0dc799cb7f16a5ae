"""What does not change while N environments run: names, sizes, points, light and constants."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

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
        lit: Function of viewer position relative to the centre [m] (R, 3) and sun direction (R, 3); it returns which
            points are lit well enough to be inspected from there, shape (R, P).
        candidates: Function of the same and of the points' inspectors (R, P); it returns which points are lit and not
            inspected, shape (R, P).
    """

    entity: str
    body: int
    points: FloatArray
    radius: float
    light: Light
    lit: Callable[[FloatArray, FloatArray], BoolArray]
    candidates: Callable[[FloatArray, FloatArray, AnyArray], BoolArray]

    @property
    def num_points(self) -> int:
        """Number of points, P."""
        return len(self.points)


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
