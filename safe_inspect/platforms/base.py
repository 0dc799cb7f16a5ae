"""Base classes of platforms and their parts."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np
from pydantic import Field, field_validator

from safe_inspect.platforms.sensor_errors import SensorErrors
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators import Simulator, View, World
from safe_inspect.simulators.row_plugin import RowPlugin, batch_call
from safe_inspect.types import ArraySpec, FloatArray
from safe_inspect.units import PositiveMass, to_si


class Platform(Plugin):
    """A deputy spacecraft.

    Class attributes:
        turns: Whether it has an attitude, so that its controls and its camera turn with it.
        short_name: A name for ``platform`` in configurations, in addition to the class name.

    Attributes:
        mass: Mass [kg].
    """

    kind: ClassVar[str] = "platform"
    turns: ClassVar[bool] = False
    short_name: ClassVar[str] = ""

    mass: PositiveMass = 12.0

    @abstractmethod
    def __call__(self, parts: tuple[Part, ...]) -> tuple[str, ...]:
        """Return the names of the parts, which must be distinct.

        Raises:
            ValueError: The parts do not match the platform.
        """


class Part(Plugin):
    """A part of a platform.

    Attributes:
        name: Name of the part on its platform; default: the registered name of its class.
    """

    kind: ClassVar[str] = "part"

    name: str = Field(default="", max_length=100)

    @property
    def part_name(self) -> str:
        """The name of the part on its platform."""
        return self.name or self.registered_name


class Controller(Part):
    """A part that turns commanded values into thrust, or into the whole control of a vehicle that turns.

    Calling it with values of shape (R, size) returns its share of the thrust [N], shape (R, 3), or of the control,
    shape (R, control_size): thrusts, then moments [N m]. The shares of all controllers are added. The thrust is in
    Hill's frame unless the vehicle's dynamics use another frame.
    """

    @property
    def control_size(self) -> int:
        """Number of elements of the returned control; 3 by default, a thrust."""
        return 3

    @property
    @abstractmethod
    def limits(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest value of each element [SI], two arrays of shape (size,)."""

    @property
    def size(self) -> int:
        """Number of commanded values."""
        return len(self.limits[0])

    @abstractmethod
    def __call__(self, values: FloatArray) -> FloatArray:
        """Return the share of the thrust [N], shape (R, 3), or of the control, shape (R, control_size)."""


class Sensor(Part, RowPlugin):
    """A part that reads values from a state: called with a `View`, it returns an array of shape (R, size).

    It defines ``__call__``, or `row`, a row kernel that writes the reading into its last argument, shape (size,).

    Class attributes:
        elements: Name of each element of the reading; a sensor whose elements depend on its configuration defines
            `element_names` instead.
        symbol: SI unit of the reading, empty for a pure number.
        bounds: Smallest and largest possible value, SI.

    Attributes:
        errors: Errors of the readings; None: the readings are exact. Rewards, done functions and safety filters must
            not name a sensor with errors.
    """

    elements: ClassVar[tuple[str, ...]]
    symbol: ClassVar[str] = ""
    bounds: ClassVar[tuple[float, float]] = (-np.inf, np.inf)

    errors: SensorErrors | None = None

    @field_validator("errors", mode="before")
    @classmethod
    def _in_own_unit(cls, value: Any) -> Any:
        """Convert the errors that are given with a unit to the unit of the reading."""
        if not isinstance(value, Mapping):
            return value
        converted, problems = dict(value), []
        for key in ("noise", "bias", "resolution"):
            try:
                if key in value:
                    converted[key] = to_si(value[key], cls.symbol)
            except ValueError as error:
                problems.append(f"{key}: {error}")
        if problems:
            raise ValueError("; ".join(problems))
        return converted

    @property
    def element_names(self) -> tuple[str, ...]:
        """Name of each element for the sensor's configuration; default: `elements`."""
        return self.elements

    @property
    def size(self) -> int:
        """Number of elements of a reading."""
        return len(self.element_names)

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest possible value for the sensor's configuration, SI; default: `bounds`."""
        return self.bounds

    @batch_call
    def __call__(self, view: View) -> FloatArray:
        """Return the reading, SI, shape (R, size)."""
        return self.call_rows(view)

    def row_result(self) -> tuple[type[Any], int]:
        """Return the type float and the size of the reading."""
        return np.float64, self.size

    def in_task(self, simulator: Simulator, horizon: int) -> Self:
        """Return the sensor with unset fields set from the task; the default returns the sensor unchanged.

        Args:
            simulator: The simulator, whose `compose` returns dynamics and components.
            horizon: Number of steps after which the episode ends.

        Raises:
            ValueError: A field that is set contradicts the task.
        """
        return self

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the arrays in which the sensor stores data, each with its shape for one agent. None by default."""
        return {}

    def remember(self, view: View, name: str) -> None:
        """Update the declared arrays, ``view.memory(name, array)``, in place; called once for every new state.

        The arrays must not be written anywhere else.
        """
