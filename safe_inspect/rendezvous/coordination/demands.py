"""What the tube of a plan that was refused asks of the next plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from safe_inspect.rendezvous.control.design import TubeDesign
from safe_inspect.rendezvous.planner.query import ALLOWANCE, Limits
from safe_inspect.types import FloatArray

# Lengths are shares of the scenario's, which is 1 m in a room.
#: Clearance that a plan keeps beyond the chaser's radius before a tube is known.
FIRST_MARGIN = 0.08
#: What a plan is asked for less than the margin of its tube: the certificate's allowance, less a little for what
#: lies between the plan's samples.
_PLANNED_ALLOWANCE = 0.6 * ALLOWANCE
#: What the plans after a refusal are asked for more, and at most: the bound, and with it the tube, differs from
#: plan to plan by a few millimetres.
_GROWTH = 0.003
_MOST_GROWTH = 0.015
#: What is left beyond a tube that has exceeded a limit, of the keep-in box, and of the force as a share of its limit.
_SPARE_LENGTH = 0.002
_SPARE_FORCE = 0.005 / 0.30
#: How far a chaser that is held may drift from where a plan starts.
_DRIFT = 0.02
#: Least share of a limit that is left to a plan.
_LEAST_SHARE = 0.3


def first_margin(times: FloatArray, length: float = 1.0) -> FloatArray:
    """Return the margin that holds before a tube is known [m], shape (K,)."""
    return np.full(times.shape, FIRST_MARGIN * length)


@dataclass(frozen=True, eq=False)
class PlanDemands:
    """What a plan must keep so that its tube fits.

    Attributes:
        margin: Clearance to keep beyond the chaser's radius [m], of times since a plan's start [s].
        gain: Feedback gain of the tube that the margin belongs to, shape (2,) or (K, 2); None before a tube is known,
            and where the best is to be chosen anew.
        growth: What the margin is more than that of the last tube [m]; grows where a tube of a known gain is refused.
        keep_in: Half sizes of the box in which the tube of a plan stays within the keep-in box [m], shape (3,).
        speed: Largest speed of a plan whose tube stays within the speed limit [m/s].
        force: Largest force of a plan that leaves the tube its feedback [N].
        length: Length of the scenario [m].
    """

    margin: Callable[[FloatArray], FloatArray] = first_margin
    gain: FloatArray | None = None
    growth: float = 0.0
    keep_in: FloatArray = field(default_factory=lambda: np.full(3, np.inf))
    speed: float = np.inf
    force: float = np.inf
    length: float = 1.0

    @classmethod
    def first(cls, length: float) -> PlanDemands:
        """Return the demands before a tube is known, in a scenario of a length [m]."""
        return cls(margin=lambda times: first_margin(times, length), length=length)

    def limits(self, limits: Limits, position: FloatArray) -> Limits:
        """Return the limits for a plan; the box always holds the position that it starts from [m], shape (3,)."""
        box = limits.keep_in
        if box is not None:
            box = np.asarray(box)
            box = np.maximum(np.minimum(box, self.keep_in), np.minimum(np.abs(position) + _DRIFT * self.length, box))
        return replace(
            limits,
            keep_in=box,
            speed=min(limits.speed, max(self.speed, _LEAST_SHARE * limits.speed)),
            planned_force=min(limits.planned_force, max(self.force, _LEAST_SHARE * limits.planned_force)),
        )

    def later(self, elapsed: float) -> PlanDemands:
        """Return the demands on the rest of a plan after a time [s]; its gain is chosen anew."""
        margin = self.margin
        return replace(self, margin=lambda times: margin(np.asarray(times) + elapsed), gain=None)

    def after(self, design: TubeDesign) -> PlanDemands:
        """Return the demands on the next plan.

        The gain is kept, so that the next tube has the margin that the next plan is made for; it differs only as far as
        the bound of the reference does.

        Args:
            design: The tube of the last plan.
        """
        is_short = self.gain is not None and not design.accepted
        growth = min(self.growth + _GROWTH * self.length * is_short, _MOST_GROWTH * self.length)
        tube, own, gain = design.tube, design.limits, design.tube.gain
        keep_in, speed, force = self.keep_in, self.speed, self.force
        if own.keep_in is not None:
            inside = np.asarray(own.keep_in) - float(tube.position.max()) - _SPARE_LENGTH * self.length
            keep_in = np.where(design.state_reserve[:, 0] < 0.0, np.minimum(keep_in, inside), keep_in)
        if design.state_reserve[:, 1].min() < 0.0:
            speed = min(speed, own.speed - float(tube.velocity.max()))
        if design.force_reserve.min() < 0.0:
            force = min(force, own.force - float(tube.force.max()) - _SPARE_FORCE * own.force)
        allowance = _PLANNED_ALLOWANCE * self.length
        return PlanDemands(
            margin=lambda times: np.asarray(design.margin_at(times) + growth - allowance),
            gain=gain if gain.any() else None,
            growth=growth,
            keep_in=keep_in,
            speed=speed,
            force=force,
            length=self.length,
        )
