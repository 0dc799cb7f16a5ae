"""`CWHSimulator`: deputies about a chief in Clohessy-Wiltshire dynamics; their first states and speed limit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.base import Dynamics
from safe_inspect.dynamics.clohessy_wiltshire import ClohessyWiltshire
from safe_inspect.geometry.distance import distance
from safe_inspect.simulators.component import Component, PassiveComponent, RunningComponent
from safe_inspect.simulators.offers import OwnOfView
from safe_inspect.simulators.resets.initializers import Initializer, polar_states
from safe_inspect.simulators.simulator import Simulator
from safe_inspect.simulators.state import State
from safe_inspect.simulators.view import View
from safe_inspect.simulators.world import World
from safe_inspect.tasks.docking.speed_limit import SpeedLimit, speed_excess, speed_limit
from safe_inspect.types import AnyArray, ArraySpec, BoolArray, FloatArray, IntArray
from safe_inspect.units import PositiveAngularRate

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


class SpeedLimitMonitor(SpeedLimit, PassiveComponent):
    """Largest excess over the speed limit of docking about the origin of Hill's frame, and number of violations.

    Arrays, each of shape (N, D): ``speed_limit`` at the deputy's own range [m/s]; ``speed_limit_excess``, the largest
    value of speed minus limit at the ends of the steps and at the reset [m/s]; and ``speed_limit_violations``, the
    number of these with a positive excess. Steps after an agent's end do not count.
    """

    def __call__(self, world: World, num_envs: int) -> RunningComponent:
        """Return the running monitor."""
        return _RunningMonitor(self.limit_line(world), world.num_deputies)


class _RunningMonitor(RunningComponent):
    recorded = (_LIMIT,)
    offered = dict.fromkeys((_EXCESS, _COUNT), OwnOfView)
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

    def info(self, view: View) -> dict[str, AnyArray]:
        own = {name: view.per_agent(view.state[name]) for name in self.offered}
        return {"range": view.range_to(None), **own}

    def _watch(self, state: State) -> None:
        _watch.dispatcher(
            self._line, state.position, state.velocity, state.finished, state[_LIMIT], state[_EXCESS], state[_COUNT]
        )


class CWHSimulator(Simulator):
    """Simulator of deputies about a chief in Clohessy-Wiltshire dynamics.

    It composes `ClohessyWiltshire` and `SpeedLimitMonitor`.

    Attributes:
        mean_motion: Mean motion of the chief's circular orbit [rad/s].
        speed_limit: The speed limit of infos and tables.
    """

    mean_motion: PositiveAngularRate = 0.001027
    speed_limit: SpeedLimitMonitor = SpeedLimitMonitor()

    def compose(self) -> tuple[Dynamics, Sequence[Component]]:
        """Return the dynamics and the monitor."""
        return ClohessyWiltshire(mean_motion=self.mean_motion), (self.speed_limit,)


class Docking3DRadialInitializer(SpeedLimit, Initializer):
    """Position in polar form, and a velocity whose size is a fraction of the docking speed limit at that range.

    position = radius [cos(az) cos(el), sin(az) cos(el), sin(el)]. The velocity has the same form with the size
    vel_max_ratio (velocity_threshold + slope n max(radius - threshold_distance, 0)). Hill frame.

    Returns:
        ``position`` [m] (R, 3), ``velocity`` [m/s] (R, 3).
    """

    parameters: ClassVar[Mapping[str, str | None]] = {
        "radius": "m",
        "azimuth_angle": "rad",
        "elevation_angle": "rad",
        "vel_max_ratio": "",
        "vel_azimuth_angle": "rad",
        "vel_elevation_angle": "rad",
    }
    gives: ClassVar[Mapping[str, int]] = {"position": 3, "velocity": 3}

    mean_motion: PositiveAngularRate = 0.001027

    def __call__(self, values: Mapping[str, Any]) -> dict[str, FloatArray]:
        """Return the states for the sampled polar values."""
        beyond = np.maximum(values["radius"] - self.threshold_distance, 0.0)
        limit = self.velocity_threshold + self.slope * self.mean_motion * beyond
        speed = values["vel_max_ratio"] * limit
        return polar_states({**values, "vel_mag": speed})
