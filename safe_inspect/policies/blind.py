"""Policies that ignore the state: no thrust, and random thrust."""

from __future__ import annotations

import numpy as np

from safe_inspect.policies.base import ScriptedPolicy, ThrustLimits
from safe_inspect.policies.draws import uniform
from safe_inspect.simulators.arrays import for_kernel
from safe_inspect.simulators.view import View
from safe_inspect.types import FloatArray


class ZeroThrust(ScriptedPolicy):
    """Policy without thrust: the deputy coasts."""

    def __call__(self, view: View, limits: ThrustLimits) -> FloatArray:
        """Return zero thrust [N], shape (R, 3)."""
        return np.zeros((view.num_rows, 3))


class RandomThrust(ScriptedPolicy):
    """Policy with random thrust, sampled in every step uniformly between the limits along each axis.

    A sample is a pure function of the episode's key, the step and the deputy's index: it depends neither on the batch
    nor on the grouping of the agents.
    """

    def __call__(self, view: View, limits: ThrustLimits) -> FloatArray:
        """Return random thrusts between the limits [N], Hill frame, shape (R, 3)."""
        share: FloatArray = uniform(
            for_kernel(view.per_environment(view.state.key)), for_kernel(view.step), for_kernel(view.own_index), 3
        )
        return limits.low + share * (limits.high - limits.low)
