"""`ObserveSensor`: a sensor's reading, converted and normalised, as a part of the observation."""

from __future__ import annotations

import functools

import numpy as np
from pydantic import field_validator

from safe_inspect.glues.base import Bounds, ObservationGlue, Parts, sensor_of
from safe_inspect.glues.normalization import Normalization
from safe_inspect.glues.normalizers import Normalizer
from safe_inspect.plugins.plugin import SensorName
from safe_inspect.simulators.view import ReadsState, View
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
        sensor = sensor_of(parts, self.sensor)
        low, high = _limits(sensor.limits, sensor.size, self._scale(sensor.symbol))
        normalizer = self.normalization.active
        if normalizer is None:
            return low, high
        normalizer.check(sensor.size, low, high)
        return normalizer(low, low, high), normalizer(high, low, high)

    def __call__(self, view: View) -> FloatArray:
        """Return the observation, shape (R, size)."""
        scale, normalizer, low, high = self.prepared(view.group.sensors[self.sensor])
        values = view.reading(self.sensor)
        if scale != 1.0:
            values = values * scale
        return values if normalizer is None else normalizer(values, low, high)

    def prepared(self, sensor: ReadsState) -> tuple[float, Normalizer | None, FloatArray, FloatArray]:
        """Return what each observation of the sensor needs: scale, normaliser, low, high; computed once per sensor."""
        known = self.__dict__.get("_known")
        if known is None or known[0] is not sensor:
            scale = self._scale(sensor.symbol)
            low, high = _limits(sensor.limits, sensor.size, scale)
            known = self.__dict__["_known"] = (sensor, (scale, self.normalization.active, low, high))
        prepared: tuple[float, Normalizer | None, FloatArray, FloatArray] = known[1]
        return prepared

    def _scale(self, symbol: str) -> float:
        return 1.0 if self.output_units is None or symbol == "" else _per_unit(self.output_units, symbol)


@functools.lru_cache(maxsize=256)
def _per_unit(units: str, symbol: str) -> float:
    return 1.0 / factor(units, symbol)


@functools.lru_cache(maxsize=256)
def _limits(bounds: tuple[float, float], size: int, scale: float) -> Bounds:
    return np.full(size, bounds[0] * scale), np.full(size, bounds[1] * scale)
