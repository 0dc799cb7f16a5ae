"""Policies that need no training: the baselines that a trained policy is compared with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from safe_inspect.environments.layout import Layout
from safe_inspect.errors import SafeInspectError, did_you_mean
from safe_inspect.randomness import Streams
from safe_inspect.types import AnyArray, FloatArray, IntArray

Observation: TypeAlias = NDArray[np.float32]

#: From observations, float32, shape (N, O), to actions, shape (N, A). A policy that keeps something from step to step
#: has a method ``begin(flight: Flight)``, which is called before the first step of every batch.
Policy: TypeAlias = Callable[[Observation], AnyArray]


@dataclass(frozen=True)
class Flight:
    """What a policy is told before the first step of a batch of episodes.

    Attributes:
        slots: Global index of the environment slot of each row, shape (N,).
        observation: Layout of the observation.
        action: Layout of the action.
        step_size: Length of a step [s].
        mean_motion: Mean motion of the chief's orbit [rad/s].
        masses: Mass of each deputy [kg], shape (D,).
    """

    slots: IntArray
    observation: Layout
    action: Layout
    step_size: float
    mean_motion: float
    masses: FloatArray


class _ZeroThrust:
    """The action 0 in every row; see `zero_thrust`."""

    def __init__(self) -> None:
        self._size = 0

    def begin(self, flight: Flight) -> None:
        self._size = flight.action.size

    def __call__(self, observation: Observation) -> AnyArray:
        return np.zeros((len(observation), self._size))


class _Random:
    """Actions uniform within their bounds; see `random_policy`."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._step = 0
        self._flight: Flight | None = None

    def begin(self, flight: Flight) -> None:
        self._flight, self._step = flight, 0

    def __call__(self, observation: Observation) -> AnyArray:
        flight = self._flight
        assert flight is not None, "begin() comes before the first step"
        low, high = flight.action.low, flight.action.high
        streams = Streams(self._seed, flight.slots, np.zeros_like(flight.slots))
        draws = streams.uniform("policy", count=flight.action.size, index=self._step)
        self._step += 1
        return np.asarray(low + draws * (high - low))


def zero_thrust() -> Policy:
    """Return the policy that never thrusts: the action 0 (no thrust unless a controller's limits are lopsided)."""
    return _ZeroThrust()


def random_policy(seed: int = 0) -> Policy:
    """Return the policy that draws every action uniformly within its bounds.

    A draw is a pure function of (seed, slot, step), so an episode does not depend on the batch in which it is flown.
    """
    return _Random(seed)


#: The baselines by name: functions of a seed that return a policy.
BASELINES: Mapping[str, Callable[[int], Policy]] = MappingProxyType(
    {"random": random_policy, "zero-thrust": lambda seed: zero_thrust()}
)


def baseline(name: str, seed: int = 0) -> Policy:
    """Return a baseline by its name.

    Raises:
        SafeInspectError: There is none of that name.
    """
    if name not in BASELINES:
        raise SafeInspectError(f"no baseline {name!r}; {did_you_mean(name, BASELINES)}")
    return BASELINES[name](seed)
