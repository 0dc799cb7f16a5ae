"""Feedback gains, and the design of the tube that tracks a plan, or of a refusal that names remedies."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from safe_inspect.dynamics.regulator import regulator
from safe_inspect.rendezvous.control.bound import Bound
from safe_inspect.rendezvous.control.tube import (
    Axis,
    AxisBound,
    TrackedReference,
    TrackingLimits,
    Tube,
    no_tube,
    remaining,
    truth_tube,
)
from safe_inspect.rendezvous.planner.query import Plan
from safe_inspect.types import FloatArray

# Clearance beyond the tube, as a fraction of the scenario's length: half for the certificate between samples, half for
# an error that has left the tube.
RESERVE_CLEARANCE = 0.02
#: Natural frequencies that are tried by default [rad/s].
FREQUENCIES = tuple(np.geomspace(0.15, 1.0, 20).tolist())
#: Damping ratios that are tried with each of them.
_DAMPINGS = (0.7, 0.8, 0.9)


def tracking_weights(force: float = 0.30) -> tuple[float, float, float]:
    """Return the weights of position [1/m^2], velocity [s^2/m^2] and force [1/N^2] in a quadratic cost.

    By Bryson's rule they are one over the squares of acceptable values: 5 cm, 3 cm/s and a third of the largest force.

    Args:
        force: Largest force of the actuators [N].
    """
    return 1.0 / 0.05**2, 1.0 / 0.03**2, 1.0 / (0.1 * (force / 0.30)) ** 2


def natural_gain(axis: Axis, frequency: FloatArray | float, damping: float) -> FloatArray:
    """Return ``K = -m [w^2, 2 zeta w]`` (N/m, N s/m), shape (..., 2).

    Args:
        axis: The axis.
        frequency: Natural frequency w [rad/s], shape (...).
        damping: Damping ratio zeta.
    """
    w = np.asarray(frequency, dtype=float)
    return -axis.mass * np.stack((w * w, 2.0 * damping * w), axis=-1)


def lqr_gain(axis: Axis, force: float = 0.30) -> FloatArray:
    """Return the gain ``u = K x`` of the discrete linear-quadratic regulator, shape (2,), for a largest force [N]."""
    *state, weight = tracking_weights(force)
    return np.asarray(-regulator(axis.A, axis.B[:, None], np.diag(state), np.array([[weight]]))[0])


def clearance_margin(tube: Tube, length: float = 1.0) -> FloatArray:
    """Return the clearance ``m = |(h_x, h_y, h_z)| + 2 cm`` that a plan needs beyond the chaser's radius.

    A distance changes at most by as much as the position, and the half width h is the same on all three axes, which
    gives sqrt(3) h.

    Args:
        tube: The tube.
        length: Length of the scenario [m]; the 2 cm are for 1 m.

    Returns:
        The clearance at each step [m], shape (K,).
    """
    return np.asarray(np.sqrt(3.0) * tube.clearance + RESERVE_CLEARANCE * length)


def candidate_gains(axis: Axis, frequencies: Iterable[float] = FREQUENCIES) -> list[FloatArray]:
    """Return the gains of natural frequencies [rad/s] and of three dampings, shape (2,) each."""
    return [natural_gain(axis, frequency, damping) for frequency in frequencies for damping in _DAMPINGS]


def _stiffening_gains(axis: Axis, gain: FloatArray, steps: int) -> Iterator[FloatArray]:
    """Yield gains, shape (K, 2), that start near a constant one and whose natural frequency increases linearly.

    The bound of the reference shrinks towards the end of an approach. The same force therefore allows more feedback,
    and a narrower tube, when the chaser is closest to the target.

    Args:
        axis: The axis.
        gain: A constant gain of `natural_gain`, shape (2,).
        steps: Number of steps K.
    """
    frequency = float(np.sqrt(-gain[0] / axis.mass))
    damping = float(-gain[1] / (2.0 * axis.mass * frequency))
    for first in (0.92, 1.0, 1.08):
        for last in (1.2, 1.4, 1.6, 1.8, 2.0, 2.3):
            yield natural_gain(axis, frequency * np.linspace(first, last, steps), damping)


#: Change of position [m] and velocity [m/s] per step due to other causes, such as the sampling of the reference.
_PROCESS = np.array([5e-6, 5e-6])
#: Force that should remain for errors outside of the tube, of a limit of 0.3 N: 0.03 N stop 1 cm/s within 4 s. With
#: less, a plan is still accepted.
_RESERVE = 0.03


@dataclass(frozen=True, eq=False)
class TubeDesign:
    """A tube that tracks a plan.

    Attributes:
        axis: Dynamics of each axis.
        limits: Limits that tracking must respect.
        tube: The tube.
        times: Times of the plan [s], shape (K,).
        force_reserve: Force that remains on the worst axis [N], shape (K,).
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
    refusal: str = ""

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


