"""Tumbles: distributions of a target's initial attitude and angular velocity."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import ClassVar

import numpy as np
from pydantic import field_validator, model_validator

from safe_inspect.dynamics.quaternion import normalise
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.poses import check_unit
from safe_inspect.types import FloatArray
from safe_inspect.units import NonNegativeAngularRate


class Tumble(Plugin):
    """Base class of tumbles: the target's attitude and angular velocity at the start of a mission."""

    kind: ClassVar[str] = "tumble"

    @abstractmethod
    def __call__(self, streams: Streams) -> tuple[FloatArray, FloatArray]:
        """Return q_WT, shape (4,), and angular velocity in T [rad/s], shape (3,), at the start of a mission."""


class TriAxialTumble(Tumble):
    """A tumble about a given direction in the principal axes, from a given or a uniformly random attitude.

    Attributes:
        rate: Initial angular rate [rad/s].
        direction: Direction of the angular velocity in the principal axes; its length does not matter.
        attitude: Initial quaternion [x, y, z, w] from the principal axes to W; null for a random one.
    """

    rate: NonNegativeAngularRate = 0.08726646259971647  # type: ignore[valid-type]
    direction: tuple[float, float, float] = (0.7, 0.5, 0.5)
    attitude: tuple[float, float, float, float] | None = None

    @field_validator("direction", "attitude")
    @classmethod
    def _has_length(cls, value: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if value is not None and not (all(map(math.isfinite, value)) and any(value)):
            raise ValueError(f"{list(value)} is neither a direction nor an attitude: give finite components, not all 0")
        return value

    @field_validator("attitude")
    @classmethod
    def _is_rotation(cls, value: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if value is not None:
            check_unit("the attitude", value)
        return value

    def __call__(self, streams: Streams) -> tuple[FloatArray, FloatArray]:
        """Return the initial attitude q_WT, shape (4,), and angular velocity in T [rad/s], shape (3,)."""
        direction = np.array(self.direction)
        velocity = self.rate * direction / np.linalg.norm(direction)
        if self.attitude is not None:
            return normalise(np.array(self.attitude)), velocity
        return random_attitude(streams), velocity


class RandomTumble(Tumble):
    """A tumble about a uniformly random direction at a uniformly random rate, from a uniformly random attitude.

    Attributes:
        least_rate: Smallest angular rate [rad/s].
        largest_rate: Largest angular rate [rad/s].
    """

    least_rate: NonNegativeAngularRate = 0.03490658503988659  # type: ignore[valid-type]
    largest_rate: NonNegativeAngularRate = 0.08726646259971647  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _is_range(self) -> RandomTumble:
        if self.least_rate > self.largest_rate:
            raise ValueError(
                f"least_rate ({self.least_rate:.4g} rad/s) is more than largest_rate ({self.largest_rate:.4g} rad/s)"
            )
        return self

    def __call__(self, streams: Streams) -> tuple[FloatArray, FloatArray]:
        """Return the initial attitude q_WT, shape (4,), and angular velocity in T [rad/s], shape (3,)."""
        direction = streams.normal("tumble.direction", 3)[0]
        share = float(streams.uniform("tumble.rate")[0, 0])
        rate = self.least_rate + share * (self.largest_rate - self.least_rate)
        return random_attitude(streams), rate * direction / np.linalg.norm(direction)


def random_attitude(streams: Streams) -> FloatArray:
    """Sample a uniformly random attitude, shape (4,)."""
    return normalise(streams.normal("tumble.attitude", 4)[0])
