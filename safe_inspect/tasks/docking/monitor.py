"""`SpeedLimitMonitor`: measures how deputies comply with the speed limit of docking."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.base import NO_DISTURBANCE, DisturbanceBounds, MotionLimits
from safe_inspect.geometry.distance import distance
from safe_inspect.simulators.component import Component, RunningComponent
from safe_inspect.simulators.state import State
from safe_inspect.simulators.view import View
from safe_inspect.simulators.world import World
from safe_inspect.tasks.docking.speed_limit import SpeedLimit, speed_excess, speed_limit
from safe_inspect.types import AnyArray, ArraySpec, BoolArray, FloatArray, IntArray

_LIMIT, _EXCESS, _COUNT = "speed_limit", "speed_limit_excess", "speed_limit_violations"


@njit
def _watch(
    line: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    finished: AnyArray,
    limit: FloatArray,
    excess: FloatArray,
    count: IntArray,
) -> None:
    """Evaluate a step of N environments with D deputies, except deputies that had ended before it."""
    origin = np.zeros(3)
    for n in range(excess.shape[0]):
        for d in range(excess.shape[1]):
            far = distance(position[n, d], origin)
            limit[n, d] = speed_limit(line, far)
            if finished[n, d] == 0:
                found = speed_excess(line, far, distance(velocity[n, d], origin))
                excess[n, d] = max(excess[n, d], found)
                count[n, d] += found > 0.0


class SpeedLimitMonitor(SpeedLimit, Component):
    """Largest excess over the speed limit of docking about the origin of Hill's frame, and number of violations.

    Arrays, each of shape (N, D): ``speed_limit`` at the deputy's own range [m/s]; ``speed_limit_excess``, the largest
    value of speed minus limit at the ends of the steps and at the reset [m/s]; and ``speed_limit_violations``, the
    number of these with a positive excess. Steps after an agent's end do not count.
    """

    def disturbance_bounds(self, limits: MotionLimits) -> DisturbanceBounds:
        """Return zero bounds: the monitor does not affect the motion of deputies."""
        return NO_DISTURBANCE

    def __call__(self, world: World, num_envs: int) -> RunningComponent:
        """Return the running monitor."""
        return _RunningMonitor(self.limit_line(world), world.num_deputies)


class _RunningMonitor(RunningComponent):
    recorded = (_LIMIT,)
    figures = {  # noqa: RUF012 - never written
        "range": ("range", "m"),
        _EXCESS: ("largest speed over the limit", "m/s"),
        _COUNT: ("steps over the speed limit", "steps"),
    }

    def __init__(self, line: FloatArray, num_deputies: int) -> None:
        self._line = line
        number, count = ArraySpec((num_deputies,)), ArraySpec((num_deputies,), np.int64)
        self.arrays = {_LIMIT: number, _EXCESS: number, _COUNT: count}

    def reset(self, state: State, values: Mapping[str, Any]) -> None:
        state[_EXCESS][...] = -np.inf
        self._watch(state)

    def step(self, state: State, running: BoolArray) -> None:
        self._watch(state)

    def of_view(self) -> Mapping[str, Callable[[Any], Any]]:
        return {_EXCESS: _excess, _COUNT: _count}

    def info(self, view: View) -> dict[str, AnyArray]:
        return {"range": view.range_to(None), _EXCESS: _excess(view), _COUNT: _count(view)}

    def _watch(self, state: State) -> None:
        _watch.dispatcher(
            self._line, state.position, state.velocity, state.finished, state[_LIMIT], state[_EXCESS], state[_COUNT]
        )


def _excess(view: View) -> FloatArray:
    """Return the largest excess of each agent so far [m/s], shape (R,)."""
    return view.per_agent(view.state[_EXCESS])


def _count(view: View) -> IntArray:
    """Return the number of violations of each agent so far, shape (R,)."""
    return view.per_agent(view.state[_COUNT])
