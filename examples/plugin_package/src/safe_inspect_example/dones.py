"""An end when the fuel is spent."""

from typing import ClassVar

from safe_inspect.dones import DoneFunction, DoneStatus
from safe_inspect.units import NonNegativeSpeed


class FuelSpentDone(DoneFunction):
    """Lose when the episode's delta-v exceeds the `budget`; shape (R,).

    Attributes:
        budget: Velocity change that the fuel allows [m/s].
    """

    status: ClassVar[DoneStatus] = DoneStatus.LOSE

    budget: NonNegativeSpeed = 40.0

    def __call__(self, step):
        """Return the rows that have spent more, shape (R,)."""
        return step.after.delta_v > self.budget
