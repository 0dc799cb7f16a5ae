"""Controllers: from commanded values to thrust."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from pydantic import Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from safe_inspect.errors import RegistryError, did_you_mean
from safe_inspect.platforms.base import Controller, Property
from safe_inspect.plugins.registry import registry
from safe_inspect.types import FloatArray
from safe_inspect.units import Force, unit


class ThrustProp(Property):
    """Thrust along one axis.

    Attributes:
        name: Label of the property.
        low: Smallest thrust [N].
        high: Largest thrust [N].
        units: Unit of `low` and `high`.
    """

    low: Force = -1.0
    high: Force = 1.0
    units: str = "N"

    @model_validator(mode="before")
    @classmethod
    def _one_unit(cls, data: Any) -> Any:
        if isinstance(data, dict) and "units" in data:
            for field in ("low", "high"):
                if not isinstance(data.get(field, 0.0), (int, float)):
                    raise ValueError(f"`{field}` ({data[field]!r}) has a unit beside `units`; give one of them")
        return data

    @model_validator(mode="after")
    def _ordered(self) -> ThrustProp:
        if unit(self.units).symbol != "N":
            raise ValueError(f"{self.units!r} is no unit of force; use 'N'")
        if not self.low < self.high:
            raise ValueError(f"`low` ({self.low}) is not below `high` ({self.high})")
        return self

    @cached_property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest thrust [N]."""
        scale = unit(self.units).factor
        return self.low * scale, self.high * scale

    def __call__(self, value: FloatArray) -> FloatArray:
        """Return the thrust within its limits [N], same shape."""
        low, high = self.limits
        return np.minimum(np.maximum(value, low), high)


class RateController(Controller):
    """Command one property along one axis of Hill's frame: thrust_axis = clip(value, low, high).

    Attributes:
        name: Name of the part.
        property_class: What is commanded.
        axis: 0 radial, 1 along track, 2 cross track.
        properties: Fields of the property, such as ``{name: x_thrust, low: -1, high: 1}``.
    """

    property_class: str = "ThrustProp"
    axis: int = Field(default=0, ge=0, le=2)
    properties: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check_property(self) -> RateController:
        assert self.commanded is not None  # a wrong property is found now, not at the first step
        return self

    @cached_property
    def commanded(self) -> Property:
        """The property that is commanded.

        Raises:
            ValueError: There is no such property.
            PydanticCustomError: A field of it is wrong.
        """
        try:
            cls = registry.get("property", self.property_class)
        except RegistryError as error:
            raise ValueError(str(error)) from None
        try:
            made = cls.model_validate(self.properties)
        except ValidationError as error:
            problems: list[dict[str, Any]] = [
                {**item, "loc": ("properties", *item["loc"])} for item in error.errors(include_url=False)
            ]
            for item in problems:
                if item["type"] == "extra_forbidden":
                    name = str(item["loc"][-1])
                    item["msg"] = f"{cls.registered_name} has no field `{name}`; {did_you_mean(name, cls.model_fields)}"
            raise PydanticCustomError("functor", "the property is wrong", {"errors": problems}) from None
        assert isinstance(made, Property)
        return made

    @cached_property
    def limits(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest command, two arrays of shape (1,)."""
        low, high = self.commanded.limits
        return np.array([low]), np.array([high])

    def __call__(self, values: FloatArray) -> FloatArray:
        """Return the thrust [N], Hill frame, shape (R, 3), for commands of shape (R, 1)."""
        thrust = np.zeros((len(values), 3))
        thrust[:, self.axis] = self.commanded(values[:, 0])
        return thrust
