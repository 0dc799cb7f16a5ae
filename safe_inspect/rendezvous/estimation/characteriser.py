"""Estimation of the target's motion from a history: axes from the polhode, the best fit, and observability."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydantic import Field

from safe_inspect.dynamics.quaternion import conjugate, exp, from_matrix, log, multiply, normalise, rotate, to_matrix
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rendezvous.estimation.states import (
    MEDIAN_SIZE,
    Fit,
    FitOptions,
    History,
    Motion,
    TargetEstimate,
    edge_residuals,
    fit_motion,
    logits_of,
    ratios_of,
    turned_by_bias,
)
from safe_inspect.rendezvous.poses import HALF_TURNS, MODEL
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import FloatArray
from safe_inspect.units import NonNegativeDuration, PositiveDuration, quantity

#: Number of linear combinations of the two quadrics that are tried.
_ANGLES = 180
#: Limits of the singular values: the transverse axes are not observed if s6 / s5 is above or s5 / s1 below its limit.
_LARGEST_RATIO, _LEAST_RATIO = 0.5, 1e-2


def angular_velocities(
    times: FloatArray, orientation: FloatArray, span: float = 1.0, window: float = 5.0
) -> tuple[FloatArray, FloatArray]:
    """Return mid times [s], shape (n,), and smoothed angular velocities in the body's frame [rad/s], shape (n, 3).

    ``w = Log(R_k^T R_k+m) / (t_k+m - t_k)`` holds at the mid time, where m is the smallest number of frames that covers
    `span`. The rates are then smoothed with a Hann window about each mid time.

    Args:
        times: Times of the frames [s], ascending, shape (F,).
        orientation: Attitudes from the body's frame to an inertial one, shape (F, 4).
        span: Minimum time between two attitudes that are compared [s].
        window: Length of the window [s]; 0 for no smoothing.
    """
    later = np.searchsorted(times, times + span - 1e-9)
    first = np.flatnonzero(later < len(times))
    if not len(first):
        return np.empty(0), np.empty((0, 3))
    second = later[first]
    elapsed = times[second] - times[first]
    rates = log(multiply(conjugate(orientation[first]), orientation[second])) / elapsed[:, None]
    middle = 0.5 * (times[first] + times[second])
    if window <= 0.0:
        return middle, rates
    offset = np.abs(middle[:, None] - middle) / (0.5 * window)
    weight = np.where(offset < 1.0, 0.5 + 0.5 * np.cos(np.pi * offset), 0.0)
    # Fit a line to the rates in the window and evaluate it at the mid time: the mean is biased at the ends.
    centred = middle - middle[:, None]
    total, first_moment = weight.sum(axis=1), (weight * centred).sum(axis=1)
    second_moment = (weight * centred**2).sum(axis=1)
    determinant = total * second_moment - first_moment**2
    has_slope = determinant > 1e-9 * total**2
    safe = np.where(has_slope, determinant, 1.0)[:, None]
    mean = (weight @ rates) / total[:, None]
    line = (second_moment[:, None] * (weight @ rates) - first_moment[:, None] * ((weight * centred) @ rates)) / safe
    return middle, np.where(has_slope[:, None], line, mean)


class _Polhode(NamedTuple):
    """Principal axes found from angular velocities.

    Attributes:
        axes: The axes of T in the frame of the angular velocities, as columns, with J1 <= J2 <= J3, shape (3, 3).
        ratios: k1 = J1 / J3 and k2 = J2 / J3, shape (2,).
        singular: Ratios s6 / s5 and s5 / s1 of the singular values.
        observable: Whether the transverse axes are observed.
    """

    axes: FloatArray
    ratios: FloatArray
    singular: tuple[float, float]
    observable: bool


def principal_axes_of_motion(times: FloatArray, rates: FloatArray) -> _Polhode:
    """Return the ordered principal axes and the inertia ratios.

    A polhode lies on all quadrics ``w^T (a J + b J^2) w = const``. With rows [w1^2, w2^2, w3^2, 2 w1 w2, 2 w1 w3,
    2 w2 w3, -1], the two right singular vectors of the smallest singular values span them, and the eigenvectors of any
    member are the axes; the member with the largest relative gap between its eigenvalues is used. Euler's equations
    give the ratios: ``w_i(t) - w_i(0) = p_i int w_j w_k`` (i, j, k cyclic), ``p1 = (J2 - J3) / J1`` and so on; the axis
    whose p has the odd sign is axis 2, ``k1 = (1 + p3) / (1 - p1)`` and ``k2 = k1 - p3``. The directions along the
    axes remain undetermined except for the sign of the axis that the motion encircles.

    Source:
        Setterfield et al., "Inertial properties estimation of a passive on-orbit object using polhode analysis",
        JGCD 41 (2018); the equations were derived independently.

    Args:
        times: Times [s], ascending, shape (n,).
        rates: Angular velocities in a frame that is fixed in the body [rad/s], shape (n, 3).
    """
    scale = float(np.sqrt((rates**2).sum(axis=1).mean()))
    w = rates / scale
    a, b, c = w.T
    rows = np.stack((a * a, b * b, c * c, 2.0 * a * b, 2.0 * a * c, 2.0 * b * c, -np.ones_like(a)), axis=1)
    _, s, right = np.linalg.svd(rows, full_matrices=True)
    s = np.concatenate((s, np.zeros(7 - len(s))))
    floor = np.finfo(float).tiny
    singular = (float(s[5] / max(s[4], floor)), float(s[4] / max(s[0], floor)))
    first, second = (_symmetric(vector) for vector in right[5:])
    angles = np.arange(_ANGLES) * np.pi / _ANGLES
    members = np.cos(angles)[:, None, None] * first + np.sin(angles)[:, None, None] * second
    values = np.linalg.eigvalsh(members)
    gap = np.diff(values, axis=1).min(axis=1) / np.maximum(np.abs(values).max(axis=1), floor)
    axes = np.linalg.eigh(members[gap.argmax()])[1]
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    axes, ratios = _ordered(times, w @ axes * scale, axes)
    observable = singular[0] <= _LARGEST_RATIO and singular[1] >= _LEAST_RATIO and bool(np.isfinite(ratios).all())
    return _Polhode(axes, ratios, singular, observable)


def _symmetric(v: FloatArray) -> FloatArray:
    return np.array([[v[0], v[3], v[4]], [v[3], v[1], v[5]], [v[4], v[5], v[2]]])


def _ordered(times: FloatArray, w: FloatArray, axes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the ordered, right-handed axes and the ratios, given w in the axes, shape (n, 3)."""
    p = _euler_coefficients(times, w)
    # For J1 < J2 < J3, p1 < 0 < p2 and p3 < 0: one sign differs from the other two, in any order of the axes.
    signs = np.sign(p)
    odd = int(np.argmax(signs != np.sign(signs.sum()))) if abs(signs.sum()) == 1 else int(np.argmax(np.abs(p)))
    order = [(odd + 2) % 3, odd, (odd + 1) % 3]
    axes, p = axes[:, order], p[order]
    if p[1] < 0.0:
        axes = axes[:, [2, 1, 0]] * np.array([1.0, -1.0, 1.0])
        p = -p[[2, 1, 0]]
    k1 = (1.0 + p[2]) / (1.0 - p[0])
    ratios = np.array([k1, k1 - p[2]])
    return axes, ratios


