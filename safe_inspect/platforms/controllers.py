"""Controllers, which turn commanded values into thrusts and moments."""

from __future__ import annotations

from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from pydantic import ConfigDict, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from safe_inspect.errors import did_you_mean
from safe_inspect.platforms.base import Controller
from safe_inspect.plugins.functor import misplaced
from safe_inspect.plugins.plugin import StrictNumbers
from safe_inspect.plugins.registry import own_name
from safe_inspect.types import FloatArray
from safe_inspect.units import Force, Torque, factor, unit


class _ActuatorLimits(StrictNumbers):
    """The quantity that a controller commands, with its smallest and largest value.

    Attributes:
        name: Label of the property.
        low: Smallest value, in `units`.
        high: Largest value, in `units`.
        units: Unit of `low` and `high`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True, allow_inf_nan=False)

    symbol: ClassVar[str]

    name: str = ""
    low: float
    high: float
    units: str

    @model_validator(mode="before")
    @classmethod
    def _one_unit(cls, data: Any) -> Any:
        if isinstance(data, dict) and "units" in data:
            for field in ("low", "high"):
                if not isinstance(data.get(field, 0.0), (int, float)):
                    raise ValueError(f"`{field}` ({data[field]!r}) has a unit in addition to `units`; give one of them")
        return data

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        factor(self.units, self.symbol)
        if not self.low < self.high:
            raise ValueError(f"`low` ({self.low}) is not below `high` ({self.high}); change one of them")
        return self

    @cached_property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest value, SI."""
        scale = unit(self.units).factor
        return self.low * scale, self.high * scale

    def __call__(self, value: FloatArray) -> FloatArray:
        """Return the value clipped to the limits, SI, same shape."""
        low, high = self.limits
        return np.minimum(np.maximum(value, low), high)


class ThrustProp(_ActuatorLimits):
    """Thrust along one axis.

    Attributes:
        name: Label of the property.
        low: Smallest thrust [N].
        high: Largest thrust [N].
        units: Unit of `low` and `high`.
    """

    symbol: ClassVar[str] = "N"

    low: Force = -1.0
    high: Force = 1.0
    units: str = "N"


class MomentProp(_ActuatorLimits):
    """Moment about one axis of the body.

    Attributes:
        name: Label of the property.
        low: Smallest moment [N m].
        high: Largest moment [N m].
        units: Unit of `low` and `high`.
    """

    symbol: ClassVar[str] = "N m"

    low: Torque = -0.001
    high: Torque = 0.001
    units: str = "N m"


#: The properties by the names that a configuration gives them.
_PROPERTIES: dict[str, type[_ActuatorLimits]] = {"ThrustProp": ThrustProp, "MomentProp": MomentProp}


class RateController(Controller):
    """Controller that commands one property along one axis: control_axis = clip(value, low, high).

    Attributes:
        name: Name of the part.
        property_class: The commanded property, a thrust or a moment.
        axis: For a thrust 0, 1 or 2: x, y, z, which are radial, along-track and cross-track for a vehicle that does not
            turn its thrusters. For a moment 3, 4 or 5: about x, y, z of the body.
        properties: Fields of the property, such as ``{name: x_thrust, low: -1, high: 1}``.
    """

    property_class: str = "ThrustProp"
    axis: int = Field(default=0, ge=0, le=5)
    properties: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check_property(self) -> RateController:
        turns, commanded = self.axis > 2, self.commanded  # a wrong property is reported now
        if (commanded.symbol == "N m") != turns:
            right, given = "MomentProp" if turns else "ThrustProp", type(commanded).__name__
            text = f"the axis {self.axis} takes a {right}, not a {given}"
            raise misplaced([(("axis",), f"{text}: 0 to 2 are the axes of thrusts, 3 to 5 those of moments")])
        return self

    @cached_property
    def commanded(self) -> _ActuatorLimits:
        """The property that is commanded.

        Raises:
            ValueError: There is no such property.
            PydanticCustomError: A field of the property is invalid.
        """
        name = own_name(self.property_class)
        if name not in _PROPERTIES:
            raise ValueError(f"unknown property {self.property_class!r}; {did_you_mean(name, _PROPERTIES)}")
        cls = _PROPERTIES[name]
        try:
            return cls.model_validate(self.properties)
        except ValidationError as error:
            problems: list[dict[str, Any]] = [
                {**item, "loc": ("properties", *item["loc"])} for item in error.errors(include_url=False)
            ]
            for item in problems:
                if item["type"] == "extra_forbidden":
                    key = str(item["loc"][-1])
                    item["msg"] = f"{name} has no field `{key}`; {did_you_mean(key, cls.model_fields)}"
            raise PydanticCustomError("functor", "the property is wrong", {"errors": problems}) from None

    @cached_property
    def limits(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest command, two arrays of shape (1,)."""
        low, high = self.commanded.limits
        return np.array([low]), np.array([high])

    @property
    def control_size(self) -> int:
        """Number of elements of the returned control: 3 for a thrust, 6 for a moment."""
        return 3 if self.axis < 3 else 6

    def __call__(self, values: FloatArray) -> FloatArray:
        """Return the share of the control [N, N m], shape (R, control_size), for commands of shape (R, 1)."""
        share = np.zeros((len(values), self.control_size))
        share[:, self.axis] = self.commanded(values[:, 0])
        return share
