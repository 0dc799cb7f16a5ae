"""Penalties for the use of fuel."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from safe_inspect.compiling import njit
from safe_inspect.rewards.base import Reward
from safe_inspect.simulators.row_terms import AgentParameter, EnvironmentArray, OwnArray, RowTerm
from safe_inspect.simulators.view import Group
from safe_inspect.simulators.world import World
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveDuration, PositiveMass


@njit
def _price_of_fuel(scale: float, seconds_per_mass: float, thrust: FloatArray) -> float:
    price: float = scale * ((abs(thrust[0]) + abs(thrust[1]) + abs(thrust[2])) * seconds_per_mass)
    return price


@njit
def _price_of_all(scale: float, seconds_per_mass: float, control: FloatArray) -> float:
    total = 0.0
    for k in range(len(control)):
        total += abs(control[k])
    price: float = scale * (total * seconds_per_mass)
    return price


class InspectionDeltaVReward(Reward):
    """Pay scale * sum_i abs(u_i) dt / m for the thrust u; shape (R,).

    Attributes:
        mode: ``scale`` uses the simulator's adaptive scale, ``constant`` the field `scale`.
        scale: Reward for 1 m/s, a negative number [1/(m/s)]; used in the mode ``constant``.
        constant_scale: The same for any mode; a key of safe-autonomy-sims.
        moments: Whether moments [N m] are added to the thrusts [N] as numbers, as in safe-autonomy-sims.
        step_size: Duration of a step [s]. Default: the duration of the environment's step.
        mass: Mass of the deputy [kg]. Default: the mass of the platform.
    """

    mode: Literal["scale", "constant"] = "scale"
    scale: float = Field(default=-0.001, le=0)
    constant_scale: float | None = Field(default=None, le=0)
    moments: bool = False
    step_size: PositiveDuration | None = None
    mass: PositiveMass | None = None

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: scale times the velocity change."""
        constant = self.scale if self.constant_scale is None else self.constant_scale
        adaptive = self.mode == "scale" and self.constant_scale is None
        scale = EnvironmentArray("delta_v_scale", before=True) if adaptive else constant
        kernel = _price_of_all if self.moments else _price_of_fuel
        return RowTerm(kernel, (scale, _seconds_per_mass(self, world, group), OwnArray("control")))


@njit
def _price_with_bias(scale: float, bias: float, seconds_per_mass: float, thrust: FloatArray) -> float:
    return _price_of_fuel(scale, seconds_per_mass, thrust) + bias


class DockingDeltaVReward(Reward):
    """Pay scale * sum_i abs(u_i) dt / m + bias for the thrust u; shape (R,).

    Attributes:
        scale: Reward for 1 m/s, a negative number [1/(m/s)].
        bias: Reward of every step [-].
        step_size: Duration of a step [s]. Default: the duration of the environment's step.
        mass: Mass of the deputy [kg]. Default: the mass of the platform.
    """

    scale: float = Field(default=-0.01, le=0)
    bias: float = 0.0
    step_size: PositiveDuration | None = None
    mass: PositiveMass | None = None

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: scale times the velocity change, plus the bias."""
        duration = _seconds_per_mass(self, world, group)
        return RowTerm(_price_with_bias, (self.scale, self.bias, duration, OwnArray("control")))


def _seconds_per_mass(
    reward: InspectionDeltaVReward | DockingDeltaVReward, world: World, group: Group
) -> AgentParameter:
    """Return dt / m of each agent [s/kg]."""
    own = world.masses[group.first : group.first + group.size]
    masses = np.full(group.size, reward.mass) if reward.mass else own
    return AgentParameter((reward.step_size or world.step_size) / masses)