def _euler_coefficients(times: FloatArray, w: FloatArray) -> FloatArray:
    """Return p of ``w_i' = p_i w_j w_k`` by least squares of the integrated equations, shape (3,)."""
    from scipy.integrate import cumulative_simpson

    p = np.zeros(3)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        integral = cumulative_simpson(w[:, j] * w[:, k], x=times, initial=0.0)
        matrix = np.stack((integral, np.ones_like(integral)), axis=1)
        p[i] = np.linalg.lstsq(matrix, w[:, i], rcond=None)[0][0]
    return p


#: Minimum number of frames to which a motion is fitted.
LEAST_FRAMES = 8
#: Numbers of evaluations for a fit, for trying a start, and for updating a known motion.
_EVALUATIONS, _TRIAL, _WARM = 40, 15, 8
#: Ratio s6 / s5 of the singular values above which other starts are tried too.
_DOUBTFUL = 0.3
#: Inertia ratios that are assumed if neither the target nor its motion determines them.
_GENERIC = np.array([0.5, 0.8])
#: Standard deviations of the logits about the prior if they are not observable, for a known and an unknown body.
_HELD, _UNKNOWN = 0.05, 2.0
#: Standard deviation of the logits that only makes them finite, and largest logit of a start or a prior.
_WIDE, _MOST = 20.0, 8.0
#: Two principal moments count as different if their ratio is this many standard deviations away from 1.
_DIFFERENT = 3.0
#: Standard deviation of the axes above which they count as not observed [rad].
_LARGEST_AXES = 0.2
#: The edges to every n-th frame are held out to compare motions; number of the newest edges that indicate a change.
_HELD_OUT, _RECENT = 5, 8


