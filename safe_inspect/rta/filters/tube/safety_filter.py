"""Filter that is safe under bounded disturbances, by tracking a plan that is stored between steps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.rta.constraints.base import Constraint, RelativeState
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.filters.backup.safety_filter import BackupFilter, Intervention
from safe_inspect.rta.filters.base import checked, compiled
from safe_inspect.rta.filters.tube.deviations import PlanTracker
from safe_inspect.rta.filters.tube.tables import leaves_nothing, starting_tube, tube_of
from safe_inspect.simulators.view import FilterResult
from safe_inspect.types import BoolArray, FloatArray

#: Number of stored elements of a deputy: the state of the plan (6), its thrust (3), and 1 if there is a plan.
MEMORY = 10


class TubeFilter(BackupFilter):
    """`BackupFilter` for states that are known with a bounded error, and for disturbed motions and thrusts.

    A desired control is applied if its hold, and a plan after it, satisfy every constraint for every disturbance within
    the bounds; the plan is then stored. In the next step it is the backup: the deputy tracks it with its thrust plus
    K (estimate - plan), instead of planning again, so no plan has to be found again. The real motion stays in a tube
    about the plan, whose width is known in advance; see `deviations`. Every constraint is certified for the motion of
    the model with that width as a margin, which grows with the thrusts whose errors it covers. Therefore, from an
    accepted initial state, every step ends in a state with a plan, permanently.

    Attributes:
        bounds: Bounds of the disturbances.
        tracker: Controller that tracks the plans.
        tube: Margins of the tube; see `FilterModel.tube`.
        starting: Margins for real initial states; see `starting_tube`.
    """

    def __init__(
        self,
        parameters: Mapping[str, Any] | ConstraintParameters | None,
        names: Iterable[str | Constraint],
        bounds: DisturbanceBounds,
        intervention: Intervention = "nearest",
    ) -> None:
        """Build the filter; see `BackupFilter` for the other arguments.

        Args:
            parameters: The task's parameters.
            names: The constraints.
            bounds: Bounds of the disturbances.
            intervention: What is applied if the desired control is rejected.

        Raises:
            ValueError: An argument is wrong, or the bounds leave no state from which the constraints can be guaranteed.
        """
        super().__init__(parameters, names, intervention, several_holds=False)  # The tube is about a single hold.
        self.bounds = bounds
        tracker = PlanTracker(self.parameters, bounds)
        lost = None if tracker.settles else "to enforce: a plan cannot be tracked with such errors of the thrust"
        if lost is None:
            tube = tube_of(self._tables, tracker, self.constraints)
            lost = leaves_nothing(tube, self.parameters, self.constraints)
        if lost is not None:
            raise ValueError(f"the bounds of `disturbance` leave nothing {lost}; lower them")
        self.tracker = tracker
        self.tube, self.starting = tube, starting_tube(self._tables, tracker, tube, self.constraints)
        self._tables = self._tables._replace(tube=tube)

    def __call__(self, state: RelativeState, desired: FloatArray) -> FilterResult:
        """Return the controls to apply in the first step of episodes, without a memory; see `track`."""
        return self.track(state, desired, self.memory(len(state)))[0]

    @staticmethod
    def memory(rows: int) -> FloatArray:
        """Return the memory at the start of R episodes, which contains no plan, shape (R, 10)."""
        return np.zeros((rows, MEMORY))

    def track(self, state: RelativeState, desired: FloatArray, memory: FloatArray) -> tuple[FilterResult, FloatArray]:
        """Return the controls to apply, and the memory after the step; `memory` itself is not changed.

        Args:
            state: Estimates of the states of R deputies.
            desired: Desired controls [N], Hill frame, shape (R, 3).
            memory: Memory after the last step, shape (R, 10).

        Raises:
            ValueError: The shapes differ, or a number is not finite; the message names the first such row.
        """
        desired, memory = checked(state, desired), np.array(memory, dtype=np.float64, order="C")
        return self._filtered(state, desired, self.tracker.gain, memory), memory

    def tracking(self, state: RelativeState, memory: FloatArray) -> FloatArray:
        """Return the thrust that tracks the stored plan, or that of a new plan if none is stored [N], shape (R, 3)."""
        _, thrust = self.backups(state)
        known = memory[:, MEMORY - 1] > 0.0
        away = np.concatenate((state.position, state.velocity), axis=1) - memory[:, :6]
        limit = float(self.parameters.u_max)
        for axis in range(3):
            tracked = memory[:, 6 + axis].copy()
            for k in range(6):
                tracked += self.tracker.gain[axis, k] * away[:, k]
            thrust[:, axis] = np.where(known, np.clip(tracked, -limit, limit), thrust[:, axis])
        return thrust

    def recoverable(self, state: RelativeState) -> BoolArray:
        """Return the rows from which the filter guarantees safety for every estimate within the bounds, shape (R,).

        Args:
            state: Real initial states.
        """
        checked(state, np.zeros((len(state), 3)))
        found, control = np.empty(len(state), np.bool_), np.empty((len(state), 3))
        model = self._model._replace(tube=self.starting)
        compiled("backup.rows").recoverable_rows(
            model, state.position, state.velocity, state.sun_angle, 1.0, found, control
        )  # fmt: skip
        return found
