"""Policies that ignore the state: no thrust, random thrust, and plans of an earlier optimisation."""

from __future__ import annotations

import os
from collections.abc import Iterable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from safe_inspect.compiling import njit
from safe_inspect.errors import SafeInspectError
from safe_inspect.policies.base import ScriptedPolicy, ThrustLimits
from safe_inspect.policies.plan_record import FlightPlan, read_record
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


class OpenLoopPlan(ScriptedPolicy):
    """Policy that executes plans without feedback from the state.

    An episode is identified by its random key, a pure function of the run's seed and the environment slot, so that a
    plan is executed in its own episode for any batch. Burns that overlap add up.

    Attributes:
        plans: The plan of each episode, by the episode's key in hexadecimal digits. Without plans, all deputies coast.
    """

    plans: dict[str, FlightPlan] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _keys(self) -> OpenLoopPlan:
        for key in self.plans:
            try:
                int(key, 16)
            except ValueError:
                raise ValueError(f"the key of an episode must be a hexadecimal number, got {key!r}") from None
        return self

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> OpenLoopPlan:
        """Return the policy that executes the plans in a file of ``safe-inspect baseline optimiser``.

        Raises:
            SafeInspectError: The file is missing or damaged.
        """
        return cls.of((entry.key, entry.plan) for entry in read_record(path).entries)

    @classmethod
    def of(cls, plans: Iterable[tuple[int, FlightPlan]]) -> OpenLoopPlan:
        """Return the policy that executes the plan of each episode, given by the episode's key."""
        return cls(plans={f"{key:016x}": plan for key, plan in plans})

    @cached_property
    def _thrust(self) -> dict[int, dict[int, FloatArray]]:
        """Thrust [N] by episode and step."""
        table: dict[int, dict[int, FloatArray]] = {}
        for key, plan in self.plans.items():
            steps = table.setdefault(int(key, 16), {})
            for burn in plan:
                for step in range(burn.step, burn.step + burn.steps):
                    steps[step] = steps.get(step, np.zeros(3)) + np.array(burn.thrust)
        return table

    def __call__(self, view: View, limits: ThrustLimits) -> FloatArray:
        """Return the thrust of each row's plan in its current step [N], shape (R, 3).

        Raises:
            SafeInspectError: There is no plan for an episode.
        """
        thrust = np.zeros((view.num_rows, 3))
        if not self.plans:
            return thrust
        keys = view.per_environment(view.state.key).tolist()
        for row, (key, step) in enumerate(zip(keys, view.step.tolist(), strict=True)):
            steps = self._thrust.get(key)
            if steps is None:
                raise SafeInspectError(
                    "the OpenLoopPlan has no plan for this episode; use the seed for which it was made, and no more "
                    "episodes"
                )
            if step in steps:
                thrust[row] = steps[step]
        return thrust
