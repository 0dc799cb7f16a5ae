"""Bases of the glues."""

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
    """Base of all glues.

    Attributes:
        training_export_behavior: ``EXCLUDE`` leaves an observation out of what the policy sees. Glues that act add no
            observation of their own, so that for them both values mean the same.
    """

    kind: ClassVar[str] = "glue"

    training_export_behavior: Literal["INCLUDE", "EXCLUDE"] = "INCLUDE"

    @property
    def exported(self) -> bool:
        """Whether the policy sees what the glue observes, or gives what it acts on."""
        return True

    @abstractmethod
    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return the name of each element of the action or observation."""

    @abstractmethod
    def bounds(self, parts: Parts) -> Bounds:
        """Return the smallest and largest value of each element, two arrays of shape (size,)."""


class ObservationGlue(Glue):
    """A part of the observation: called with a `View`, it returns an array of shape (R, size)."""

    @property
    def exported(self) -> bool:
        """Whether the policy sees the observation."""
        return self.training_export_behavior == "INCLUDE"

    @abstractmethod
    def __call__(self, view: View) -> FloatArray:
        """Return the observation, shape (R, size)."""


class ActionGlue(Glue):
    """A part of the action: called with actions (R, size) and the parts, it returns what the controllers give.

    That is thrust [N], shape (R, 3), or the control of a vehicle that turns, thrust and moment [N m], shape (R, 6).
    """

    @abstractmethod
    def __call__(self, action: FloatArray, parts: Parts) -> FloatArray:
        """Return the thrust [N], shape (R, 3), or the control [N, N m], shape (R, 6); see `Controller`."""

    def choices(self, parts: Parts) -> tuple[int, ...]:
        """Return for each element of the action how many values it has, the indices 0, 1, ...; 0: it is a real number.

        All are real numbers by default.
        """
        return (0,) * len(self.names(parts))

    def leaves(self) -> tuple[ActionGlue, ...]:
        """Return the glues that command a controller: the wrapped ones of a wrapper, else the glue itself."""
        return (self,)


def sensor_of(parts: Parts, name: str) -> Sensor:
    """Return a part that is known to be a sensor."""
    part = parts[name]
    assert isinstance(part, Sensor), name
    return part


def controller_of(parts: Parts, name: str) -> Controller:
    """Return a part that is known to be a controller."""
    part = parts[name]
    assert isinstance(part, Controller), name
    return part
