"""Trackers of a reference: the plugin kind, and what a tracker returns at each step of control."""

from __future__ import annotations

import enum
from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Protocol

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rendezvous.control.design import DesignRequest, TubeDesign
from safe_inspect.rendezvous.control.tightening import TrackedReference
from safe_inspect.types import FloatArray


class AxisStatus(enum.IntEnum):
    """How the force along an axis was found; the larger, the worse."""

    SOLVED = 0
    LONGER_HORIZON = 1  # solved with a longer horizon than asked for
    SHIFTED = 2  # no solution: the rest of the last one
    REGULATOR = 3  # no solution at all: the clipped linear-quadratic regulator, without the tube's guarantee


@dataclass(frozen=True, eq=False)
class TrackerOutput:
    """The force of one step of control, along the axes of W.

    Attributes:
        force: What to apply [N], shape (3,).
        nominal: Nominal error z_0 in position [m] and velocity [m/s], shape (3, 2).
        nominal_force: v_0 [N], shape (3,).
        status: How each axis was found, shape (3,), of `AxisStatus`.
    """

    force: FloatArray
    nominal: FloatArray
    nominal_force: FloatArray
    status: tuple[AxisStatus, ...]

    @property
    def feasible(self) -> bool:
        """Whether every axis has a solution, this one's or the rest of the last one."""
        return max(self.status) < AxisStatus.REGULATOR


class TrackerRun(Protocol):
    """The tracker of one approach."""

    def step(self, estimate: FloatArray, reference: TrackedReference, k: int) -> TrackerOutput:
        """Return the force at step k of the reference for position and velocity in W, shape (6,)."""


class Tracker(Plugin):
    """Base of trackers of a reference."""

    kind: ClassVar[str] = "tracker"

    @abstractmethod
    def design(self, request: DesignRequest) -> TubeDesign:
        """Return the tube of a plan, or why there is none."""

    @abstractmethod
    def __call__(self, design: TubeDesign) -> TrackerRun:
        """Return the tracker of one approach."""