class PolhodeCharacteriser(Plugin):
    """Characteriser that finds principal axes from the polhode and fits a free rigid body to all measured rotations.

    Attributes:
        span: Minimum time between two attitudes from which a rate is computed [s].
        window: Length of the smoothing window over the rates [s].
        use_model: Whether to use poses relative to the known model, and its principal axes, in the fit.
        telescoping: Fraction of an edge's variance that is due to the views of its two frames and cancels along a
            chain.
        memory: Correlation time of the errors of poses relative to the model [s]; 0 for independent errors.
        drift: Standard deviation of the error of the gyroscopes' estimated bias [rad/s]; 0 if the bias is known.
    """

    span: PositiveDuration = 1.0  # type: ignore[valid-type]
    window: PositiveDuration = 5.0  # type: ignore[valid-type]
    use_model: bool = True
    telescoping: float = Field(default=0.5, ge=0.0, lt=1.0)
    memory: NonNegativeDuration = 6.0  # type: ignore[valid-type]
    drift: quantity("rad/s", ge=0) = 5e-5  # type: ignore[valid-type]

    def __call__(
        self, history: History, known: KnownBody, before: Motion | None = None, model: FloatArray | None = None
    ) -> TargetEstimate | None:
        """Return the motion at the last frame, or None if there are too few measurements.

        Args:
            history: The edges and attitudes.
            known: Known properties of the body.
            before: The motion found before, from which the fit starts; None to find the start from the rates.
            model: q_GM of the known model, shape (4,), which determines the directions of the axes; None without one.
        """
        if not self.use_model:
            known, model = known._replace(q_MT=None), None
        times, glued = history.in_inertial
        if len(times) < LEAST_FRAMES or len(history.first) < LEAST_FRAMES:
            return None
        middle, rates = angular_velocities(times, glued, self.span, self.window)
        if len(middle) < 7:
            return None
        shown = principal_axes_of_motion(middle, rates)
        options, held = self._options(known)
        if before is not None:
            warm = (options if shown.observable else held)._replace(evaluations=_WARM, warm=True)
            fit = fit_motion(history, before.at(float(history.times[0])), warm)
        else:
            expected = None if model is None or known.q_MT is None else multiply(model, known.q_MT)
            starts = _starts(float(history.times[0]), shown, glued[0], (middle, rates), known, expected)
            fit = _best(history, starts, options)
        observable = shown.observable and _has_three_axes(fit)
        if not observable and (before is None or shown.observable):
            fit = fit_motion(history, fit.motion, held._replace(evaluations=_TRIAL))
        aligned = model is not None or (known.q_MT is not None and bool((history.first == MODEL).any()))
        return _estimate(history, fit, shown, observable, aligned=aligned)

    def _options(self, known: KnownBody) -> tuple[FitOptions, FitOptions]:
        """Return the options of a fit, and those if the ratios are constrained to what is known of them."""
        prior = np.clip(logits_of(_GENERIC if known.ratios is None else known.ratios), -_MOST, _MOST)
        options = FitOptions((prior, _WIDE), known.q_MT, self.telescoping, self.memory, self.drift, _EVALUATIONS, False)
        return options, options._replace(prior=(prior, _UNKNOWN if known.ratios is None else _HELD))


class KnownBody(NamedTuple):
    """Known properties of the target's body.

    Attributes:
        ratios: k1 and k2, which are used if the motion does not determine them, shape (2,); None for an unknown body.
        q_MT: Principal axes in the model, shape (4,); None if poses relative to the model are not used.
    """

    ratios: FloatArray | None = None
    q_MT: FloatArray | None = None  # noqa: N815

    @classmethod
    def of(cls, target: Target | None) -> KnownBody:
        """Return the properties of a target, None for an unknown one."""
        if target is None:
            return cls()
        return cls(target.principal[:2] / target.principal[2], from_matrix(target.R_MT))


def _has_three_axes(fit: Fit) -> bool:
    """Return whether the axes are known and their moments differ.

    Otherwise the body has an axis of symmetry, and the other two axes are arbitrary. With ``k2 = (1 + s(a)) / 2`` the
    ratio (1 - k2) / sigma(k2) is 1 / (s(a) sigma(a)); likewise for k1 and k2 with b.
    """
    sigmas = np.sqrt(np.diag(fit.covariance))
    share = 1.0 / (1.0 + np.exp(-np.clip(fit.motion.logits, -_MOST, _MOST)))
    return bool((_DIFFERENT * share * sigmas[6:8] < 1.0).all() and sigmas[:3].max() < _LARGEST_AXES)


