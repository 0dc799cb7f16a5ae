"""Metrics of what an agent knows: errors of its sensors and of its estimated state."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from safe_inspect.geometry.distance import lengths
from safe_inspect.metrics.base import Metric, Reduce
from safe_inspect.simulators.view import Step
from safe_inspect.types import FloatArray


class ReadingError(Metric):
    """Mean length of the difference that a sensor's `errors` make to its reading after the steps; shape (R,).

    Attributes:
        sensor: Name of the sensor.
        symbol: SI unit of the reading.
    """

    reduce: ClassVar[Reduce] = "mean"

    sensor: str = Field(default="Sensor_Position", min_length=1)
    symbol: str = "-"

    @property
    def unit(self) -> str:  # type: ignore[override]
        """Unit of the reading."""
        return self.symbol or "-"

    @property
    def label(self) -> str:
        """Name of the metric in tables."""
        return f"error of {self.sensor}"

    def __call__(self, step: Step) -> FloatArray:
        """Return the length of the difference, NaN for agents without that sensor, shape (R,)."""
        view = step.after
        sensor: Any = view.group.sensors.get(self.sensor)
        if sensor is None:
            return np.full(view.num_rows, np.nan)
        return lengths(view.reading(self.sensor) - getattr(sensor, "truth", sensor)(view))


class EstimateError(Metric):
    """Mean distance between the estimated and the real state after the steps, 0 without an estimate; shape (R,).

    Attributes:
        quantity: ``position`` [m] or ``velocity`` [m/s].
    """

    reduce: ClassVar[Reduce] = "mean"

    quantity: Literal["position", "velocity"] = "position"

    @property
    def unit(self) -> str:  # type: ignore[override]
        """Unit of the quantity."""
        return "m" if self.quantity == "position" else "m/s"

    @property
    def label(self) -> str:
        """Name of the metric in tables."""
        return f"error of estimated {self.quantity}"

    def __call__(self, step: Step) -> FloatArray:
        """Return the distance, shape (R,)."""
        view, name = step.after, f"estimated_{self.quantity}"
        if name not in view.world.offers.view:
            return np.zeros(view.num_rows)
        return lengths(getattr(view, name) - getattr(view, self.quantity))
