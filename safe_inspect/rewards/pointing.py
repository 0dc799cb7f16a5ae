"""Reward for pointing a camera at a body."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pydantic import Field, field_validator

from safe_inspect.compiling import njit
from safe_inspect.dynamics.rotation_row import rotated
from safe_inspect.plugins.plugin import EntityName
from safe_inspect.rewards.base import Reward
from safe_inspect.simulators import Group, World
from safe_inspect.simulators.resets.initializers import require_length
from safe_inspect.simulators.row_terms import BodyArray, OwnArray, RowTerm
from safe_inspect.types import FloatArray


@njit
def _decay(
    rule: FloatArray, axis: FloatArray, orientation: FloatArray, position: FloatArray, target: FloatArray
) -> float:
    """Return the reward for the cosine of the angle between a camera's axis and the direction to a body.

    The cosine is 0 at distance 0.

    Args:
        rule: Largest reward, cosine with this reward, width of the Gaussian and largest difference [-], shape (4,).
        axis: Unit vector of the axis in body axes, shape (3,).
        orientation: Attitude quaternion from body to Hill's frame, shape (4,).
        position: Position of the camera's vehicle [m], shape (3,).
        target: Position of the body [m], shape (3,).
    """
    x, y, z = target[0] - position[0], target[1] - position[1], target[2] - position[2]
    size = math.sqrt(x * x + y * y + z * z)
    cosine = 0.0
    if size != 0.0:
        look = rotated(orientation, axis[0], axis[1], axis[2])
        cosine = (look[0] * x + look[1] * y + look[2] * z) / size
    away = cosine - rule[1]
    return rule[0] * math.exp(-away * away / rule[2]) if abs(away) <= rule[3] else 0.0


class GaussianDecayFromTargetValue(Reward):
    """Pay ``scale exp(-(f - target)^2 / eps)``, where f is the cosine of the camera's angle to a body; shape (R,).

    The angle is that between the camera's axis and the direction to the body. Nothing is paid if f differs from the
    target by more than `max_diff`. With the defaults, pointing at the body is rewarded, and pointing away from it pays
    nothing.

    Attributes:
        entity_name: Name of the body.
        initial_sensor_unit_vec: Axis of the camera in body axes; any length.
        reward_scale: Largest reward of a step [-].
        target_value: The cosine with the largest reward [-].
        eps: Width of the Gaussian [-].
        max_diff: Largest rewarded difference from the target [-].
        observation: A key of safe-autonomy-sims: the rewarded observation, which must be that cosine.
        index: A key of safe-autonomy-sims: the element of that observation, which has only one.
    """

    entity_name: EntityName = "chief"
    initial_sensor_unit_vec: tuple[float, float, float] = (1.0, 0.0, 0.0)
    reward_scale: float = 0.0005
    target_value: float = 1.0
    eps: float = Field(default=0.15, gt=0)
    max_diff: float = Field(default=1.0, ge=0)
    observation: dict[str, Any] | None = None
    index: int = Field(default=0, ge=0, le=0)

    _has_length = field_validator("initial_sensor_unit_vec")(require_length)

    @field_validator("observation")
    @classmethod
    def _is_facing(cls, value: dict[str, Any] | None) -> dict[str, Any] | None:
        names = str(value)
        if value is not None and not all(part in names for part in ("OrientationUnitVector", "DotProduct", "Position")):
            raise ValueError(
                "the reward supports only the inner product of the camera's axis and the relative position as "
                "observation; remove the key, and name the body in `entity_name`"
            )
        return value

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: the reward for the cosine."""
        rule = np.array([self.reward_scale, self.target_value, self.eps, self.max_diff])
        axis = np.array(self.initial_sensor_unit_vec) / math.hypot(*self.initial_sensor_unit_vec)
        return RowTerm(
            _decay,
            (rule, axis, OwnArray("orientation"), OwnArray("position"), BodyArray("position", self.entity_name)),
        )