def _starts(
    time: float,
    shown: _Polhode,
    q_WG: FloatArray,  # noqa: N803
    measured: tuple[FloatArray, FloatArray],
    known: KnownBody,
    expected: FloatArray | None,
) -> list[Motion]:
    """Return initial motions at the first frame: from the model, from the polhode and, in doubt, from guesses.

    Args:
        time: Time of the first frame [s].
        shown: Axes and ratios from the polhode.
        q_WG: Attitude of G at that time, shape (4,).
        measured: Times [s] and angular velocities in G [rad/s].
        known: Known properties of the body.
        expected: q_GT from the known model, shape (4,); None without one.
    """
    middle, rates = measured
    first = np.array([np.interp(time, middle, column) for column in rates.T])
    ratios = _GENERIC if known.ratios is None else known.ratios
    frames = [] if expected is None else [(to_matrix(expected), ratios)]
    if np.isfinite(shown.ratios).all():
        frames.append((shown.axes, shown.ratios))
    if not shown.observable or shown.singular[0] > _DOUBTFUL:
        frames += [(shown.axes[:, np.roll(np.arange(3), shift)], ratios) for shift in range(3)]
        along = rates.mean(axis=0) / np.linalg.norm(rates.mean(axis=0))
        across = np.cross(along, np.eye(3)[np.abs(along).argmin()])
        across /= np.linalg.norm(across)
        third = np.cross(along, across)
        guesses = ((third, -across, along), (along, across, third))
        frames += [(np.stack(axes, axis=1), ratios) for axes in guesses]
    starts = []
    for axes, own in frames:
        turns = axes @ HALF_TURNS
        nearest = 0 if expected is None else np.einsum("nij,ij->n", turns, to_matrix(expected)).argmax()
        q_GT = from_matrix(turns[nearest])  # noqa: N806
        starts.append(Motion(time, multiply(q_WG, q_GT), rotate(conjugate(q_GT), first), logits_of(own)))
    return starts


def _best(history: History, starts: list[Motion], options: FitOptions) -> Fit:
    """Return the fit to all edges from the start whose trial fit predicts held-out edges best."""
    if len(starts) == 1:
        return fit_motion(history, starts[0], options)
    trial = options._replace(evaluations=_TRIAL)
    held = history.second % _HELD_OUT == 0
    shown = history.without(held)
    # The derivative of a logit vanishes outside of the clipped range.
    within = [start._replace(logits=np.clip(start.logits, -_MOST, _MOST)) for start in starts]
    trials = [fit_motion(shown, start, trial) for start in within]
    scores = [_soft_square(edge_residuals(history, found.motion, trial)[held]) for found in trials]
    return fit_motion(history, trials[int(np.argmin(scores))].motion, options)


def _soft_square(residuals: FloatArray) -> float:
    """Return the mean soft square of residuals in standard deviations, shape (n, 3)."""
    return float((2.0 * (np.sqrt(1.0 + (residuals**2).sum(axis=1)) - 1.0)).mean())


def _axes_in_g(history: History, fit: Fit, turned: FloatArray) -> FloatArray:
    """Return q_GT, the mean over all frames, since any single one may be off by degrees, shape (4,).

    Args:
        history: The attitudes.
        fit: The motion.
        turned: Rotation of W by a drift, see `turned_by_bias`, shape (F, 3, 3) [s].
    """
    seen = np.isfinite(history.glued).all(axis=1)
    q, _ = tumble(*fit.motion.moved(np.zeros((1, 8))), history.times - fit.motion.time)
    q_WT = multiply(exp(-turned @ fit.drift), q[0])[seen]  # noqa: N806
    each = multiply(multiply(history.glued[seen], conjugate(history.chaser[seen])), q_WT)
    return normalise((each * np.sign(each @ each[-1])[:, None]).sum(axis=0))


def _estimate(history: History, fit: Fit, shown: _Polhode, observable: bool, *, aligned: bool) -> TargetEstimate:
    time = float(history.times[-1])
    motion = fit.motion.at(time)
    used = fit.residuals[fit.used]
    misfit = float(np.sqrt((used**2).mean())) if len(used) else 0.0
    known = np.abs(fit.residuals).sum(axis=1) > 0.0
    newest = np.linalg.norm(fit.residuals[known][-_RECENT:], axis=1)
    # The fit absorbs slow errors, so that small residuals do not mean that the edges are better than they state.
    scale = max(fit.spread, 1.0) ** 2
    # Until the last frame, the drift has rotated the back end's frame W, in which the chaser's attitude is given.
    turned = turned_by_bias(history)
    orientation = multiply(exp(-turned[-1] @ fit.drift), motion.orientation)
    transition = np.concatenate((fit.motion.drifted(time, turned[-1]), np.eye(11)[8:]))
    covariance = scale * transition @ fit.covariance @ transition.T
    axes = np.sqrt(scale * np.linalg.eigvalsh(fit.covariance[:3, :3])[-1])
    return TargetEstimate(
        time=time,
        orientation=orientation,
        angular_velocity=motion.angular_velocity,
        ratios=ratios_of(motion.logits),
        q_GT=_axes_in_g(history, fit, turned),
        covariance=covariance[:8, :8],
        axes_sigma=float(axes),
        observable=observable,
        aligned=aligned,
        misfit=misfit,
        recent_misfit=float(np.median(newest)) / MEDIAN_SIZE if len(newest) else 0.0,
        singular=shown.singular,
        drift=fit.drift,
        drift_covariance=covariance[:, 8:],
    )
