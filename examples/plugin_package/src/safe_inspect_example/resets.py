"""What a reset draws, and the states that follow from it."""

from typing import ClassVar

import numpy as np
from pydantic import Field, model_validator

from safe_inspect.simulators import Initializer
from safe_inspect.simulators.resets.parameters import ScalarParameter


class LogUniformParameter(ScalarParameter):
    """low (high / low)^U with U uniform in [0, 1): every decade is as likely as any other.

    Attributes:
        low: Smallest value, in `units`.
        high: Largest value, in `units`.
    """

    low: float = Field(default=1.0, gt=0)
    high: float = Field(default=10.0, gt=0)

    @model_validator(mode="after")
    def _ordered(self):
        if self.low > self.high:
            raise ValueError(f"`low` ({self.low}) is above `high` ({self.high}); swap them")
        return self

    def __call__(self, draw):
        """Return the drawn value, SI, shape (R,); a draw depends on seed, slot, episode, purpose and try alone."""
        share = draw.streams.uniform(draw.purpose, index=draw.index)[:, 0]
        return self.factor * self.low * (self.high / self.low) ** share


class RingInitializer(Initializer):
    """At rest on a ring in the plane z = 0: position = radius [cos(phase), sin(phase), 0].

    It gives ``position`` [m] (R, 3) and ``velocity`` [m/s] (R, 3).
    """

    parameters: ClassVar = {"radius": "m", "phase": "rad"}
    gives: ClassVar = {"position": 3, "velocity": 3}

    def __call__(self, values):
        """Return the states of the drawn radius and phase."""
        radius, phase = values["radius"], values["phase"]
        position = np.stack((radius * np.cos(phase), radius * np.sin(phase), np.zeros_like(radius)), axis=-1)
        return {"position": position, "velocity": np.zeros_like(position)}
