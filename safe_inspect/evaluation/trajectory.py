"""What a rollout returns: a row of figures for each episode, and the trajectories of some of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.types import AnyArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Trajectory:
    """One recorded episode of T steps with D deputies. SI units, Hill's frame.

    Attributes:
        time: Time since the reset [s], shape (T + 1,).
        position: Position of each deputy [m], shape (T + 1, D, 3).
        velocity: Velocity of each deputy [m/s], shape (T + 1, D, 3).
        control: Thrust of each deputy held over each step [N], shape (T, D, 3).
        delta_v: Velocity change that each deputy has spent [m/s], shape (T + 1, D).
        sun_angle: Angle of the sun [rad], shape (T + 1,); the sun stands at [cos, -sin, 0] of it.
        points: Position of the inspection points about the chief's centre [m], shape (P, 3).
        inspected_at: Time at which each point was inspected [s], infinite for never, shape (P,).
        status: How the episode ended.
        slot: Global index of the environment slot.
        deputies: Name of each deputy.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    control: FloatArray
    delta_v: FloatArray
    sun_angle: FloatArray
    points: FloatArray
    inspected_at: FloatArray
    status: DoneStatus
    slot: int
    deputies: tuple[str, ...]

    @property
    def range(self) -> FloatArray:
        """Distance of each deputy from the chief's centre [m], shape (T + 1, D)."""
        return np.asarray(np.sqrt(np.square(self.position).sum(axis=-1)))

    @property
    def coverage(self) -> FloatArray:
        """Fraction of the points inspected so far [-], shape (T + 1,)."""
        when = np.sort(self.inspected_at)
        return np.searchsorted(when, self.time, side="right") / len(when)

    def until(self, time: float) -> Trajectory:
        """Return the episode up to a time since its reset [s]; it runs on when it is cut before its end."""
        last = max(int(np.searchsorted(self.time, time, side="right")), 1)
        if last >= len(self.time):
            return self
        rows = {name: getattr(self, name)[:last] for name in ("time", "position", "velocity", "delta_v", "sun_angle")}
        seen = np.where(self.inspected_at <= self.time[last - 1], self.inspected_at, np.inf)
        return replace(self, **rows, control=self.control[: last - 1], inspected_at=seen, status=DoneStatus.RUNNING)

    @property
    def sun_direction(self) -> FloatArray:
        """Unit vector from the chief to the sun, Hill frame, shape (T + 1, 3)."""
        angle = self.sun_angle
        return np.stack((np.cos(angle), -np.sin(angle), np.zeros_like(angle)), axis=-1)


@dataclass(frozen=True, eq=False)
class Episodes:
    """E episodes; row k is the first episode of environment slot k.

    Attributes:
        seed: Seed of the run.
        returns: Sum of the rewards [-], shape (E,).
        terms: Sum of each reward term [-] by its name, each of shape (E,).
        length: Number of steps, shape (E,).
        status: `DoneStatus` at the end, int8, shape (E,).
        inspected_fraction: Fraction of the points inspected at the end [-], shape (E,).
        delta_v: Velocity change spent [m/s], shape (E,).
        trajectories: The recorded episodes, the first ones, in order.
    """

    seed: int
    returns: FloatArray
    terms: Mapping[str, FloatArray]
    length: IntArray
    status: AnyArray
    inspected_fraction: FloatArray
    delta_v: FloatArray
    trajectories: tuple[Trajectory, ...] = ()

    def __len__(self) -> int:
        return len(self.returns)

    @property
    def success(self) -> AnyArray:
        """Episodes that were won, shape (E,)."""
        return np.asarray(self.status == DoneStatus.WIN)
