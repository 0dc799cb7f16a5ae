"""The price of fuel."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from safe_inspect.rewards.base import Reward
from safe_inspect.simulators.view import Step
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveDuration, PositiveMass


class InspectionDeltaVReward(Reward):
    """Pay scale * sum_i abs(u_i) dt / m for the thrust u; shape (R,).

    Attributes:
        mode: ``scale``: the simulator's adaptive scale. ``constant``: the field `scale`.
        scale: Reward for 1 m/s, a negative number [1/(m/s)]; for the mode ``constant``.
        step_size: Length of a step [s]; the step's own unless given.
        mass: Mass of the deputy [kg]; the platform's own unless given.
    """

    mode: Literal["scale", "constant"] = "scale"
    scale: float = Field(default=-0.001, le=0)
    step_size: PositiveDuration | None = None
    mass: PositiveMass | None = None

    def __call__(self, step: Step) -> FloatArray:
        """Return scale times the velocity change, shape (R,)."""
        dt, mass = self.step_size or step.dt, self.mass or step.before.mass
        scale = step.before.delta_v_scale if self.mode == "scale" else self.scale
        return np.asarray(scale * (step.total_thrust * (dt / mass)))
