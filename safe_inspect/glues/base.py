"""Base classes of the glues."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar, Literal

from safe_inspect.platforms.base import Controller, Part, Sensor
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators.view import View
from safe_inspect.types import FloatArray

Parts = Mapping[str, Part]
Bounds = tuple[FloatArray, FloatArray]


class Glue(Plugin):
    """Base class of all glues.

    Attributes:
        training_export_behavior: ``EXCLUDE`` removes an observation from the policy's input. Both values have the same
            effect for action glues, which observe nothing.
    """

    kind: ClassVar[str] = "glue"

    training_export_behavior: Literal["INCLUDE", "EXCLUDE"] = "INCLUDE"

    @property
    def exported(self) -> bool:
        """Whether the glue is part of the policy's input or output."""
        return True

    @abstractmethod
    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return the name of each element of the action or observation."""

    @abstractmethod
    def bounds(self, parts: Parts) -> Bounds:
        """Return the smallest and largest value of each element, two arrays of shape (size,)."""


class ObservationGlue(Glue):
    """A part of the observation. When called with a `View`, it returns an array of shape (R, size)."""

    @property
    def exported(self) -> bool:
        """Whether the observation is part of the policy's input."""
        return self.training_export_behavior == "INCLUDE"

    @abstractmethod
    def __call__(self, view: View) -> FloatArray:
        """Return the observation, shape (R, size)."""


class ActionGlue(Glue):
    """A part of the action. When called with actions (R, size) and the parts, it returns the controllers' output.

    The output is thrust [N], shape (R, 3); for a vehicle with attitude it is thrust [N] and moment [N m], shape (R, 6).
    """

    @abstractmethod
    def __call__(self, action: FloatArray, parts: Parts) -> FloatArray:
        """Return the thrust [N], shape (R, 3), or the control [N, N m], shape (R, 6); see `Controller`."""

    def choices(self, parts: Parts) -> tuple[int, ...]:
        """Return the number of values of each element of the action, or 0 for a real-valued element.

        An element with K values takes the indices 0, ..., K - 1. By default all elements are real-valued.
        """
        return (0,) * len(self.names(parts))

    def leaves(self) -> tuple[ActionGlue, ...]:
        """Return the glues that command a controller: the wrapped glues of a wrapper, otherwise the glue itself."""
        return (self,)


def sensor_of(parts: Parts, name: str) -> Sensor:
    """Return the sensor of that name; the caller must have checked that it is a sensor."""
    part = parts[name]
    assert isinstance(part, Sensor), name
    return part


def controller_of(parts: Parts, name: str) -> Controller:
    """Return the controller of that name; the caller must have checked that it is a controller."""
    part = parts[name]
    assert isinstance(part, Controller), name
    return part
