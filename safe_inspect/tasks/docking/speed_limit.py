"""Speed limit of docking, which is linear in the range, and entry into the docking region within a step."""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from safe_inspect.compiling import njit
from safe_inspect.geometry.distance import distance
from safe_inspect.plugins.plugin import Plugin, SensorName
from safe_inspect.simulators.row_terms import OwnArray, RowInput, SensorReading
from safe_inspect.simulators.world import World
from safe_inspect.types import FloatArray
from safe_inspect.units import NonNegativeLength, NonNegativeSpeed, PositiveAngularRate, PositiveLength


@njit
def speed_limit(line: FloatArray, distance: float) -> float:
    """Return the speed limit at a range [m/s].

    Args:
        line: Limit near the chief [m/s], range up to which it is valid [m], slope beyond that range [1/s], and 1, or -1
            if the limit is a lower bound; shape (4,).
        distance: The range [m].
    """
    limit: float = line[0] + line[2] * max(distance - line[1], 0.0)
    return limit


@njit
def speed_excess(line: FloatArray, distance: float, speed: float) -> float:
    """Return the amount by which a speed violates the limit at a range [m/s]; negative if it does not."""
    excess: float = line[3] * (speed - speed_limit(line, distance))
    return excess


class SpeedLimit(Plugin):
    """Fields of the plugins that use the speed limit of docking.

        L(r) = velocity_threshold + slope n max(r - threshold_distance, 0)

    Attributes:
        velocity_threshold: Speed limit up to `threshold_distance` [m/s].
        threshold_distance: Range up to which that limit is valid [m].
        slope: Slope beyond that range, as a multiple of the mean motion [-].
        mean_motion: Mean motion n of the chief's orbit [rad/s]; by default, that of the simulator.
        lower_bound: Whether the limit is a lower bound: a speed below it violates it.
    """

    velocity_threshold: NonNegativeSpeed = 0.2
    threshold_distance: NonNegativeLength = 0.5
    slope: float = Field(default=2.0, ge=0)
    mean_motion: PositiveAngularRate | None = None
    lower_bound: bool = False

    def limit_line(self, world: World) -> FloatArray:
        """Return the parameters that `speed_limit` takes, shape (4,)."""
        n = world.mean_motion if self.mean_motion is None else self.mean_motion
        sign = -1.0 if self.lower_bound else 1.0
        return np.array([self.velocity_threshold, self.threshold_distance, self.slope * n, sign])

    def region_rule(self, world: World, radius: float, along_step: bool) -> FloatArray:
        """Return the rule of `docking_outcome` for a region with a radius [m]; see `DockingRegion.rule`."""
        return np.concatenate([self.limit_line(world), [radius, world.step_size if along_step else 0.0]])


class ReferenceSensors(Plugin):
    """Fields of the plugins that measure a deputy's motion relative to a reference.

    Attributes:
        reference_position_sensor_name: Sensor of the reference's position; by default, the origin of Hill's frame.
        reference_velocity_sensor_name: Sensor of the reference's velocity; by default, the reference is at rest.
    """

    reference_position_sensor_name: SensorName | None = None
    reference_velocity_sensor_name: SensorName | None = None

    def reference_inputs(self) -> tuple[RowInput, RowInput]:
        """Return the position and velocity of the reference after the step, as inputs of a row kernel."""
        sensors = self.reference_position_sensor_name, self.reference_velocity_sensor_name
        position, velocity = (np.zeros(3) if name is None else SensorReading(name) for name in sensors)
        return position, velocity


class DockingRegion(ReferenceSensors, SpeedLimit):
    """Fields of the plugins that test whether a deputy reaches the docking region, and at which speed.

    Attributes:
        docking_region_radius: Radius of the region about the reference [m].
        along_step: True: the whole step is checked, so that a deputy cannot pass through the region undetected, and the
            speed is that on reaching it. False: only the end of the step is checked, as in safe-autonomy-sims.
    """

    docking_region_radius: PositiveLength = 0.5
    along_step: bool = True

    def rule(self, world: World) -> FloatArray:
        """Return the parameters of the speed limit, the radius [m], and the length of the step [s] or 0; shape (6,)."""
        return self.region_rule(world, self.docking_region_radius, self.along_step)

    def inputs(self) -> tuple[RowInput, ...]:
        """Return the inputs of `docking_outcome` after the rule."""
        return *own_motion(before=True), *own_motion(), *self.reference_inputs()


