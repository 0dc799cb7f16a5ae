"""Errors of sensors: noise, bias, resolution, delay and lost readings, for every sensor by its field `errors`."""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from safe_inspect.compiling import njit
from safe_inspect.platforms.copies import copy_vector
from safe_inspect.random.splitmix import mix, normal_at, uniform_at
from safe_inspect.simulators import Group, View, World
from safe_inspect.simulators.row_terms import RowTerm, SensorMemory
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.types import AnyArray, FloatArray, IntArray

_READING, _BIAS, _LATE = "measured_reading", "measured_bias", "measured_late"


class SensorErrors(BaseModel):
    """Errors of each element of a sensor's reading, in the unit of the reading.

    The measured value is ``truth + bias + noise``, rounded to the resolution and limited to the sensor's range. The
    agent gets it `delay` steps later; until then, it gets the first one. If a reading is lost, the agent gets the
    last one again. All draws are functions of the seed, the slot, the episode, the step, the agent and the sensor.

    Attributes:
        noise: Standard deviation of the white noise.
        bias: Standard deviation of the bias at a reset.
        walk: Standard deviation by which the bias grows in a second [unit of the reading / s^0.5].
        resolution: Smallest difference between two readings; 0: none.
        delay: Number of steps of the agent between the measurement and the reading.
        dropout: Probability that the reading of a step is lost [-].
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    noise: float = Field(default=0.0, ge=0.0)
    bias: float = Field(default=0.0, ge=0.0)
    walk: float = Field(default=0.0, ge=0.0)
    resolution: float = Field(default=0.0, ge=0.0)
    delay: int = Field(default=0, ge=0, le=1000)
    dropout: float = Field(default=0.0, ge=0.0, lt=1.0)


@njit
def _measure(
    rule: FloatArray, salt: np.uint64, agents: int, key: AnyArray, step: IntArray, truth: FloatArray,
    reading: FloatArray, bias: FloatArray, late: FloatArray,
) -> None:  # fmt: skip
    """Write the readings of a sensor with errors.

    Args:
        rule: Standard deviations of noise, of the first bias and of its growth in a step; resolution; probability of a
            lost reading; smallest and largest reading; shape (7,).
        salt: Number of the sensor.
        agents: Number of agents of the group, G.
        key: Key of each episode, shape (N,).
        step: Steps since the reset, shape (N,).
        truth: The true values, shape (N G, k).
        reading: The last readings; written, shape (N G, k).
        bias: The biases; written, shape (N G, k).
        late: The last ``delay + 1`` measured values; written, shape (N G, delay + 1, k).
    """
    size, rooms = truth.shape[1], late.shape[1]
    for row in range(truth.shape[0]):
        now = step[row // agents]
        own = mix(key[row // agents] ^ (salt + np.uint64(row % agents)))
        for k in range(size):
            if now == 0:
                bias[row, k] = rule[1] * normal_at(own, now, 4 * k)
            else:
                bias[row, k] += rule[2] * normal_at(own, now, 4 * k)
            value = truth[row, k] + bias[row, k] + rule[0] * normal_at(own, now, 4 * k + 1)
            if rule[3] > 0.0:
                value = rule[3] * np.rint(value / rule[3])
            value = min(max(value, rule[5]), rule[6])
            if now == 0:
                for room in range(rooms):
                    late[row, room, k] = value
            late[row, now % rooms, k] = value
        if now == 0 or not uniform_at(own, now, 8 * size) < rule[4]:
            for k in range(size):
                reading[row, k] = late[row, (now + 1) % rooms, k]


class Measured:
    """A sensor whose readings have errors; it has the interface of the `Sensor` for a simulation.

    Args:
        sensor: The sensor without errors.
        errors: The errors.
    """

    def __init__(self, sensor: Any, errors: SensorErrors) -> None:
        self._sensor, self._errors = sensor, errors
        self._salt = np.uint64(zlib.crc32(sensor.part_name.encode()) << 20)

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the sensor, such as its `limits`."""
        if name.startswith("__") or name in ("_sensor", "_errors", "_salt"):  # while it is unpickled
            raise AttributeError(name)
        return getattr(self._sensor, name)

    def __eq__(self, other: object) -> bool:
        """Return whether sensor and errors are equal."""
        return isinstance(other, Measured) and (self._sensor, self._errors) == (other._sensor, other._errors)

    __hash__ = None  # type: ignore[assignment]

    def __call__(self, view: View) -> FloatArray:
        """Return the reading, SI, shape (R, size)."""
        return view.memory(self._sensor.part_name, _READING)

    def truth(self, view: View) -> FloatArray:
        """Return the value without errors, SI, shape (R, size)."""
        return np.ascontiguousarray(self._sensor(view), dtype=np.float64)

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that writes the reading."""
        return RowTerm(copy_vector, (SensorMemory(self._sensor.part_name, _READING),))

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the arrays of the sensor, the last reading, the biases and the values that are still to come."""
        size = self._sensor.size
        return {
            **self._sensor.memory(world),
            _READING: ArraySpec((size,)),
            _BIAS: ArraySpec((size,)),
            _LATE: ArraySpec((self._errors.delay + 1, size)),
        }

    def remember(self, view: View, name: str) -> None:
        """Measure: update the declared arrays for a new state."""
        self._sensor.remember(view, name)
        errors, state = self._errors, view.writable
        growth = errors.walk * math.sqrt(view.world.step_size)
        rule = np.array([errors.noise, errors.bias, growth, errors.resolution, errors.dropout, *self._sensor.limits])
        truth = self.truth(view)
        memory = (view.memory(name, array) for array in (_READING, _BIAS, _LATE))
        _measure(rule, self._salt, view.group.size, state.key, state.step, truth, *memory)
