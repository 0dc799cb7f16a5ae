"""Trackers of a reference: the plugin kind, and a linear-quadratic regulator with clipped force."""

from __future__ import annotations

import enum
from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rendezvous.control.design import DesignRequest, TubeDesign, design_without_tube
from safe_inspect.rendezvous.control.gains import TrackingWeights, lqr_gain
from safe_inspect.rendezvous.control.tightening import TrackedReference
from safe_inspect.rendezvous.control.tube import Axis
from safe_inspect.types import FloatArray


class AxisStatus(enum.IntEnum):
    """How the force along an axis was found; larger is worse."""

    SOLVED = 0
    LONGER_HORIZON = 1  # solved with a longer horizon than the configured one
    SHIFTED = 2  # no solution: the rest of the last one is used
    REGULATOR = 3  # no solution to use: the clipped linear-quadratic regulator, without the guarantee of the tube


@dataclass(frozen=True, eq=False)
class TrackerOutput:
    """Force of one control step, along the axes of W.

    Attributes:
        force: Force to apply [N], shape (3,).
        nominal: Nominal error z_0 in position [m] and velocity [m/s], shape (3, 2).
        nominal_force: Nominal force v_0 [N], shape (3,).
        status: How the force along each axis was found, three `AxisStatus`.
    """

    force: FloatArray
    nominal: FloatArray
    nominal_force: FloatArray
    status: tuple[AxisStatus, ...]

    @property
    def feasible(self) -> bool:
        """Whether every axis has a solution: a new one or the rest of the last one."""
        return max(self.status) < AxisStatus.REGULATOR


class TrackerRun(Protocol):
    """Tracker of one approach."""

    def step(self, estimate: FloatArray, reference: TrackedReference, k: int) -> TrackerOutput:
        """Return the force at step k of the reference for a position and velocity in W, shape (6,)."""


class Tracker(Plugin):
    """Base class of trackers of a reference."""

    kind: ClassVar[str] = "tracker"

    @abstractmethod
    def design(self, request: DesignRequest) -> TubeDesign:
        """Return the tube for a plan, or a design that says why there is none."""

    @abstractmethod
    def __call__(self, design: TubeDesign) -> TrackerRun:
        """Return the tracker for one approach."""


class LQRTracker(Tracker):
    """Linear-quadratic regulator about the reference, with clipped force and without a tube."""

    def design(self, request: DesignRequest) -> TubeDesign:
        """Return a design whose tube has zero width."""
        return design_without_tube(request)

    def __call__(self, design: TubeDesign) -> LQRTrackerRun:
        """Return the tracker for one approach."""
        return LQRTrackerRun(design.axis, design.limits.force)


class LQRTrackerRun:
    """Linear-quadratic regulator of one approach: ``u = u_r + K (x_hat - r_hat)``, clipped."""

    def __init__(self, axis: Axis, force: float = 0.30) -> None:
        """Compute the gain.

        Args:
            axis: Dynamics of each axis.
            force: Maximum force along each axis [N].
        """
        self.axis, self.force = axis, force
        self.gain = lqr_gain(axis, TrackingWeights.of_force(force))

    def step(self, estimate: FloatArray, reference: TrackedReference, k: int) -> TrackerOutput:
        """Return the force at step k of the reference, for an estimate (position, velocity) in W, shape (6,)."""
        error = np.asarray(estimate).reshape(2, 3).T - np.stack((reference.position[k], reference.velocity[k]), axis=1)
        tide = None if reference.tide is None else reference.tide[k : k + 2]
        two = TrackedReference(reference.position[k : k + 2], reference.velocity[k : k + 2], tide)
        demand = two.feed_forward(self.axis)[0] + error @ self.gain
        force = np.clip(demand, -self.force, self.force)
        return TrackerOutput(force, error, np.zeros(3), (AxisStatus.SOLVED,) * 3)
