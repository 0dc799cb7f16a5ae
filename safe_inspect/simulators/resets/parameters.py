"""Reset parameters: constants, distributions and accessors, one value for each environment and episode."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, field_validator, model_validator

from safe_inspect.errors import ConfigError, Problem, did_you_mean
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.random.streams import Streams
from safe_inspect.types import BoolArray, FloatArray, IntArray
from safe_inspect.units import unit

#: A drawn value: one number per row, or named states of one body.
Value = FloatArray | dict[str, FloatArray]


@dataclass(frozen=True)
class Draw:
    """All inputs of a draw.

    Attributes:
        streams: Random streams of the R episodes that start.
        purpose: Purpose of the draw, such as ``init_state.radius``.
        index: Number of the attempt, for repeated draws.
        values: Reset parameters drawn before, by name.
        fixed: States that are given instead of drawn, by name, each with R rows.
        test: Function of the states of some rows and of the indices of these rows that returns, by reason, a mask of
            the rows to reject.
    """

    streams: Streams
    purpose: str
    index: int = 0
    values: Mapping[str, Value] = field(default_factory=dict)
    fixed: Mapping[str, FloatArray] = field(default_factory=dict)
    test: Callable[[Mapping[str, FloatArray], IntArray], dict[str, BoolArray]] | None = None

    def child(self, name: str) -> Draw:
        """Return the draw of a part of this draw."""
        return replace(self, purpose=f"{self.purpose}.{name}" if self.purpose else name)

    def part(self, rows: IntArray, index: int) -> Draw:
        """Return an attempt to draw values for some of the rows only, without fixed states and without a test."""
        values = {
            name: {key: array[rows] for key, array in value.items()} if isinstance(value, dict) else value[rows]
            for name, value in self.values.items()
        }
        return Draw(self.streams[rows], self.purpose, index, values)


def either(one: Mapping[str, BoolArray], other: Mapping[str, BoolArray]) -> dict[str, BoolArray]:
    """Return, by reason, the mask of the rows that one test or the other rejects."""
    return {**one, **{name: one[name] | rows if name in one else rows for name, rows in other.items()}}


class Parameter(Plugin):
    """A value that is sampled at every reset.

    Calling it returns the SI value, shape (R,), or a mapping of named states.
    """

    kind: ClassVar[str] = "parameter"

    @abstractmethod
    def __call__(self, draw: Draw) -> Value:
        """Return the sampled value in SI units."""

    @property
    def symbol(self) -> str | None:
        """SI unit of the value; None if the configuration does not state a unit."""
        return None


class ScalarParameter(Parameter):
    """Base class of parameters whose value is one number; `units` is the unit of all numbers in the configuration.

    Attributes:
        name: Label, for readers of the configuration.
        units: Unit of the numbers; default: the SI unit that the user of the parameter expects.
    """

    name: str = ""
    units: str | None = None

    @field_validator("units")
    @classmethod
    def _known_unit(cls, value: str | None) -> str | None:
        if value is not None:
            unit(value)
        return value

    @property
    def symbol(self) -> str | None:
        """SI unit of the value; None if the configuration does not state a unit."""
        return None if self.units is None else unit(self.units).symbol

    @property
    def factor(self) -> float:
        """Factor that converts a number of the configuration to SI."""
        return 1.0 if self.units is None else unit(self.units).factor

    @property
    def support(self) -> tuple[float, float] | None:
        """Smallest and largest value in SI; None, the default, if they are not known."""
        return None


class ConstantParameter(ScalarParameter):
    """The same value at every reset.

    Attributes:
        value: The value, in `units`.
    """

    value: float = Field(default=0.0)

    def __call__(self, draw: Draw) -> FloatArray:
        """Return `value` for every row, shape (R,)."""
        return np.full(len(draw.streams), self.value * self.factor)

    @property
    def support(self) -> tuple[float, float]:
        """The value in SI, twice."""
        return self.value * self.factor, self.value * self.factor


class UniformParameter(ScalarParameter):
    """Uniform distribution between `low` and `high`.

    Attributes:
        low: Smallest value, in `units`.
        high: Largest value, in `units`.
    """

    low: float = Field(default=0.0)
    high: float = Field(default=1.0)

    @model_validator(mode="after")
    def _ordered(self) -> UniformParameter:
        if self.low > self.high:
            raise ValueError(f"`low` ({self.low}) is above `high` ({self.high}); swap them")
        return self

    def __call__(self, draw: Draw) -> FloatArray:
        """Return low + U (high - low), U uniform in [0, 1), shape (R,)."""
        draws = draw.streams.uniform(draw.purpose, index=draw.index)[:, 0]
        return np.asarray(self.low * self.factor + draws * ((self.high - self.low) * self.factor))

    @property
    def support(self) -> tuple[float, float]:
        """`low` and `high` in SI."""
        return self.low * self.factor, self.high * self.factor


class TruncatedNormalParameter(ScalarParameter):
    """Normal distribution with mean `mu` and standard deviation `std`, drawn by inversion within [low, high].

    Attributes:
        mu: Mean of the normal before truncation, in `units`.
        std: Standard deviation before truncation, in `units`.
        low: Smallest value, in `units`.
        high: Largest value, in `units`.
    """

    mu: float = Field(default=0.0)
    std: float = Field(default=1.0, gt=0)
    low: float = Field(default=-np.inf, allow_inf_nan=True)
    high: float = Field(default=np.inf, allow_inf_nan=True)

    @model_validator(mode="after")
    def _ordered(self) -> TruncatedNormalParameter:
        if not self.low < self.high:
            raise ValueError(f"`low` ({self.low}) is not below `high` ({self.high}); change one of them")
        if not self._tail(self._span[1]) > self._tail(self._span[0]):
            raise ValueError(
                f"[{self.low}, {self.high}] lies too far from `mu` ({self.mu}) for a `std` of {self.std}; widen one"
            )
        return self

    @property
    def _span(self) -> tuple[float, float]:
        """The bounds in standard deviations; mirrored if both are above the mean, where the tail loses precision."""
        low, high = (self.low - self.mu) / self.std, (self.high - self.mu) / self.std
        return (-high, -low) if low > 0.0 else (low, high)

    @staticmethod
    def _tail(bound: float) -> float:
        """Return the probability of the standard normal distribution below a bound."""
        return 0.5 * math.erfc(-bound / math.sqrt(2.0))

    def __call__(self, draw: Draw) -> FloatArray:
        """Return the quantile of the truncated normal at a uniform draw, shape (R,)."""
        from scipy.special import ndtri  # slow to import, and not needed by the shipped tasks, which draw uniformly

        draws = draw.streams.interior(draw.purpose, index=draw.index)[:, 0]
        below, above = (self._tail(bound) for bound in self._span)
        sign = -1.0 if self.low > self.mu else 1.0
        value = self.mu + sign * self.std * ndtri(below + draws * (above - below))
        return np.asarray(np.clip(value, self.low, self.high) * self.factor)

    @property
    def support(self) -> tuple[float, float]:
        """`low` and `high` in SI."""
        return self.low * self.factor, self.high * self.factor


class SimAttributeAccessor(Parameter):
    """The value of another reset parameter, or of one of its states.

    Attributes:
        attribute_name: Dotted path such as ``init_state`` or ``init_state.sun_angle``.
    """

    attribute_name: str = Field(default="init_state", min_length=1)

    def __call__(self, draw: Draw) -> Value:
        """Return the value of the reset parameter with that name.

        Raises:
            ConfigError: There is no such parameter.
        """
        value: Any = draw.values
        for part in self.attribute_name.split("."):
            if not isinstance(value, Mapping) or part not in value:
                known = value if isinstance(value, Mapping) else ()
                text = f"`{self.attribute_name}` is not a reset parameter; {did_you_mean(part, map(str, known))}"
                raise ConfigError(Problem(text, path=draw.purpose))
            value = value[part]
        return value  # type: ignore[no-any-return]
