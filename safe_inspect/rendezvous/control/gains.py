"""Feedback gains from a natural frequency and a damping or from the linear-quadratic regulator, and the best tube."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from safe_inspect.dynamics.regulator import regulator
from safe_inspect.rendezvous.control.tube import Axis, AxisBound, Tube, truth_tube
from safe_inspect.types import FloatArray

# Clearance beyond the tube, as a fraction of the scenario's length: half for the certificate between samples, half for
# an error that has left the tube.
RESERVE_CLEARANCE = 0.02
#: Natural frequencies that are tried by default [rad/s].
FREQUENCIES = tuple(np.geomspace(0.15, 1.0, 20).tolist())
#: Damping ratios that are tried with each of them.
_DAMPINGS = (0.7, 0.8, 0.9)


@dataclass(frozen=True)
class TrackingWeights:
    """Weights of a quadratic cost: by Bryson's rule, one over the squares of acceptable values.

    Attributes:
        position: Weight of the position [1/m^2].
        velocity: Weight of the velocity [s^2/m^2].
        force: Weight of the force [1/N^2].
    """

    position: float = 1.0 / 0.05**2
    velocity: float = 1.0 / 0.03**2
    force: float = 1.0 / 0.1**2

    @classmethod
    def of_force(cls, largest: float) -> TrackingWeights:
        """Return the weights for actuators with a maximum force [N], a third of which is acceptable."""
        return cls(force=1.0 / (0.1 * (largest / 0.30)) ** 2)


def natural_gain(axis: Axis, frequency: FloatArray | float, damping: float) -> FloatArray:
    """Return ``K = -m [w^2, 2 zeta w]`` (N/m, N s/m), shape (..., 2).

    Args:
        axis: The axis.
        frequency: Natural frequency w [rad/s], shape (...).
        damping: Damping ratio zeta.
    """
    w = np.asarray(frequency, dtype=float)
    return -axis.mass * np.stack((w * w, 2.0 * damping * w), axis=-1)


def lqr_gain(axis: Axis, weights: TrackingWeights | None = None) -> FloatArray:
    """Return the gain of the discrete linear-quadratic regulator, ``u = K x``, shape (2,)."""
    weights = weights or TrackingWeights()
    state, force = np.diag((weights.position, weights.velocity)), np.array([[weights.force]])
    return np.asarray(-regulator(axis.A, axis.B[:, None], state, force)[0])


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


def stiffening_gains(axis: Axis, gain: FloatArray, steps: int) -> Iterator[FloatArray]:
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


def best_tube(
    axis: Axis,
    bound: AxisBound,
    available: FloatArray,
    gains: Iterable[FloatArray] | None = None,
    wanted: float = 0.0,
    frequencies: Iterable[float] = FREQUENCIES,
) -> tuple[Tube, FloatArray]:
    """Return the narrowest tube whose feedback leaves at least `wanted` of the available force.

    The narrowest tube has the smallest sum of the largest and the last width, because clearance is needed both along
    the approach and at its end. If no tube leaves that much force, the one that leaves the most is returned; it cannot
    be flown if its smallest reserve is negative.

    Args:
        axis: The axis.
        bound: Disturbance of the axis.
        available: Force available for feedback at each step, ``F_max - |F_plan|`` of the worst axis [N], shape (K,).
        gains: Gains to try, shape (2,) or (K, 2); by default `candidate_gains`, and the `stiffening_gains` of the best.
        wanted: Force that must remain at all times [N].
        frequencies: Natural frequencies of the default gains [rad/s].

    Returns:
        The tube, and the force that remains at each step [N], shape (K,).
    """

    def rank(tube: Tube) -> tuple[bool, float]:
        least = float((available - tube.force).min())
        enough = least >= wanted
        return not enough, float(tube.clearance.max() + tube.clearance[-1]) if enough else -least

    best = min((truth_tube(axis, gain, bound) for gain in gains or candidate_gains(axis, frequencies)), key=rank)
    if gains is None and not rank(best)[0]:
        stiffer = (truth_tube(axis, gain, bound) for gain in stiffening_gains(axis, best.gain, len(bound.position)))
        best = min((best, *stiffer), key=rank)
    return best, available - best.force