@dataclass(frozen=True, eq=False)
class DesignRequest:
    """Request for the design of a tracker for a plan.

    Attributes:
        plan: The plan, sampled at the control steps.
        bound: Error bound of its reference.
        clearance: Distance of the chaser's sphere to the target along the plan [m], shape (K,).
        axis: Dynamics of the chaser along one axis.
        limits: Limits that tracking must respect.
        force_error: Largest force that is not commanded, such as the error of the actuators, along each axis [N].
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

    @property
    def reference(self) -> TrackedReference:
        """The path of the plan."""
        return TrackedReference(self.plan.position, self.plan.velocity, self.plan.tide)

    @cached_property
    def disturbance(self) -> AxisBound:
        """The disturbance of an axis: the bound of the reference and the force that is not commanded.

        While a plan is computed or waited for, the chaser holds the position where the plan starts. The force that is
        not commanded moves it about that position, both when it is observed and when the approach starts.
        """
        process, none = np.abs(self.axis.B) * self.force_error + _PROCESS, np.zeros(1)
        held = truth_tube(self.axis, lqr_gain(self.axis, self.limits.force), AxisBound(none, none, none, process))
        start = 2.0 * np.array((held.position[-1], held.velocity[-1]))
        return AxisBound(self.bound.position, self.bound.velocity, self.bound.force, process, start)


def _design(request: DesignRequest, tube: Tube, force_reserve: FloatArray) -> TubeDesign:
    """Return the design with a tube, without a check."""
    axis, limits = request.axis, request.limits
    room = remaining(axis, request.reference, tube, limits)[:, :2]
    margin = clearance_margin(tube, request.length)
    return TubeDesign(axis, limits, tube, request.plan.times, force_reserve, room, margin)


def design_without_tube(request: DesignRequest) -> TubeDesign:
    """Return a design whose tube has zero width, for trackers without a tube."""
    plan = request.plan
    return _design(request, no_tube(len(plan.times)), request.limits.force - np.abs(plan.force).max(axis=1))


def design_tube(
    request: DesignRequest,
    gains: Iterable[FloatArray] | None = None,
    reserve: float = 0.0,
    frequencies: tuple[float, ...] = FREQUENCIES,
) -> TubeDesign:
    """Return the design with the narrowest tube whose feedback leaves the reserve of the available force at all times.

    The available force is ``F_max - |F_plan(t)| - b_F(t)`` of the worst axis: the feed-forward of the estimated
    reference may differ from that of the plan by b_F. The narrowest tube has the smallest sum of the largest and the
    last width, because clearance is needed both along the approach and at its end. If no tube leaves the reserve, the
    design has the tube that leaves the most; it is refused if that is negative.

    Args:
        request: The plan and the limits.
        gains: Gains K to choose from, shape (2,) or (K, 2) each; None for `candidate_gains` and the
            `_stiffening_gains` of the best of them.
        reserve: Force that should remain [N].
        frequencies: Natural frequencies of the candidates [rad/s].
    """
    axis, disturbance = request.axis, request.disturbance
    planned = np.abs(request.reference.feed_forward(axis)).max(axis=1)
    available = request.limits.force - planned - request.bound.force

    def tubes(tried: Iterable[FloatArray]) -> list[Tube]:
        return [truth_tube(axis, gain, disturbance) for gain in tried]

    def rank(tube: Tube) -> tuple[bool, float]:
        least = float((available - tube.force).min())
        enough = least >= reserve
        return not enough, float(tube.clearance.max() + tube.clearance[-1]) if enough else -least

    best = min(tubes(gains or candidate_gains(axis, frequencies)), key=rank)
    if gains is None and not rank(best)[0]:
        best = min([best, *tubes(_stiffening_gains(axis, best.gain, len(available)))], key=rank)
    design = _design(request, best, available - best.force)
    return replace(design, refusal=_refusal(request.plan, design))


def _refusal(plan: Plan, design: TubeDesign) -> str:
    """Return why the plan cannot be tracked; empty if it can."""
    tube, reserve = design.tube, design.force_reserve
    worst = int(reserve.argmin())
    if reserve[worst] < 0.0:
        return (
            f"tube: feedback needs {tube.force[worst]:.3f} N at {plan.times[worst] - plan.t_start:.1f} s, "
            f"{-reserve[worst]:.3f} N more than the plan leaves: lower mission.update_ticks, "
            "tracker.config.least_frequency or chaser.actuator.force_noise, estimate better, or give longer "
            "mission.durations"
        )
    inside, slower = -design.state_reserve.min(axis=0)
    if inside > 0.0:
        return f"tube: the tube leaves the keep-in box by {inside:.3f} m: plan in a box that is smaller by this"
    if slower > 0.0:
        return (
            f"tube: the tube exceeds the speed limit by {slower:.3f} m/s: plan with a lower speed, or allow tracking a "
            "higher one"
        )
    return ""


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
    axis, steps = request.axis, len(request.plan.times)
    if request.gain is not None:
        kept = design_tube(request, (_resampled(request.gain, steps),))
        if kept.accepted:
            return kept
    first = design_tube(request, None, _RESERVE * (request.limits.force / 0.30), frequencies)
    if not first.accepted or (first.margin <= request.clearance).all():
        return first
    available = first.force_reserve + first.tube.force

    def spare(tube: Tube) -> float:
        if (tube.force > available).any():
            return -np.inf
        return float((request.clearance - clearance_margin(tube, request.length)).min())

    def best_of(gains: Iterable[FloatArray], other: Tube) -> Tube:
        return max([*(truth_tube(axis, gain, request.disturbance) for gain in gains), other], key=spare)

    best = best_of(candidate_gains(axis, frequencies), first.tube)
    if best.gain.ndim == 1:
        best = best_of(_stiffening_gains(axis, best.gain, steps), best)
    return design_tube(request, (best.gain,))


def _resampled(gain: FloatArray, steps: int) -> FloatArray:
    """Return a gain interpolated to another number of steps, shape (2,) or (steps, 2)."""
    if gain.ndim == 1 or len(gain) == steps:
        return gain
    old, new = np.linspace(0.0, 1.0, len(gain)), np.linspace(0.0, 1.0, steps)
    return np.stack([np.interp(new, old, column) for column in gain.T], axis=1)
