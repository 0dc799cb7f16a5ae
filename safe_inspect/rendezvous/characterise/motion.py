"""From a history to the target's motion: starts, the best fit, and what is observable."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydantic import Field

from safe_inspect.dynamics.quaternion import conjugate, exp, from_matrix, multiply, rotate, to_matrix
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rendezvous.characterise.fit import (
    MEDIAN_SIZE,
    Fit,
    FitOptions,
    Motion,
    edge_residuals,
    fit_motion,
    turned_by_bias,
)
from safe_inspect.rendezvous.characterise.history import History, TargetEstimate
from safe_inspect.rendezvous.characterise.polhode import HALF_TURNS, Polhode, principal_axes_of_motion
from safe_inspect.rendezvous.characterise.rates import angular_velocities
from safe_inspect.rendezvous.characterise.ratios import logits_of, ratios_of
from safe_inspect.rendezvous.edges import MODEL
from safe_inspect.rendezvous.poses import skew
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import FloatArray
from safe_inspect.units import NonNegativeDuration, PositiveDuration, quantity

#: Fewest frames that a motion is fitted to.
LEAST_FRAMES = 8
#: Evaluations of a start that is tried, and of a motion that is only brought up to date.
_TRIAL, _WARM = 15, 8
#: Ratio s6 / s5 of the singular values above which other starts are tried too.
_DOUBTFUL = 0.3
#: Axes of a rigid body that no motion has shown [ratios].
_GENERIC = np.array([0.5, 0.8])
#: Standard deviation of the logits about a prior that stands for what is not observed, of a known and an unknown body.
_HELD, _UNKNOWN = 0.05, 2.0
#: Standard deviation of the logits that only keeps them finite, and the largest that is started from or drawn to.
_WIDE, _MOST = 20.0, 8.0
#: Two principal moments count as different where their ratio is so many standard deviations away from 1.
_DIFFERENT = 3.0
#: Standard deviation of the axes above which they count as not observed [rad].
_LARGEST_AXES = 0.2
#: Every how many frames edges are held out to compare motions, and the newest edges that show a change.
_HELD_OUT, _RECENT = 5, 8


class PolhodeCharacteriser(Plugin):
    """Principal axes from the polhode, then a fit of a free rigid body to all measured rotations.

    Attributes:
        span: Least time between two attitudes that give a rate [s].
        window: Window over the rates [s].
        use_model: Whether poses to the known model, and with them its principal axes, take part in the fit.
        telescoping: Share of an edge's variance that is an error of its frames' views and cancels along a chain.
        memory: Time over which errors of poses to the model stay alike [s]; 0 for independent ones.
        drift: Standard deviation of what the gyroscopes' bias is estimated wrong by [rad/s]; 0 where it is known.
    """

    span: PositiveDuration = 1.0  # type: ignore[valid-type]
    window: PositiveDuration = 5.0  # type: ignore[valid-type]
    use_model: bool = True
    telescoping: float = Field(default=0.5, ge=0.0, lt=1.0)
    memory: NonNegativeDuration = 6.0  # type: ignore[valid-type]
    drift: quantity("rad/s", ge=0) = 5e-5  # type: ignore[valid-type]

    def __call__(
        self, history: History, target: Target | None, before: Motion | None, model: FloatArray | None
    ) -> TargetEstimate | None:
        """Return how the target tumbles, or None where there is too little to tell.

        Args:
            history: What was measured.
            target: The target where it is known.
            before: The motion as it was known before.
            model: q_GM of the known model, shape (4,), where it is known.
        """
        known = KnownBody()
        if target is not None:
            known = KnownBody(
                target.principal[:2] / target.principal[2], from_matrix(target.R_MT) if self.use_model else None
            )
        return self.characterise(history, known, before, model if self.use_model else None)

    def characterise(
        self, history: History, known: KnownBody, before: Motion | None = None, model: FloatArray | None = None
    ) -> TargetEstimate | None:
        """Return the motion at the last frame, or None where there is too little to tell.

        Args:
            history: The edges and attitudes.
            known: What is known of the body.
            before: The motion as it was known before; without one it is found without a start.
            model: q_GM of the known model, shape (4,), which tells the directions of the axes; None without one.
        """
        times, glued = history.in_inertial
        if len(times) < LEAST_FRAMES or len(history.first) < LEAST_FRAMES:
            return None
        middle, rates = angular_velocities(times, glued, self.span, self.window)
        if len(middle) < 7:
            return None
        shown = principal_axes_of_motion(middle, rates)
        options = _Options(self, known)
        if before is not None:
            fitting = options.fitting(_WARM, held=not shown.observable, warm=True)
            fit = fit_motion(history, before.at(float(history.times[0])), fitting)
        else:
            fit = _best(history, _starts(history, shown, glued[0], (middle, rates), known, model), options)
        observable = shown.observable and _has_three_axes(fit)
        if not observable and (before is None or shown.observable):
            fit = fit_motion(history, fit.motion, options.fitting(_TRIAL, held=True))
        aligned = model is not None or (known.q_MT is not None and bool((history.first == MODEL).any()))
        return _estimate(history, fit, shown, observable, aligned=aligned)


class KnownBody(NamedTuple):
    """What is known of the target's body.

    Attributes:
        ratios: k1 and k2, taken where the motion does not show them, shape (2,); None for an unknown body.
        q_MT: Principal axes in the model, shape (4,); None where poses to the model are not used.
    """

    ratios: FloatArray | None = None
    q_MT: FloatArray | None = None  # noqa: N815


class _Options(NamedTuple):
    """The options of the plugin, and what is known of the body."""

    plugin: PolhodeCharacteriser
    known: KnownBody

    def fitting(self, evaluations: int, *, held: bool = False, warm: bool = False) -> FitOptions:
        """Return how a motion is fitted, with the ratios held at the prior or not."""
        plugin, ratios = self.plugin, self.known.ratios
        sigma = (_UNKNOWN if ratios is None else _HELD) if held else _WIDE
        prior = (np.clip(logits_of(_GENERIC if ratios is None else ratios), -_MOST, _MOST), sigma)
        return FitOptions(prior, self.known.q_MT, plugin.telescoping, plugin.memory, plugin.drift, evaluations, warm)


def _has_three_axes(fit: Fit) -> bool:
    """Return whether the axes are known and their moments differ; about an axis of symmetry the others may be turned.

    With ``k2 = (1 + s(a)) / 2`` the ratio (1 - k2) / sigma(k2) is 1 / (s(a) sigma(a)); of k1 and k2 likewise with b.
    """
    sigmas = np.sqrt(np.diag(fit.covariance))
    share = 1.0 / (1.0 + np.exp(-np.clip(fit.motion.logits, -_MOST, _MOST)))
    return bool((_DIFFERENT * share * sigmas[6:8] < 1.0).all() and sigmas[:3].max() < _LARGEST_AXES)


def _starts(
    history: History,
    shown: Polhode,
    q_WG: FloatArray,  # noqa: N803
    measured: tuple[FloatArray, FloatArray],
    known: KnownBody,
    model: FloatArray | None,
) -> list[Motion]:
    """Return motions at the first frame to start from: by the polhode, by the model, and in doubt by guesses."""
    middle, rates = measured
    time = float(history.times[0])
    first = np.array([np.interp(time, middle, column) for column in rates.T])
    ratios = _GENERIC if known.ratios is None else known.ratios
    frames: list[tuple[FloatArray, FloatArray]] = []
    expected = None
    if model is not None and known.q_MT is not None:
        expected = multiply(model, known.q_MT)
        frames.append((to_matrix(expected), ratios))
    if np.isfinite(shown.ratios).all():
        frames.append((shown.axes, shown.ratios))
    if not shown.observable or shown.singular[0] > _DOUBTFUL:
        frames += [(shown.axes[:, np.roll(np.arange(3), shift)], ratios) for shift in range(3)]
        along = rates.mean(axis=0) / np.linalg.norm(rates.mean(axis=0))
        across = np.cross(along, np.eye(3)[np.abs(along).argmin()])
        across /= np.linalg.norm(across)
        third = np.cross(along, across)
        frames += [
            (np.stack((third, -across, along), axis=1), ratios),
            (np.stack((along, across, third), axis=1), ratios),
        ]
    starts = []
    for axes, own in frames:
        turned = axes
        if expected is not None:
            candidates = axes @ HALF_TURNS
            turned = candidates[np.einsum("nij,ij->n", candidates, to_matrix(expected)).argmax()]
        q_GT = from_matrix(turned)  # noqa: N806
        starts.append(Motion(time, multiply(q_WG, q_GT), rotate(conjugate(q_GT), first), logits_of(own)))
    return starts


def _best(history: History, starts: list[Motion], options: _Options) -> Fit:
    """Return the fit of all edges from the start that predicts held-out edges best."""
    if len(starts) == 1:
        return fit_motion(history, starts[0], options.fitting(40))
    held = history.second % _HELD_OUT == 0
    shown = history.without(held)
    trials = [fit_motion(shown, _within_limits(start), options.fitting(_TRIAL)) for start in starts]
    scores = [_score(history, trial.motion, options, held) for trial in trials]
    return fit_motion(history, trials[int(np.argmin(scores))].motion, options.fitting(40))


def _within_limits(start: Motion) -> Motion:
    """Return a start whose logits are where their derivative does not vanish."""
    return start._replace(logits=np.clip(start.logits, -_MOST, _MOST))


def _score(history: History, motion: Motion, options: _Options, held: FloatArray) -> float:
    """Return the mean soft square of the residuals of some edges, in standard deviations."""
    residuals = edge_residuals(history, motion, options.fitting(_TRIAL))[held]
    return float((2.0 * (np.sqrt(1.0 + (residuals**2).sum(axis=1)) - 1.0)).mean())


def _estimate(history: History, fit: Fit, shown: Polhode, observable: bool, *, aligned: bool) -> TargetEstimate:
    time = float(history.times[-1])
    motion = fit.motion.at(time)
    used = fit.residuals[fit.used]
    misfit = float(np.sqrt((used**2).mean())) if len(used) else 0.0
    known = np.abs(fit.residuals).sum(axis=1) > 0.0
    newest = np.linalg.norm(fit.residuals[known][-_RECENT:], axis=1)
    # Slow errors hide in the motion, so that small residuals do not say that the edges are better than they state.
    scale = max(fit.spread, 1.0) ** 2
    # At the end the drift has turned the back end's W, which the chaser's own attitude is in.
    turned = turned_by_bias(history)[-1]
    orientation = multiply(exp(-turned @ fit.drift), motion.orientation)
    transition = np.zeros((8, 11))
    transition[:, :8] = fit.motion.transition(time)
    transition[:3, 8:] = -to_matrix(motion.orientation).T @ turned
    transition[3:6, 8:] = -skew(motion.angular_velocity) @ transition[:3, 8:]
    axes = np.sqrt(scale * np.linalg.eigvalsh(fit.covariance[:3, :3])[-1])
    return TargetEstimate(
        time=time,
        orientation=orientation,
        angular_velocity=motion.angular_velocity,
        ratios=ratios_of(motion.logits),
        q_GT=multiply(conjugate(_q_WG(history)), fit.motion.orientation),
        covariance=scale * transition @ fit.covariance @ transition.T,
        axes_sigma=float(axes),
        observable=observable,
        aligned=aligned,
        misfit=misfit,
        recent_misfit=float(np.median(newest)) / MEDIAN_SIZE if len(newest) else 0.0,
        singular=shown.singular,
    )


def _q_WG(history: History) -> FloatArray:  # noqa: N802
    """Return q_WG: G is B at the first frame."""
    return np.asarray(multiply(history.chaser[0], conjugate(history.glued[0])))
