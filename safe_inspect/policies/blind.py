"""Policies that ignore the state: no thrust, and random thrust."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from safe_inspect.compiling import njit
from safe_inspect.policies.base import ScriptedPolicy, ThrustLimits
from safe_inspect.random.streams import philox4x32
from safe_inspect.simulators.arrays import for_kernel
from safe_inspect.simulators.view import View
from safe_inspect.types import FloatArray, IntArray

_HALF = np.uint64(32)
_DROP = np.uint64(11)  # bits to drop of 64, as a double has 53
_PURPOSE = np.uint64(0x5C217ED)  # makes these samples independent of others with the episode's key


@njit
def _uniform(key: NDArray[np.uint64], step: IntArray, deputy: IntArray, count: int) -> FloatArray:
    """Return _uniform numbers in [0, 1), each a pure function of its row's key, step and deputy, shape (R, count).

    Args:
        key: Random key of the episode, shape (R,).
        step: Steps since the reset, shape (R,).
        deputy: Index of the deputy, shape (R,).
        count: Number of samples per row.
    """
    out = np.empty((key.shape[0], count))
    for row in range(key.shape[0]):
        for number in range(count):
            counter = np.uint64(step[row]), np.uint64(deputy[row]), np.uint64(number), _PURPOSE
            high, low, _, _ = philox4x32(*counter, key[row])
            out[row, number] = ((high << _HALF | low) >> _DROP) * 2.0**-53
    return out


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
        share: FloatArray = _uniform(
            for_kernel(view.per_environment(view.state.key)), for_kernel(view.step), for_kernel(view.own_index), 3
        )
        return limits.low + share * (limits.high - limits.low)
