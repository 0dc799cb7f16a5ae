"""`TumbleParameter`: initial attitude and angular velocity of a target."""

from __future__ import annotations

import math

import numpy as np
from pydantic import field_validator

from safe_inspect.plugins.functor import functor_field
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators.resets.initializers import GivenAttitude, drawn_attitude, repeated_unit, require_length
from safe_inspect.simulators.resets.parameters import Draw, Parameter, ScalarParameter, UniformParameter
from safe_inspect.types import FloatArray


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
