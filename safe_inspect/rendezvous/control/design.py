"""Design of the tube that tracks a plan, or of a refusal that names remedies."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from safe_inspect.rendezvous.bound.conformal import Bound
from safe_inspect.rendezvous.control.axis import Axis
from safe_inspect.rendezvous.control.gains import (
    FREQUENCIES,
    best_tube,
    candidate_gains,
    clearance_margin,
    stiffening_gains,
)
from safe_inspect.rendezvous.control.tightening import TightenedLimits, TrackedReference, TrackingLimits
from safe_inspect.rendezvous.control.tube import AxisBound, Tube, no_tube, truth_tube
from safe_inspect.rendezvous.planner.query import Plan
from safe_inspect.types import FloatArray

#: Change of position [m] and velocity [m/s] per step due to other causes, such as the sampling of the reference.
_PROCESS = np.array([5e-6, 5e-6])


@dataclass(frozen=True)
class DesignOptions:
    """Options for the design of a tube.

    Attributes:
        process_force: Largest force that is not commanded, along each axis [N].
        reserve: Force that should remain for the nominal feedback [N]: 0.03 N stop 1 cm/s within a horizon of 4 s. With
            less, a plan is still accepted, but correcting nominal errors may need longer horizons.
        gains: Gains K to choose from, shape (2,) or (K, 2) each; None for a grid of natural frequencies and dampings.
        length: Length of the scenario [m].
        frequencies: Natural frequencies of that grid [rad/s].
    """

    process_force: float = 3e-3
    reserve: float = 0.03
    gains: tuple[FloatArray, ...] | None = None
    length: float = 1.0
    frequencies: tuple[float, ...] = FREQUENCIES


@dataclass(frozen=True, eq=False)
class TubeDesign:
    """A tube that tracks a plan.

    Attributes:
        axis: Dynamics of each axis.
        limits: Limits that tracking must respect.
        tube: The tube.
        times: Times of the plan [s], shape (K,).
        force_reserve: Force that remains for the nominal feedback on the worst axis [N], shape (K,).
        state_reserve: Smallest remaining distance to the keep-in box [m] and to the speed limit [m/s] along each axis,
            shape (3, 2).
        margin: Clearance m(t) that the plan must have beyond the chaser's radius [m], shape (K,).
        refusal: Why the plan cannot be tracked, and what would help; empty if it can be tracked.
    """

    axis: Axis
    limits: TrackingLimits
    tube: Tube
    times: FloatArray
    force_reserve: FloatArray
    state_reserve: FloatArray
    margin: FloatArray
    refusal: str = field(default="")

    @property
    def accepted(self) -> bool:
        """Whether the plan can be tracked, provided that it has the margin."""
        return not self.refusal

    def margin_at(self, since: FloatArray) -> FloatArray:
        """Return the clearance margin at times since the plan's start [s], shape (k,), for a planner's query.

        Between two steps it is the larger of their margins; after the last step it is that of the last step.
        """
        place = np.clip(np.asarray(since) / self.axis.step, 0.0, len(self.margin) - 1.0)
        nearest = np.round(place)
        place = np.where(np.abs(place - nearest) < 1e-6, nearest, place)
        low, high = np.floor(place).astype(int), np.ceil(place).astype(int)
        return np.asarray(np.maximum(self.margin[low], self.margin[high]))


def axis_bound(axis: Axis, bound: Bound, options: DesignOptions | None = None) -> AxisBound:
    """Return the disturbance of an axis: the bound of the reference and the force that is not commanded."""
    options = options or DesignOptions()
    process = np.abs(axis.B) * options.process_force + _PROCESS
    return AxisBound(bound.position, bound.velocity, bound.force, process)


def design_tube(
    plan: Plan,
    bound: Bound,
    axis: Axis,
    limits: TrackingLimits | None = None,
    options: DesignOptions | None = None,
) -> TubeDesign:
    """Return the tube with the smallest clearance margin that leaves force for feedback at all times.

    The available force is ``F_max - |F_plan(t)| - b_F(t)`` of the worst axis: the feed-forward of the estimated
    reference may differ from that of the plan by b_F.

    Args:
        plan: A plan that is sampled at the control period.
        bound: The error bound of its reference, at the same times.
        axis: Dynamics of each axis.
        limits: Limits that tracking must respect.
        options: Options of the design.

    Raises:
        ValueError: The samples of plan and bound differ in number, or are not spaced by the control period.
    """
    limits, options = limits or TrackingLimits(), options or DesignOptions()
    if len(plan.times) < 2 or plan.times.shape != bound.times.shape:
        raise ValueError(
            f"tube: the plan has {len(plan.times)} samples but its bound has {len(bound.times)}; both must have the "
            "same number, at least two"
        )
    if not np.allclose(np.diff(plan.times), axis.step, rtol=1e-6):
        raise ValueError(f"tube: the plan must be sampled every {axis.step:g} s, the control period")
    disturbance = axis_bound(axis, bound, options)
    reference = TrackedReference(plan.position, plan.velocity, plan.tide)
    planned = np.abs(reference.feed_forward(axis)).max(axis=1)
    tube, reserve = best_tube(
        axis,
        disturbance,
        limits.force - planned - bound.force,
        options.gains or candidate_gains(axis, options.frequencies),
        options.reserve,
        stiffen=options.gains is None,
    )
    room = TightenedLimits(axis, reference, tube, limits).reserve()[:, :2]
    refusal = _refusal(plan, tube, reserve, room)
    return TubeDesign(axis, limits, tube, plan.times, reserve, room, clearance_margin(tube, options.length), refusal)


def _refusal(plan: Plan, tube: Tube, reserve: FloatArray, room: FloatArray) -> str:
    """Return why the plan cannot be tracked; empty if it can."""
    worst = int(reserve.argmin())
    lacking: Iterable[str] = ()
    if reserve[worst] < 0.0:
        lacking = (
            f"feedback needs {tube.force[worst]:.3f} N at {plan.times[worst] - plan.t_start:.1f} s, "
            f"{-reserve[worst]:.3f} N more than the plan leaves: update more often (T_u), allow softer gains (K), "
            "estimate better (Sigma), or plan a longer approach",
        )
    elif room[:, 0].min() < 0.0:
        lacking = (
            f"the tube leaves the keep-in box by {-room[:, 0].min():.3f} m: plan in a box that is smaller by this",
        )
    elif room[:, 1].min() < 0.0:
        lacking = (
            f"the tube exceeds the speed limit by {-room[:, 1].min():.3f} m/s: plan with a lower speed, or allow "
            "tracking a higher one",
        )
    return "".join(f"tube: {item}" for item in lacking)


@dataclass(frozen=True, eq=False)
class DesignRequest:
    """Request for the design of a tracker for a plan.

    Attributes:
        plan: The plan, sampled at the control steps.
        bound: Error bound of its reference.
        clearance: Distance of the chaser's sphere to the target along the plan [m], shape (K,).
        axis: Dynamics of the chaser along one axis.
        limits: Limits that tracking must respect.
        force_error: Largest error of the force of the actuators [N].
        length: Length of the scenario [m].
        gain: Gain of the tube that the plan was made for, shape (2,) or (K, 2); it is used again if the force allows
            it. None to choose the best gain.
    """

    plan: Plan
    bound: Bound
    clearance: FloatArray
    axis: Axis
    limits: TrackingLimits
    force_error: float
    length: float = 1.0
    gain: FloatArray | None = None


def design_by_clearance(request: DesignRequest, frequencies: tuple[float, ...] = FREQUENCIES) -> TubeDesign:
    """Return the tube that leaves the most clearance along a plan, or a design that says why there is none.

    The gain that the plan was made for is used again if force, keep-in box and speed limit allow it: its margin then
    equals that of the plan except for the change of the bound, so that plan and tube agree after a few iterations.
    Otherwise the tube that is narrowest over all times is tried first. If it is wider than the plan's clearance, the
    tubes of all gains that the force allows are tried, and those of gains that stiffen from the best one.

    Args:
        request: The plan and the limits.
        frequencies: Natural frequencies of the gains that are tried [rad/s].
    """
    plan, axis = request.plan, request.axis
    reserve = 0.03 * (request.limits.force / 0.30)
    options = DesignOptions(request.force_error, reserve=reserve, length=request.length, frequencies=frequencies)
    if request.gain is not None:
        gain = _resampled(request.gain, len(plan.times))
        kept = design_tube(plan, request.bound, axis, request.limits, replace(options, gains=(gain,), reserve=0.0))
        if kept.accepted:
            return kept
    first = design_tube(plan, request.bound, axis, request.limits, options)
    if not first.accepted or (first.margin <= request.clearance).all():
        return first
    disturbance = axis_bound(axis, request.bound, options)
    available = first.force_reserve + first.tube.force

    def spare(tube: Tube) -> float:
        if (tube.force > available).any():
            return -np.inf
        return float((request.clearance - clearance_margin(tube, request.length)).min())

    constant = [truth_tube(axis, gain, disturbance) for gain in candidate_gains(axis, frequencies)]
    best = max([*constant, first.tube], key=spare)
    if best.gain.ndim == 1:
        stiffer = [truth_tube(axis, gain, disturbance) for gain in stiffening_gains(axis, best.gain, len(plan.times))]
        best = max([best, *stiffer], key=spare)
    options = replace(options, gains=(best.gain,), reserve=0.0)
    return design_tube(plan, request.bound, axis, request.limits, options)


def _resampled(gain: FloatArray, steps: int) -> FloatArray:
    """Return a gain interpolated to another number of steps, shape (2,) or (steps, 2)."""
    if gain.ndim == 1 or len(gain) == steps:
        return gain
    old, new = np.linspace(0.0, 1.0, len(gain)), np.linspace(0.0, 1.0, steps)
    return np.stack([np.interp(new, old, column) for column in gain.T], axis=1)


def design_without_tube(request: DesignRequest) -> TubeDesign:
    """Return a design whose tube has zero width, for trackers without a tube."""
    plan, axis, limits = request.plan, request.axis, request.limits
    tube = no_tube(len(plan.times))
    reference = TrackedReference(plan.position, plan.velocity, plan.tide)
    reserve = TightenedLimits(axis, reference, tube, limits).reserve()
    available = limits.force - np.abs(plan.force).max(axis=1)
    margin = clearance_margin(tube, request.length)
    return TubeDesign(axis, limits, tube, plan.times, available, reserve[:, :2], margin)
