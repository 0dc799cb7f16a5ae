"""Trackers of a reference: the plugin kind, feedback in a tube, and a linear-quadratic regulator without one."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from pydantic import model_validator

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rendezvous.control.design import (
    DesignRequest,
    TubeDesign,
    design_by_clearance,
    design_without_tube,
    lqr_gain,
)
from safe_inspect.rendezvous.control.tube import Axis, TrackedReference, Tube, no_tube
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveAngularRate

#: Number of natural frequencies that are tried between the smallest and the largest.
_FREQUENCIES = 20


@dataclass(frozen=True, eq=False)
class TrackerOutput:
    """Force of one control step, along the axes of W.

    Attributes:
        force: Force to apply [N], shape (3,).
        outside: Part of the position error that is outside of the tube [m], shape (3,); 0 within it. Above 1 % of the
            scenario's length, for which the clearance of a plan allows, the approach is planned again.
    """

    force: FloatArray
    outside: FloatArray


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


class TubeTracker(Tracker):
    """Linear feedback with the gain, of those that the force allows, whose tube leaves the most clearance.

    The tube holds for all errors of the reference within its bound and all disturbances of the thrust, as that of tube
    model predictive control does. There is no programme for a nominal trajectory, because a plan starts where the
    chaser is: the nominal error of least cost is 0 as long as the error is within the tube, and if it leaves the tube,
    the approach is planned again, which also keeps clear of the target.

    Attributes:
        least_frequency: Smallest natural frequency of the feedback gains that are tried [rad/s].
        largest_frequency: Largest natural frequency of the feedback gains that are tried [rad/s].

    Source:
        Limon, Alvarado, Alamo and Camacho, "Robust tube-based MPC for tracking of constrained linear systems with
        additive disturbances", 2010, for the tube.
    """

    least_frequency: PositiveAngularRate = 0.15  # type: ignore[valid-type]
    largest_frequency: PositiveAngularRate = 1.0  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _is_range(self) -> TubeTracker:
        if self.least_frequency > self.largest_frequency:
            raise ValueError(
                f"least_frequency ({self.least_frequency:g} rad/s) is more than largest_frequency "
                f"({self.largest_frequency:g} rad/s)"
            )
        return self

    def design(self, request: DesignRequest) -> TubeDesign:
        """Return the tube for a plan, or a design that says why there is none."""
        frequencies = np.geomspace(self.least_frequency, self.largest_frequency, _FREQUENCIES)
        return design_by_clearance(request, tuple(frequencies))

    def __call__(self, design: TubeDesign) -> LinearFeedback:
        """Return the tracker for one approach."""
        return LinearFeedback(design.axis, design.tube, design.limits.force)


class LQRTracker(Tracker):
    """Linear-quadratic regulator about the reference, with clipped force and without a tube."""

    def design(self, request: DesignRequest) -> TubeDesign:
        """Return a design whose tube has zero width."""
        return design_without_tube(request)

    def __call__(self, design: TubeDesign) -> LinearFeedback:
        """Return the tracker for one approach."""
        return LinearFeedback.of_lqr(design.axis, design.limits.force)


class LinearFeedback:
    """Control ``u = u_r + K (x_hat - r_hat)`` along each axis, clipped to the maximum force."""

    def __init__(self, axis: Axis, tube: Tube, force: float = 0.30) -> None:
        """Store the gain and the tube.

        Args:
            axis: Dynamics of each axis.
            tube: The tube, which contains the gain K.
            force: Maximum force along each axis [N].
        """
        self.axis, self.tube, self.force = axis, tube, force

    @classmethod
    def of_lqr(cls, axis: Axis, force: float = 0.30) -> LinearFeedback:
        """Return the feedback of the linear-quadratic regulator, without a tube."""
        return cls(axis, no_tube(1, lqr_gain(axis, force)), force)

    def step(self, estimate: FloatArray, reference: TrackedReference, k: int) -> TrackerOutput:
        """Return the force at step k of the reference, for an estimate (position, velocity) in W, shape (6,)."""
        error = np.asarray(estimate).reshape(2, 3).T - np.stack((reference.position[k], reference.velocity[k]), axis=1)
        demand = reference.feed_forward(self.axis)[k] + error @ self.tube.gain_at(k)
        width = self.tube.position[min(k, len(self.tube.position) - 1)]
        outside = error[:, 0] - np.clip(error[:, 0], -width, width)
        return TrackerOutput(np.clip(demand, -self.force, self.force), outside)
