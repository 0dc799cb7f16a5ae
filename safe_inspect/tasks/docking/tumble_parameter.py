"""Parameters that sample a tumble: the initial attitude and angular velocity of a target."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import field_validator, model_validator

from safe_inspect.dynamics.quaternion import normalise
from safe_inspect.errors import InitialStateError, PluginValueError
from safe_inspect.plugins.functor import functor_field
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.plugins.results import require_arrays
from safe_inspect.simulators.resets.initializers import GivenAttitude, drawn_attitude, repeated_unit, require_length
from safe_inspect.simulators.resets.parameters import Draw, Parameter, ScalarParameter, UniformParameter
from safe_inspect.types import FloatArray
from safe_inspect.units import NonNegativeAngularRate

#: Largest error of the length of a quaternion [-].
_ROUNDING = 1e-6


def tumble_states(name: str, drawn: Any, rows: int) -> tuple[FloatArray, FloatArray]:
    """Return attitudes q_WT, shape (R, 4), and angular velocities in T [rad/s], shape (R, 3), of a sampled tumble.

    Args:
        name: Name of the parameter, for the message.
        drawn: Value of the parameter.
        rows: Number of rows R.

    Raises:
        InitialStateError: The value has no attitude and angular velocity, or they are not finite, of another shape, or
            not unit quaternions.
    """
    if not (isinstance(drawn, Mapping) and {"orientation", "angular_velocity"} <= drawn.keys()):
        raise InitialStateError(f"`{name}` gives no attitude and angular velocity; use TumbleParameter")
    orientation, rate = drawn["orientation"], drawn["angular_velocity"]
    try:
        require_arrays(f"`{name}`", (("orientation", orientation, (rows, 4)), ("angular_velocity", rate, (rows, 3))))
    except PluginValueError as error:
        raise InitialStateError(str(error)) from None
    if not (np.abs(np.linalg.norm(orientation, axis=1) - 1.0) <= _ROUNDING).all() or not np.isfinite(rate).all():
        raise InitialStateError(f"`{name}` must give unit quaternions as orientation and finite numbers")
    return orientation, rate


class TumbleParameter(Parameter):
    """Initial attitude and tumble of a target.

    Returns:
        ``orientation`` q_WT (R, 4) and ``angular_velocity`` in T [rad/s] (R, 3).

    Attributes:
        rate: Distribution of the magnitude of the angular velocity, in rad/s unless it has `units`.
        direction: Direction of the angular velocity in the principal axes; None: uniform over the sphere.
        orientation: Attitude q_WT [x, y, z, w], normalised; None: uniform over all attitudes, see `drawn_attitude`.
    """

    rate: functor_field("parameter") = UniformParameter(units="deg/s", low=1.0, high=5.0)  # type: ignore[valid-type]
    direction: tuple[float, float, float] | None = None
    orientation: GivenAttitude = None

    @field_validator("rate")
    @classmethod
    def _is_rate(cls, value: Plugin) -> Plugin:
        if not isinstance(value, ScalarParameter) or value.symbol not in (None, "rad/s"):
            raise ValueError("`rate` must be a number in rad/s or deg/s; use a distribution such as UniformParameter")
        return value

    _has_length = field_validator("direction", "orientation")(require_length)

    def __call__(self, draw: Draw) -> dict[str, FloatArray]:
        """Return the sampled attitude and angular velocity."""
        assert isinstance(self.rate, ScalarParameter), "the field has been validated"
        rate = self.rate(draw.child("rate"))
        assert isinstance(rate, np.ndarray), "such a parameter gives one number for each row"
        return {
            "orientation": drawn_attitude(draw.child("orientation"), self.orientation),
            "angular_velocity": rate[:, None] * self._direction(draw.child("direction")),
        }

    def _direction(self, draw: Draw) -> FloatArray:
        if self.direction is not None:
            return repeated_unit(self.direction, len(draw.streams))
        height, turn = draw.streams.uniform(draw.purpose, 2, draw.index).T
        z, angle = 2.0 * height - 1.0, 2.0 * math.pi * turn
        across = np.sqrt(np.maximum(1.0 - z * z, 0.0))
        return np.stack((across * np.cos(angle), across * np.sin(angle), z), axis=-1)


class TriAxialTumble(Parameter):
    """A tumble about a given direction in the principal axes, from a given or a uniformly random attitude.

    Attributes:
        rate: Initial angular rate [rad/s].
        direction: Direction of the angular velocity in the principal axes; its length does not matter.
        attitude: Initial quaternion [x, y, z, w] from the principal axes to W, normalised; null for a random one.
    """

    rate: NonNegativeAngularRate = 0.08726646259971647
    direction: tuple[float, float, float] = (0.7, 0.5, 0.5)
    attitude: GivenAttitude = None

    _has_length = field_validator("direction", "attitude")(require_length)

    def __call__(self, draw: Draw) -> dict[str, FloatArray]:
        """Return the attitude and the angular velocity."""
        rows = len(draw.streams)
        return {
            "orientation": _random_attitude(draw) if self.attitude is None else repeated_unit(self.attitude, rows),
            "angular_velocity": self.rate * repeated_unit(self.direction, rows),
        }


class RandomTumble(Parameter):
    """A tumble about a uniformly random direction at a uniformly random rate, from a uniformly random attitude.

    Attributes:
        least_rate: Smallest angular rate [rad/s].
        largest_rate: Largest angular rate [rad/s].
    """

    least_rate: NonNegativeAngularRate = 0.03490658503988659
    largest_rate: NonNegativeAngularRate = 0.08726646259971647

    @model_validator(mode="after")
    def _is_range(self) -> RandomTumble:
        if self.least_rate > self.largest_rate:
            raise ValueError(
                f"least_rate ({self.least_rate:.4g} rad/s) is more than largest_rate ({self.largest_rate:.4g} rad/s)"
            )
        return self

    def __call__(self, draw: Draw) -> dict[str, FloatArray]:
        """Return the sampled attitude and angular velocity."""
        rate = UniformParameter(low=self.least_rate, high=self.largest_rate)(draw.child("rate"))
        direction = draw.streams.normal(draw.child("direction").purpose, 3, draw.index)
        direction *= (rate / np.linalg.norm(direction, axis=1))[:, None]
        return {"orientation": _random_attitude(draw), "angular_velocity": direction}


def _random_attitude(draw: Draw) -> FloatArray:
    """Sample uniformly random attitudes, shape (R, 4)."""
    return normalise(draw.streams.normal(draw.child("attitude").purpose, 4, draw.index))
