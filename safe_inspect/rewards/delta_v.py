"""Penalties for the use of fuel."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from safe_inspect.compiling import njit
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rewards.base import Reward
from safe_inspect.simulators import Group, World
from safe_inspect.simulators.row_terms import AgentParameter, EnvironmentArray, OwnArray, RowTerm
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveDuration, PositiveMass


@njit
def _price(scale: float, bias: float, moments: bool, seconds_per_mass: float, control: FloatArray) -> float:
    total = 0.0
    for k in range(len(control) if moments else 3):
        total += abs(control[k])
    price: float = scale * (total * seconds_per_mass) + bias
    return price


class _FuelReward(Plugin):
    """Fields of the rewards for the use of fuel.

    Attributes:
        step_size: Duration of a step [s]. Default: the duration of the environment's step.
        mass: Mass of the deputy [kg]. Default: the mass of the platform.
    """

    step_size: PositiveDuration | None = None
    mass: PositiveMass | None = None

    def seconds_per_mass(self, world: World, group: Group) -> AgentParameter:
        """Return dt / m of each agent [s/kg]."""
        own = world.masses[group.first : group.first + group.size]
        masses = np.full(group.size, self.mass) if self.mass else own
        return AgentParameter((self.step_size or world.step_size) / masses)


class InspectionDeltaVReward(_FuelReward, Reward):
    """Pay scale * sum_i abs(u_i) dt / m for the thrust u; shape (R,).

    Attributes:
        mode: ``scale`` uses the simulator's adaptive scale, ``constant`` the field `scale`.
        scale: Reward for 1 m/s, a negative number [1/(m/s)]; used in the mode ``constant``.
        constant_scale: The same for any mode; a key of safe-autonomy-sims.
        moments: Whether moments [N m] are added to the thrusts [N] as numbers, as in safe-autonomy-sims.
    """

    mode: Literal["scale", "constant"] = "scale"
    scale: float = Field(default=-0.001, le=0)
    constant_scale: float | None = Field(default=None, le=0)
    moments: bool = False

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: scale times the velocity change."""
        constant = self.scale if self.constant_scale is None else self.constant_scale
        adaptive = self.mode == "scale" and self.constant_scale is None
        scale = EnvironmentArray("delta_v_scale", before=True) if adaptive else constant
        bias = -0.0  # changes no number, not even -0.0
        return RowTerm(_price, (scale, bias, self.moments, self.seconds_per_mass(world, group), OwnArray("control")))


class DockingDeltaVReward(_FuelReward, Reward):
    """Pay scale * sum_i abs(u_i) dt / m + bias for the thrust u; shape (R,).

    Attributes:
        scale: Reward for 1 m/s, a negative number [1/(m/s)].
        bias: Reward of every step [-].
    """

    scale: float = Field(default=-0.01, le=0)
    bias: float = 0.0

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: scale times the velocity change, plus the bias."""
        return RowTerm(_price, (self.scale, self.bias, False, self.seconds_per_mass(world, group), OwnArray("control")))
