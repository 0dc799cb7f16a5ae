"""Trackers of a reference."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from safe_inspect.rendezvous.plugins.base import Tracker
from safe_inspect.units import PositiveAngularRate

if TYPE_CHECKING:
    from safe_inspect.rendezvous.control.design import TubeDesign
    from safe_inspect.rendezvous.control.lqr import LQRTracker
    from safe_inspect.rendezvous.control.mpc import TubeMPC
    from safe_inspect.rendezvous.tracking import DesignRequest


class TubeMPCTracker(Tracker):
    """Tube model predictive control; of the gains that the force allows it takes the one that leaves most clearance.

    Attributes:
        tube: ``truth`` bounds the distance to the true reference, ``none`` is plain model predictive control.
        horizon: Steps of the programme.
        least_frequency: Least natural frequency of the feedback gains that are tried [rad/s].
        largest_frequency: Largest one [rad/s].
    """

    tube: Literal["truth", "none"] = "truth"
    horizon: int = Field(default=20, ge=2)
    least_frequency: PositiveAngularRate = 0.15  # type: ignore[valid-type]
    largest_frequency: PositiveAngularRate = 1.0  # type: ignore[valid-type]

    def design(self, request: DesignRequest) -> TubeDesign:
        """Return the tube of a plan, or why there is none."""
        from safe_inspect.rendezvous.tracking import design_by_clearance, design_without_tube

        if self.tube == "none":
            return design_without_tube(request)
        frequencies = (self.least_frequency, self.largest_frequency)
        return design_by_clearance(replace(request, frequencies=frequencies))

    def __call__(self, design: TubeDesign) -> TubeMPC:
        """Return the tracker of one approach."""
        from safe_inspect.rendezvous.control.mpc import InitialState, TubeMPC

        if self.tube == "none":
            return TubeMPC(design.axis, design.tube, design.limits, self.horizon, initial=InitialState.MEASURED)
        return design.tracker(self.horizon)


class LinearQuadraticTracker(Tracker, name="LQRTracker"):
    """The linear-quadratic regulator about the reference, with clipped force and without a tube."""

    def design(self, request: DesignRequest) -> TubeDesign:
        """Return a tube of no width."""
        from safe_inspect.rendezvous.tracking import design_without_tube

        return design_without_tube(request)

    def __call__(self, design: TubeDesign) -> LQRTracker:
        """Return the tracker of one approach."""
        from safe_inspect.rendezvous.control.lqr import LQRTracker

        return LQRTracker(design.axis, design.limits.force)
