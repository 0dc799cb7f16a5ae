"""Rewards for a rendezvous with a tumbling target."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from safe_inspect.compiling import njit
from safe_inspect.rewards.base import Reward
from safe_inspect.simulators.row_terms.inputs import OwnArray
from safe_inspect.simulators.row_terms.loops import RowTerm
from safe_inspect.simulators.view import Group
from safe_inspect.simulators.world import World
from safe_inspect.tasks.rendezvous.mating import docking_error, docking_inputs, is_docked, is_in_contact
from safe_inspect.types import FloatArray
from safe_inspect.units import NonNegativeDuration, PositiveLength, PositiveSpeed


@njit
def _progress(
    weights: FloatArray,
    position_before: FloatArray,
    velocity_before: FloatArray,
    mating_position_before: FloatArray,
    mating_velocity_before: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    mating_position: FloatArray,
    mating_velocity: FloatArray,
) -> float:
    time_scale = weights[1]
    before = docking_error(time_scale, position_before, velocity_before, mating_position_before, mating_velocity_before)
    after = docking_error(time_scale, position, velocity, mating_position, mating_velocity)
    reward: float = weights[0] * (before - after)
    return reward


@njit
def _docked(
    scale: float,
    reach: float,
    speed: float,
    position: FloatArray,
    velocity: FloatArray,
    mating_position: FloatArray,
    mating_velocity: FloatArray,
) -> float:
    return scale if is_docked(reach, speed, position, velocity, mating_position, mating_velocity) else 0.0


@njit
def _contact(scale: float, radius: float, clearance: float) -> float:
    return scale if is_in_contact(radius, clearance) else 0.0


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
        weights = np.array([self.scale, self.time_scale])
        return RowTerm(_progress, (weights, *docking_inputs(before=True), *docking_inputs()))


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
        return RowTerm(_docked, (self.scale, self.reach, self.speed, *docking_inputs()))


class ContactReward(Reward):
    """Pay `scale` in a step at the end of which the chaser touches the target; shape (R,).

    Attributes:
        scale: Reward for a contact, a negative number [-].
        radius: Radius of the chaser [m].
    """

    scale: float = Field(default=-1.0, le=0)
    radius: PositiveLength = 0.25

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: scale if the clearance is below the radius, otherwise 0."""
        return RowTerm(_contact, (self.scale, self.radius, OwnArray("clearance")))
