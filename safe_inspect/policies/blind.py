"""Policies that look at nothing: no thrust, and thrust at random."""

from __future__ import annotations

import numpy as np

from safe_inspect.policies.base import ScriptedPolicy, ThrustLimits
from safe_inspect.policies.draws import uniform
from safe_inspect.simulators.arrays import for_kernel
from safe_inspect.simulators.view import View
from safe_inspect.types import FloatArray


class ZeroThrust(ScriptedPolicy):
    """Never thrust: the deputy coasts."""

    def __call__(self, view: View, limits: ThrustLimits) -> FloatArray:
        """Return no thrust [N], shape (R, 3)."""
        return np.zeros((view.num_rows, 3))


class RandomThrust(ScriptedPolicy):
    """Thrust drawn anew in every step, uniform between the limits along each axis.

    A draw is a pure function of the episode's key, the step and the deputy's index: it depends neither on the batch
    nor on how the agents are grouped.
    """

    def __call__(self, view: View, limits: ThrustLimits) -> FloatArray:
        """Return thrusts between the limits [N], Hill frame, shape (R, 3)."""
        share: FloatArray = uniform(
            for_kernel(view.per_environment(view.state.key)), for_kernel(view.step), for_kernel(view.own_index), 3
        )
        return limits.low + share * (limits.high - limits.low)
