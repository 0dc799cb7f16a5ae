"""Normalisers, which map values with units to the range of a network's inputs and outputs, and back."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from safe_inspect.plugins.functor import build
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.types import FloatArray


class Affine(NamedTuple):
    """The map add + (x - subtract) * multiply / divide, elementwise and in this order of operations.

    The defaults 0, 1, 1 and -0.0 change no number, not even -0.0.

    Attributes:
        subtract: Number to subtract, shape (1,) or (k,); the other arrays have the same shapes.
        multiply: Factor.
        divide: Divisor.
        add: Number to add.
    """

    subtract: FloatArray = np.zeros(1)
    multiply: FloatArray = np.ones(1)
    divide: FloatArray = np.ones(1)
    add: FloatArray = np.full(1, -0.0)

    def map(self, values: FloatArray) -> FloatArray:
        """Return the mapped values, shape (R, k)."""
        return np.asarray(self.add + (values - self.subtract) * self.multiply / self.divide)

    @property
    def gain(self) -> FloatArray:
        """The total factor of the map, multiply / divide."""
        return np.asarray(self.multiply / self.divide)

    @property
    def offset(self) -> FloatArray:
        """The value of the map at 0."""
        return np.asarray(self.add - self.subtract * self.multiply / self.divide)


class Normalizer(Plugin):
    """Base class of normalisers. Called with values (R, k) and bounds (k,), a normaliser returns an array (R, k)."""

    kind: ClassVar[str] = "normalizer"

    @abstractmethod
    def __call__(self, values: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return the normalised values, shape (R, k)."""

    def affine(self, low: FloatArray, high: FloatArray) -> Affine | None:
        """Return the map in the form that compiled steps and policy files use, or None if it is not affine.

        Args:
            low: Smallest values, shape (k,).
            high: Largest values, shape (k,).
        """
        return None

    @abstractmethod
    def inverse(self, values: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return the values that the normaliser maps to the given values, shape (R, k)."""

    def check(self, size: int, low: FloatArray, high: FloatArray) -> None:
        """Raise ValueError if the normaliser cannot be applied to `size` elements with these bounds."""


class StandardNormalNormalizer(Normalizer):
    """Standardisation (x - mu) / sigma, elementwise.

    Attributes:
        mu: Mean, one number or one for each element, in the unit of the values.
        sigma: Standard deviation, likewise; above 0.
    """

    mu: float | tuple[float, ...] = 0.0
    sigma: float | tuple[float, ...] = 1.0

    @field_validator("sigma")
    @classmethod
    def _positive(cls, value: float | tuple[float, ...]) -> float | tuple[float, ...]:
        if not np.all(np.atleast_1d(value) > 0.0):
            raise ValueError(f"a standard deviation must be above 0, not {value}")
        return value

    @cached_property
    def arrays(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation, two arrays of shape (1,) or (k,)."""
        return np.atleast_1d(np.array(self.mu, np.float64)), np.atleast_1d(np.array(self.sigma, np.float64))

    def check(self, size: int, low: FloatArray, high: FloatArray) -> None:
        """Raise ValueError if the number of elements of `mu` or `sigma` differs from `size`."""
        for field, array in zip(("mu", "sigma"), self.arrays, strict=True):
            if array.size not in (1, size):
                raise ValueError(
                    f"`{field}` has {array.size} elements for values of size {size}; give one number or {size}"
                )

    def __call__(self, values: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return (values - mu) / sigma."""
        return self.affine(low, high).map(values)

    def affine(self, low: FloatArray, high: FloatArray) -> Affine:
        """Return (x - mu) / sigma."""
        mu, sigma = self.arrays
        return Affine(subtract=mu, divide=sigma)

    def inverse(self, values: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return mu + sigma * values."""
        mu, sigma = self.arrays
        return mu + sigma * values


class LinearNormalizer(Normalizer):
    """Linear map from the bounds of the values to [minimum, maximum].

    Attributes:
        minimum: Image of the smallest value.
        maximum: Image of the largest value.
    """

    minimum: float = Field(default=-1.0)
    maximum: float = Field(default=1.0)

    @model_validator(mode="after")
    def _ordered(self) -> LinearNormalizer:
        if not self.minimum < self.maximum:
            raise ValueError(f"`minimum` ({self.minimum}) must be below `maximum` ({self.maximum})")
        return self

    def check(self, size: int, low: FloatArray, high: FloatArray) -> None:
        """Raise ValueError if a value is unbounded."""
        if not (np.isfinite(low).all() and np.isfinite(high).all()):
            raise ValueError(
                "values without bounds cannot be mapped onto an interval; "
                "use StandardNormalNormalizer, or `normalization: {enabled: False}`"
            )

    def __call__(self, values: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return the values mapped from [low, high] onto [minimum, maximum]."""
        return self.affine(low, high).map(values)

    def affine(self, low: FloatArray, high: FloatArray) -> Affine:
        """Return minimum + (x - low) (maximum - minimum) / (high - low)."""
        slope = (self.maximum - self.minimum) / (high - low)
        return Affine(subtract=low, multiply=slope, add=np.full(1, self.minimum))

    def inverse(self, values: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return the values mapped from [minimum, maximum] onto [low, high]."""
        return np.asarray(low + (values - self.minimum) * ((high - low) / (self.maximum - self.minimum)))


class Normalization(BaseModel):
    """Configuration of a glue's normaliser.

    Attributes:
        enabled: If False, the values are not normalised.
        normalizer: Name of the normaliser.
        config: Fields of the normaliser.
        output_units: A key of safe-autonomy-sims, which has no effect there or here.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    enabled: bool = True
    normalizer: str = "LinearNormalizer"
    config: dict[str, Any] = Field(default_factory=dict)
    output_units: Any = None

    @field_validator("config", mode="before")
    @classmethod
    def _nothing(cls, value: Any) -> Any:
        return {} if value is None else value

    @model_validator(mode="after")
    def _check_normalizer(self) -> Normalization:
        assert self.active is not None or not self.enabled  # a wrong normaliser is found now
        return self

    @cached_property
    def active(self) -> Normalizer | None:
        """The normaliser, or None if normalisation is disabled.

        Raises:
            PydanticCustomError: There is no such normaliser, or a field of it is wrong.
        """
        if not self.enabled:
            return None
        try:
            made = build("normalizer", {"functor": self.normalizer, "config": self.config})
        except PydanticCustomError as error:
            problems = [
                {**problem, "loc": ("normalizer",) if problem["loc"] == ("functor",) else problem["loc"]}
                for problem in (error.context or {})["errors"]
            ]
            raise PydanticCustomError("functor", "the normaliser is wrong", {"errors": problems}) from None
        assert isinstance(made, Normalizer)
        return made

    def bounds(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of the normalised values.

        Args:
            low: Smallest values, shape (k,).
            high: Largest values, shape (k,).

        Raises:
            ValueError: The normaliser does not match the values.
        """
        if self.active is None:
            return low, high
        self.active.check(len(low), low, high)
        return self.active(low, low, high), self.active(high, low, high)

    def affine(self, low: FloatArray, high: FloatArray) -> Affine | None:
        """Return the map as by `Normalizer.affine`; without normalisation, the map that changes no number."""
        return Affine() if self.active is None else self.active.affine(low, high)