def own_motion(before: bool = False) -> tuple[RowInput, RowInput]:
    """Return the deputy's own position and velocity, as inputs of a row kernel.

    Args:
        before: Whether to read the values before the step.
    """
    return OwnArray("position", before), OwnArray("velocity", before)


#: A deputy within this distance of the region counts as inside [m].
TOLERANCE = 1e-4
#: Results of `docking_outcome`.
OUTSIDE, DOCKED, TOO_FAST = 0, 1, 2


@njit
def entry_speed(radius: float, dt: float, *motion: FloatArray) -> float:
    """Return the relative speed at which a deputy first enters a ball during a step [m/s], or -1 if it does not.

    The path relative to the ball, whose velocity is constant, is the cubic with the positions and velocities of the two
    states; over 1 s of Clohessy-Wiltshire dynamics it differs from the true path by less than 1e-8 m. It is followed in
    steps that cannot pass the ball: the gap divided by the largest speed of the cubic.

    Args:
        radius: Radius of the ball [m].
        dt: Length of the step [s]; 0: only the end of the step is checked.
        *motion: Position [m] and velocity [m/s] at the start of the step, then both at its end, then the centre of the
            ball at the end of the step [m] and its velocity [m/s], each of shape (3,).
    """
    position_before, velocity_before, position, velocity, reference, reference_velocity = motion
    end, end_speed = distance(position, reference), distance(velocity, reference_velocity)
    if dt > 0.0:
        # The control points of the cubic's derivative bound the speed: the two velocities, and the one between them.
        middle = 0.0
        for k in range(3):
            moved = position[k] - position_before[k] - reference_velocity[k] * dt
            u = 3.0 * moved / dt - velocity_before[k] - velocity[k] + 2.0 * reference_velocity[k]
            middle += u * u
        fastest = max(distance(velocity_before, reference_velocity), end_speed, math.sqrt(middle))
        elapsed = 0.0
        while True:
            b = elapsed / dt
            a = 1.0 - b
            square, speed = 0.0, 0.0
            for k in range(3):
                u0, u1 = velocity_before[k] - reference_velocity[k], velocity[k] - reference_velocity[k]
                p0 = position_before[k] - (reference[k] - reference_velocity[k] * dt)
                p3 = position[k] - reference[k]
                p1, p2 = p0 + u0 * dt / 3.0, p3 - u1 * dt / 3.0
                p = a * a * (a * p0 + 3.0 * b * p1) + b * b * (3.0 * a * p2 + b * p3)
                u = a * a * u0 + 2.0 * a * b * (3.0 * (p2 - p1) / dt) + b * b * u1
                square += p * p
                speed += u * u
            gap = math.sqrt(square) - radius
            if gap <= TOLERANCE:
                return math.sqrt(speed)
            if not gap <= fastest * (dt - elapsed):  # Also true for values that are not finite.
                break
            elapsed += gap / fastest
    return end_speed if end <= radius else -1.0


@njit
def docking_outcome(rule: FloatArray, *motion: FloatArray) -> int:
    """Return `DOCKED` or `TOO_FAST` if a deputy reaches the docking region in a step, otherwise `OUTSIDE`.

    Args:
        rule: See `DockingRegion.rule`, shape (6,).
        *motion: The positions and velocities that `entry_speed` takes.
    """
    radius = rule[4]
    speed = entry_speed(radius, rule[5], *motion)
    if speed < 0.0:
        return OUTSIDE
    return TOO_FAST if speed_excess(rule[:4], radius, speed) > 0.0 else DOCKED


@njit
def is_too_fast(rule: FloatArray, *motion: FloatArray) -> bool:
    """Return whether a deputy reaches the docking region above the speed limit; see `docking_outcome`."""
    return bool(docking_outcome(rule, *motion) == TOO_FAST)
