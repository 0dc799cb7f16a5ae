"""Glues of the observation: a sensor's reading, and quantities that are computed from readings."""

from __future__ import annotations

import functools
from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np
from pydantic import field_validator

from safe_inspect.geometry.distance import lengths
from safe_inspect.glues.base import Bounds, ObservationGlue, Parts, sensor_of
from safe_inspect.glues.normalizers import Normalization, Normalizer
from safe_inspect.plugins.functor import functor_field
from safe_inspect.plugins.plugin import SensorName
from safe_inspect.simulators.row_plugin import RowPlugin
from safe_inspect.simulators.view import ReadsState, View
from safe_inspect.tasks.docking.speed_limit import SpeedLimit
from safe_inspect.types import FloatArray
from safe_inspect.units import factor, unit


class ObserveSensor(ObservationGlue):
    """The reading of a sensor in `output_units`, normalised; shape (R, size of the sensor).

    Attributes:
        sensor: Name of the sensor.
        output_units: Unit of the observation before normalisation. Default: the SI unit. A dimensionless sensor, such
            as one of a direction, ignores it.
        normalization: The normaliser to apply.
    """

    sensor: SensorName = "Sensor_Position"
    output_units: str | None = None
    normalization: Normalization = Normalization(enabled=False)

    @field_validator("output_units")
    @classmethod
    def _known_unit(cls, value: str | None) -> str | None:
        if value is not None:
            unit(value)
        return value

    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return ``sensor.element`` for each element."""
        return tuple(f"{self.sensor}.{element}" for element in sensor_of(parts, self.sensor).element_names)

    def bounds(self, parts: Parts) -> Bounds:
        """Return the bounds of the normalised reading.

        Raises:
            ValueError: The units or the normaliser do not match the sensor.
        """
        _, _, low, high = self.prepared(sensor_of(parts, self.sensor))
        return self.normalization.bounds(low, high)

    def __call__(self, view: View) -> FloatArray:
        """Return the observation, shape (R, size)."""
        scale, normalizer, low, high = self.prepared(view.group.sensors[self.sensor])
        values = view.reading(self.sensor)
        if scale != 1.0:
            values = values * scale
        return values if normalizer is None else normalizer(values, low, high)

    def prepared(self, sensor: ReadsState) -> tuple[float, Normalizer | None, FloatArray, FloatArray]:
        """Return what each observation of the sensor needs: scale, normaliser, low, high."""
        scaled = self.output_units is not None and sensor.symbol
        scale = _per_unit(str(self.output_units), sensor.symbol) if scaled else 1.0
        return scale, self.normalization.active, *_limits(sensor.limits, sensor.size, scale)


@functools.lru_cache(maxsize=256)
def _per_unit(units: str, symbol: str) -> float:
    return 1.0 / factor(units, symbol)


@functools.lru_cache(maxsize=256)
def _limits(bounds: tuple[float, float], size: int, scale: float) -> Bounds:
    return np.full(size, bounds[0] * scale), np.full(size, bounds[1] * scale)


class DerivedGlue(ObservationGlue, RowPlugin):
    """A normalised quantity that is computed from the agent's sensor readings; shape (R, size).

    A subclass defines either `values` or `row`, a row kernel that writes the quantity into its last argument, shape
    (`row_size`,).

    Attributes:
        normalization: The normaliser to apply.

    Class attributes:
        row_size: Number of elements of the quantity, if the subclass defines `row`.
    """

    row_size: ClassVar[int] = 0

    normalization: Normalization = Normalization(enabled=False)

    def values(self, view: View) -> FloatArray:
        """Return the quantity, shape (R, size)."""
        return self.call_rows(view)

    def row_result(self) -> tuple[type[Any], int]:
        """Return the element type (float) and the number of elements."""
        return np.float64, self.row_size

    @abstractmethod
    def limits(self, parts: Parts) -> Bounds:
        """Return the quantity's smallest and largest values, two arrays of shape (size,)."""

    def bounds(self, parts: Parts) -> Bounds:
        """Return the bounds of the normalised quantity.

        Raises:
            ValueError: The normaliser does not match the quantity.
        """
        return self.normalization.bounds(*self.limits(parts))

    def __call__(self, view: View) -> FloatArray:
        """Return the observation, shape (R, size)."""
        values, normalizer = self.values(view), self.normalization.active
        if normalizer is None:
            return values
        sensors: Any = view.group.sensors
        return normalizer(values, *self.limits(sensors))


class SimsMagnitudeGlue(DerivedGlue):
    """The Euclidean norm of another glue's observation; shape (R, 1).

    Attributes:
        wrapped: The glue.
    """

    wrapped: functor_field("glue") = ObserveSensor(sensor="Sensor_Velocity")  # type: ignore[valid-type]

    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return ``|element, element, ...|``."""
        wrapped: Any = self.wrapped
        return (f"|{', '.join(wrapped.names(parts))}|",)

    def limits(self, parts: Parts) -> Bounds:
        """Return 0 and the norm of the largest values."""
        wrapped: Any = self.wrapped
        low, high = wrapped.bounds(parts)
        return np.zeros(1), lengths(np.maximum(np.abs(low), np.abs(high))[None])

    def values(self, view: View) -> FloatArray:
        """Return the norm, shape (R, 1)."""
        wrapped: Any = self.wrapped
        return lengths(wrapped(view))[:, None]


class VelocityLimitGlue(SpeedLimit, DerivedGlue):
    """The speed limit for docking at the distance that a position sensor measures [m/s]; shape (R, 1).

    Attributes:
        sensor: Name of the sensor that measures the position relative to the chief.
    """

    sensor: SensorName = "Sensor_Position"

    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return ``sensor.speed_limit``."""
        return (f"{self.sensor}.speed_limit",)

    def limits(self, parts: Parts) -> Bounds:
        """Return the speed limit near the chief, and infinity as the upper bound."""
        return np.array([self.velocity_threshold]), np.full(1, np.inf)

    def values(self, view: View) -> FloatArray:
        """Return the speed limit [m/s], shape (R, 1)."""
        threshold, distance, slope, _ = self.limit_line(view.world)
        limit: FloatArray = threshold + slope * np.maximum(lengths(view.reading(self.sensor))[:, None] - distance, 0.0)
        return limit
