"""Rewards for docking with a chief that does not tumble, and with a tumbling target."""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from safe_inspect.compiling import njit
from safe_inspect.geometry.distance import distance
from safe_inspect.plugins.plugin import SensorName
from safe_inspect.rewards.base import Reward, paid_if
from safe_inspect.simulators import Group, World
from safe_inspect.simulators.row_terms import EnvironmentArray, OwnArray, RowTerm, range_inputs
from safe_inspect.tasks.docking.mating import docking_error, docking_inputs, is_docked, is_in_contact
from safe_inspect.tasks.docking.shape import ASTROBEE_RADIUS
from safe_inspect.tasks.docking.speed_limit import (
    DOCKED,
    TOO_FAST,
    DockingRegion,
    ReferenceSensors,
    SpeedLimit,
    docking_outcome,
    own_motion,
    speed_excess,
)
from safe_inspect.types import FloatArray
from safe_inspect.units import NonNegativeDuration, PositiveDuration, PositiveLength, PositiveSpeed


@njit
def _approach(factors: FloatArray, step: int, before: FloatArray, after: FloatArray, reference: FloatArray) -> float:
    if step == 0 and factors[2] == 0.0:
        return 0.0
    rate = -factors[1]
    value: float = factors[0] * (
        math.exp(rate * distance(after, reference)) - math.exp(rate * distance(before, reference))
    )
    return value


@njit
def _violation(line: FloatArray, scale: float, bias: float, *motion: FloatArray) -> float:
    position, velocity, reference, reference_velocity = motion
    excess = speed_excess(line, distance(position, reference), distance(velocity, reference_velocity))
    return scale * excess + bias if excess > 0.0 else 0.0


class DockingDistanceExponentialChangeReward(Reward):
    """Pay scale c (exp(-a r') - exp(-a r)) for the ranges r before and r' after the step; shape (R,).

    With a = ln(pivot_ratio) / pivot. The sum over an episode depends only on its first and its last state.

    Attributes:
        c: Factor of the exponentials [-].
        pivot: Range at which the exponential is 1 / `pivot_ratio` [m].
        pivot_ratio: See `pivot` [-].
        scale: Factor of the reward [-].
        pays_first_step: Whether the first step of an episode is paid. It is not in safe-autonomy-sims with CoRL.
        reference_position_sensor_name: Sensor of the reference's position. Default: the origin of Hill's frame.
    """

    c: float = 2.0
    pivot: PositiveLength = 100.0
    pivot_ratio: float = Field(default=2.0, gt=1)
    scale: float = 1.0
    pays_first_step: bool = True
    reference_position_sensor_name: SensorName | None = None

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: the scaled change of the exponential."""
        rate = math.log(self.pivot_ratio) / self.pivot
        factors = np.array([self.scale * self.c, rate, float(self.pays_first_step)])
        own, reference = range_inputs(self.reference_position_sensor_name)
        inputs = EnvironmentArray("step", before=True), OwnArray("position", before=True), own, reference
        return RowTerm(_approach, (factors, *inputs))


class DockingVelocityConstraintReward(ReferenceSensors, SpeedLimit, Reward):
    """Pay scale (speed - L) + bias in a step that ends with a speed above the limit L; shape (R,).

    Attributes:
        scale: Reward for 1 m/s above the limit, a negative number [1/(m/s)].
        bias: Reward for any violation, a negative number [-].
    """

    scale: float = -0.01
    bias: float = -0.01

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: the penalty for the speed above the limit, otherwise 0."""
        line = self.limit_line(world)
        return RowTerm(_violation, (line, self.scale, self.bias, *own_motion(), *self.reference_inputs()))


@njit
def _success(rule: FloatArray, pays: FloatArray, time: float, *motion: FloatArray) -> float:
    reward: float = pays[0] * (1.0 + (1.0 - time / pays[1])) if docking_outcome(rule, *motion) == DOCKED else 0.0
    return reward


