"""The requirements on the next plan, so that its tube is not refused like that of the last plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from safe_inspect.rendezvous.control.design import TubeDesign
from safe_inspect.rendezvous.planner.query import ALLOWANCE, Limits, PlanQuery
from safe_inspect.types import FloatArray

# Lengths are fractions of the scenario's length, which is 1 m by default.
#: Difference between the margin of a tube and the margin required from the plan: a part of the certificate's allowance.
#: The rest of the allowance is for the times between the plan's samples.
_PLANNED_ALLOWANCE = 0.6 * ALLOWANCE
#: Increase of the required margin after each refusal, and its largest value: the bound, and with it the tube, differs
#: from plan to plan by a few millimetres.
_GROWTH = 0.003
_MOST_GROWTH = 0.015
#: Reserve after a tube has exceeded a limit: of the keep-in box, and of the force as a fraction of its limit.
_SPARE_LENGTH = 0.002
_SPARE_FORCE = 0.005 / 0.30
#: Distance by which a chaser that holds its position may drift from the start of a plan.
_DRIFT = 0.02
#: Smallest fraction of a limit that a plan may use.
_LEAST_SHARE = 0.3


@dataclass(frozen=True, eq=False)
class PlanDemands:
    """The requirements on a plan, so that its tube is accepted.

    Attributes:
        margin: Function from times since a plan's start [s] to the clearance required beyond the chaser's radius [m].
        gain: Feedback gain of the tube to which the margin belongs, shape (2,) or (K, 2); None before a tube is known,
            or if the gain must be chosen again.
        growth: Difference between the margin and that of the last tube [m]; it grows after each refusal of a tube with
            a known gain.
        keep_in: Half sizes of the box in which the tube of a plan stays within the keep-in box [m], shape (3,).
        speed: Largest speed of a plan whose tube stays within the speed limit [m/s].
        force: Largest force of a plan that leaves the tube its feedback [N].
        length: Length of the scenario [m].
    """

    margin: Callable[[FloatArray], FloatArray] = PlanQuery.margin
    gain: FloatArray | None = None
    growth: float = 0.0
    keep_in: FloatArray = field(default_factory=lambda: np.full(3, np.inf))
    speed: float = np.inf
    force: float = np.inf
    length: float = 1.0

    @classmethod
    def first(cls, length: float) -> PlanDemands:
        """Return the requirements before a tube is known, in a scenario of a given length [m]."""
        return cls(margin=lambda times: length * PlanQuery.margin(times), length=length)

    def limits(self, limits: Limits, position: FloatArray) -> Limits:
        """Return the limits for a plan; the box always contains the position [m], shape (3,), from which it starts."""
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
        """Return the requirements on the rest of a plan after a time [s]; its gain is chosen again."""
        margin = self.margin
        return replace(self, margin=lambda times: margin(np.asarray(times) + elapsed), gain=None)

    def after(self, design: TubeDesign) -> PlanDemands:
        """Return the requirements on the next plan.

        The gain stays the same, so that the margin of the next tube differs from the one in these requirements only as
        far as the bound of the reference does.

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
