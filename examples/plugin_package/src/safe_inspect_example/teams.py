"""What concerns all deputies together: an end, and a filter of their thrusts."""

import numpy as np

from safe_inspect.dones import DoneStatus, SharedDoneFunction
from safe_inspect.rta import TeamSafety
from safe_inspect.rta.base import TeamFiltered
from safe_inspect.units import PositiveLength

#: Distance [m] used for a deputy without another.
_ALONE = 1e9


class ScatteredDone(SharedDoneFunction):
    """All lose when two deputies are farther from each other than `distance`; shape (N,).

    Attributes:
        distance: The distance [m].
    """

    distance: PositiveLength = 500.0

    def __call__(self, step):
        """Return `DoneStatus.LOSE` where they are, int8, shape (N,)."""
        apart = (step.after.distance > self.distance).any(axis=1)
        return np.where(apart, np.int8(DoneStatus.LOSE), np.int8(DoneStatus.RUNNING))


class CoastWhenClose(TeamSafety):
    """No thrust for deputies that are close to each other. It shows the contract, and promises nothing.

    Attributes:
        enabled: True: the thrusts are filtered. False: the filter costs nothing.
        distance: Two deputies are close below this distance [m].
    """

    distance: PositiveLength = 20.0

    def __call__(self, desired, team):
        """Return the thrusts, zero for the deputies of close pairs."""
        close = np.zeros(desired.shape[:2], dtype=np.bool_)
        for near, one, other in zip((team.distance < self.distance).T, *team.pairs, strict=True):
            close[:, one] |= near
            close[:, other] |= near
        control = np.where(close[..., None], 0.0, desired)
        changed = ((control - desired) ** 2).sum(axis=-1) > 0.01**2
        nowhere = np.zeros(len(desired), dtype=np.bool_)
        return TeamFiltered(control, intervening=changed, infeasible=nowhere, backup=close.any(axis=1))

    def refusals(self, states):
        """Return the environments that begin with a close pair, shape (R,)."""
        return {"distance": self._room(states) < 0.0}

    def safety(self, states):
        """Return the smallest distance less `distance` [m], shape (R,)."""
        return {"distance": self._room(states)}

    def _room(self, states):
        position = states["position"]
        one, other = np.triu_indices(position.shape[1], 1)
        distance = np.sqrt(((position[:, one] - position[:, other]) ** 2).sum(axis=-1))
        return distance.min(axis=1, initial=_ALONE) - self.distance