@njit
def _failure(rule: FloatArray, pays: FloatArray, time: float, *motion: FloatArray) -> float:
    if time >= pays[3]:
        found: float = pays[0]
    elif distance(motion[2], motion[4]) >= pays[4]:
        found = pays[1]
    else:
        found = pays[2] if docking_outcome(rule, *motion) == TOO_FAST else 0.0
    return found


class DockingSuccessReward(DockingRegion, Reward):
    """Pay scale (2 - t / timeout) in the step in which the deputy docks, where t is its end time; shape (R,).

    Attributes:
        scale: Reward for docking at the time `timeout` [-].
        timeout: Time at which docking is rewarded with `scale`; docking at time 0 is rewarded with twice as much [s].
    """

    scale: float = 1.0
    timeout: PositiveDuration = 2000.0

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: the reward if the deputy docks, otherwise 0."""
        pays = np.array([self.scale, self.timeout])
        return RowTerm(_success, (self.rule(world), pays, EnvironmentArray("time"), *self.inputs()))


class DockingFailureReward(DockingRegion, Reward):
    """Pay for a failure, the first of: time limit, too far away, docking region entered too fast; shape (R,).

    Attributes:
        timeout_reward: Reward when the time reaches `timeout`, a negative number [-].
        distance_reward: Reward when the range reaches `max_goal_distance`, a negative number [-].
        crash_reward: Reward when the deputy enters the docking region above the speed limit, a negative number [-].
        timeout: Largest time [s].
        max_goal_distance: Largest range [m].
    """

    timeout_reward: float = -1.0
    distance_reward: float = -1.0
    crash_reward: float = -1.0
    timeout: PositiveDuration = 2000.0
    max_goal_distance: PositiveLength = 10_000.0

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: the reward of the failure, otherwise 0."""
        pays = np.array(
            [self.timeout_reward, self.distance_reward, self.crash_reward, self.timeout, self.max_goal_distance]
        )
        return RowTerm(_failure, (self.rule(world), pays, EnvironmentArray("time"), *self.inputs()))


@njit
def _progress(scale: float, time_scale: float, *motion: FloatArray) -> float:
    return scale * (docking_error(time_scale, *motion[:4]) - docking_error(time_scale, *motion[4:]))


class MatingProgressReward(Reward):
    """Pay `scale` for every metre by which the docking error ``sqrt(|dp|^2 + (T |dv|)^2)`` decreases; shape (R,).

    ``dp`` and ``dv`` are position and velocity relative to the mating point. The sum over an episode depends only on
    its first and its last state.

    Attributes:
        scale: Reward for one metre [1/m].
        time_scale: T, the weight of the relative velocity in the error [s].
    """

    scale: float = 1.0
    time_scale: NonNegativeDuration = 5.0

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: scale times the decrease of the docking error."""
        motion = *docking_inputs(before=True), *docking_inputs()
        return RowTerm(_progress, (self.scale, self.time_scale, *motion))


class MatingSuccessReward(Reward):
    """Pay `scale` in a step at the end of which the chaser is docked; shape (R,).

    Attributes:
        scale: Reward for docking [-].
        reach: Largest distance from the mating point [m].
        speed: Largest speed relative to the mating point [m/s].
    """

    scale: float = 1.0
    reach: PositiveLength = 0.03
    speed: PositiveSpeed = 0.01

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: scale if the chaser is docked, otherwise 0."""
        return paid_if(is_docked, self.scale, (self.reach, self.speed, *docking_inputs()))


class ContactReward(Reward):
    """Pay `scale` in a step at the end of which the chaser touches the target; shape (R,).

    Attributes:
        scale: Reward for a contact, a negative number [-].
        radius: Radius of the chaser [m].
    """

    scale: float = Field(default=-1.0, le=0)
    radius: PositiveLength = ASTROBEE_RADIUS

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: scale if the clearance is below the radius, otherwise 0."""
        return paid_if(is_in_contact, self.scale, (self.radius, OwnArray("clearance")))
