"""What back end and characteriser begin with and find: states, rotations of a history, and the fitted motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, exp, from_matrix, log, multiply, rotate, to_matrix
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.rendezvous.poses import MODEL, Edge, skew
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: Standard deviation of the centre's prior as a fraction of the radius that the target sweeps.
_CENTRE_SHARE = 0.4


class ChaserStart(NamedTuple):
    """State of the chaser at the first frame.

    Attributes:
        pose: T_WB, shape (4, 4) [-, m].
        velocity: Velocity in W [m/s], shape (3,).
    """

    pose: FloatArray
    velocity: FloatArray


class CentrePrior(NamedTuple):
    """Prior of the target's centre of mass.

    Attributes:
        position: Expected position in W [m], shape (3,).
        sigma: Standard deviation along each axis [m].
    """

    position: FloatArray
    sigma: float

    @classmethod
    def seen(cls, points: FloatArray, start: ChaserStart, mount: FloatArray, radius: float | None) -> CentrePrior:
        """Return the prior about the mean of the points that a frame sees, or in front of the camera without any.

        Args:
            points: Points in C [m], shape (n, 3).
            start: State of the chaser.
            mount: Pose T_BC of the camera in B, shape (4, 4).
            radius: Radius that the target sweeps [m]; None if it is not known.
        """
        radius = 1.0 if radius is None else radius
        if len(points):
            place, sigma = points.mean(axis=0), _CENTRE_SHARE * radius
        else:
            place, sigma = np.array([0.0, 0.0, max(1.3 * radius, 0.5)]), 0.6 * radius
        in_body = mount[:3, :3] @ place + mount[:3, 3]
        return cls(start.pose[:3, :3] @ in_body + start.pose[:3, 3], sigma)


@dataclass(frozen=True, eq=False)
class GraphEstimate:
    """Estimate of a factor graph after a frame.

    Attributes:
        frame: Number of the frame.
        chaser: T_WB, shape (4, 4) [-, m].
        velocity: Velocity of the chaser in W [m/s], shape (3,).
        bias: Biases of the accelerometers [m/s^2] and gyroscopes [rad/s], shape (6,).
        relative: T_GB, shape (4, 4) [-, m]; None if the frame has no edge.
        centre: Centre of mass in W [m], shape (3,).
        centre_glued: Centre of mass in G [m], shape (3,).
        model: T_GM, shape (4, 4) [-, m]; None without a pose relative to the model.
        chaser_covariance: Covariance of the tangent of T_WB (rotation [rad], translation [m]), shape (6, 6).
        velocity_covariance: Covariance of the velocity in W [m^2/s^2], shape (3, 3).
        centre_covariance: Covariance of the centre of mass in B, that is, relative to the chaser [m^2], shape (3, 3).
    """

    frame: int
    chaser: FloatArray
    velocity: FloatArray
    bias: FloatArray
    relative: FloatArray | None
    centre: FloatArray
    centre_glued: FloatArray
    model: FloatArray | None
    chaser_covariance: FloatArray
    velocity_covariance: FloatArray
    centre_covariance: FloatArray


@dataclass(frozen=True, eq=False)
class History:
    """Rotations of an observation, in ascending order of time; G equals B at the first frame.

    Attributes:
        times: Times of the frames [s], shape (F,).
        chaser: Attitudes q_WB, shape (F, 4).
        glued: Attitudes q_GB from the back end, shape (F, 4); NaN for frames without an edge.
        first: Index of the earlier frame of each edge, or `MODEL`, shape (E,).
        second: Index of the later frame of each edge, shape (E,).
        rotation: Measured q_ij, or q_MB, shape (E, 4).
        covariance: Covariance of its tangent, shape (E, 3, 3) [rad^2].
    """

    times: FloatArray
    chaser: FloatArray
    glued: FloatArray
    first: IntArray
    second: IntArray
    rotation: FloatArray
    covariance: FloatArray

    @classmethod
    def of(
        cls, times: FloatArray, chaser: FloatArray, glued: FloatArray, edges: Sequence[Edge], frames: Sequence[int]
    ) -> History:
        """Return the history of some frames; edges of other frames are omitted.

        Args:
            times: Times [s], shape (F,).
            chaser: Attitudes q_WB, shape (F, 4).
            glued: Attitudes q_GB, shape (F, 4).
            edges: The measured edges.
            frames: Numbers of the frames, ascending.
        """
        place = {frame: k for k, frame in enumerate(frames)} | {MODEL: MODEL}
        used = [edge for edge in edges if edge.first in place and edge.second in place]
        poses = np.array([edge.pose[:3, :3] for edge in used]).reshape(-1, 3, 3)
        return cls(
            np.asarray(times, dtype=np.float64),
            chaser,
            glued,
            np.array([place[edge.first] for edge in used], np.int64),
            np.array([place[edge.second] for edge in used], np.int64),
            from_matrix(poses),
            np.array([edge.covariance[:3, :3] for edge in used]).reshape(-1, 3, 3),
        )

    def without(self, dropped: FloatArray) -> History:
        """Return the history without the edges of a mask of shape (E,)."""
        kept = ~np.asarray(dropped, bool)
        return History(
            self.times, self.chaser, self.glued,
            self.first[kept], self.second[kept], self.rotation[kept], self.covariance[kept],
        )  # fmt: skip

    @property
    def in_inertial(self) -> tuple[FloatArray, FloatArray]:
        """Times [s], shape (n,), and attitudes q_WG, shape (n, 4), of the frames that have an edge."""
        seen = np.isfinite(self.glued).all(axis=1)
        return self.times[seen], multiply(self.chaser[seen], conjugate(self.glued[seen]))


@dataclass(frozen=True, eq=False)
class TargetEstimate:
    """Estimate of the target's tumbling motion.

    Attributes:
        time: Time of attitude and angular velocity [s].
        orientation: q_WT, shape (4,).
        angular_velocity: Angular velocity in T [rad/s], shape (3,).
        ratios: k1 = J1 / J3 and k2 = J2 / J3, shape (2,).
        q_GT: Principal axes in G, shape (4,).
        covariance: Covariance of the motion's tangent at that time: attitude [rad], angular velocity in the rotated
            axes [rad/s] and logits, shape (8, 8); see `safe_inspect.rendezvous.estimation.states.Motion`.
        axes_sigma: Largest standard deviation of the principal axes in G [rad].
        observable: Whether the transverse axes and the ratios are observable from the motion; otherwise they are those
            of the prior.
        aligned: Whether the directions of the axes agree with those of the model, known from poses relative to it.
        misfit: Root mean square of the residuals in standard deviations; about 1 if noise and motion are as assumed.
        recent_misfit: The same for the newest edges, removed ones included, from their median; large if the motion has
            changed.
        singular: Ratios s6 / s5 and s5 / s1 of the quadrics' singular values.
        drift: Estimated error of the gyroscopes' bias [rad/s], shape (3,): after a time t the back end's frame W has
            turned by ``int R_WB dt drift``, from the estimate's time on.
        drift_covariance: Covariance of the motion's tangent and of the drift with the drift, shape (11, 3).
    """

    time: float
    orientation: FloatArray
    angular_velocity: FloatArray
    ratios: FloatArray
    q_GT: FloatArray  # noqa: N815
    covariance: FloatArray
    axes_sigma: float
    observable: bool
    aligned: bool
    misfit: float
    recent_misfit: float
    singular: tuple[float, float]
    drift: FloatArray = field(default_factory=lambda: np.zeros(3))
    drift_covariance: FloatArray = field(default_factory=lambda: np.zeros((11, 3)))

    @property
    def inertia(self) -> FloatArray:
        """Principal moments up to a common factor, shape (3,)."""
        return np.array([self.ratios[0], self.ratios[1], 1.0])

    def predict(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return q_WT, shape (K, 4), and the angular velocity in T [rad/s], shape (K, 3), at times [s], shape (K,)."""
        elapsed = np.asarray(times, dtype=np.float64) - self.time
        q, w = tumble(self.inertia, self.orientation[None], self.angular_velocity[None], elapsed)
        return q[0], w[0]


def largest_sigma(covariance: FloatArray) -> float:
    """Return the largest standard deviation of a covariance along any direction, shape (n, n)."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))


#: Minimum of a logistic value, so that the logits of a body of revolution are finite.
LEAST_SHARE = 1e-9
#: Logits are clipped to this magnitude.
_LARGEST = 25.0
#: Steps of the finite differences for the Jacobians [rad, rad/s, -, rad/s].
_STEPS = np.repeat([1e-6, 1e-7, 1e-5, 1e-7], [3, 3, 2, 3])
#: Scales of the parameters for the solver's trust region [rad, rad/s, -, rad/s].
_SCALES = np.repeat([1e-2, 1e-3, 0.3, 1e-4], [3, 3, 2, 3])
#: Number of unknowns of the motion, number of all unknowns, and number of residuals of the priors.
_MOTION, _ALL, _PRIORS = 8, 11, 5
#: Median norm of a vector of three independent normal numbers with unit variance.
MEDIAN_SIZE = 1.538
#: Fraction of the variance of a pose relative to the model that is not correlated with that of consecutive poses.
_ALONE = 0.1
#: Residual beyond which an edge counts less, in standard deviations.
_SOFT = 2.0
#: Minimum standard deviation of the drift [rad/s].
_LEAST_DRIFT = 1e-8


def ratios_of(logits: FloatArray) -> FloatArray:
    """Return k1 = J1 / J3 and k2 = J2 / J3, which are those of a rigid body for any logits, shape (..., 2).

    ``k2 = (1 + s(a)) / 2`` and ``k1 = 1 - k2 + (2 k2 - 1) s(b)`` with the logistic function s.

    Args:
        logits: Logits a and b, shape (..., 2).
    """
    s = 1.0 / (1.0 + np.exp(-np.clip(np.asarray(logits, dtype=np.float64), -_LARGEST, _LARGEST)))
    k2 = 0.5 + 0.5 * s[..., 0]
    return np.stack((np.minimum(1.0 - k2 + s[..., 0] * s[..., 1], k2), k2), axis=-1)


def logits_of(ratios: FloatArray) -> FloatArray:
    """Return the logits of ratios, shape (..., 2); ratios that no rigid body has are moved to the nearest possible."""
    k1, k2 = np.asarray(ratios, dtype=np.float64)[..., 0], np.asarray(ratios, dtype=np.float64)[..., 1]
    spread = np.clip(2.0 * k2 - 1.0, LEAST_SHARE, 1.0 - LEAST_SHARE)
    shares = np.clip(np.stack((spread, (k1 - (1.0 - k2)) / spread), axis=-1), LEAST_SHARE, 1.0 - LEAST_SHARE)
    return np.asarray(np.log(shares / (1.0 - shares)))


def inertia_of(logits: FloatArray) -> FloatArray:
    """Return principal moments with J3 = 1, shape (..., 3)."""
    ratios = ratios_of(logits)
    return np.concatenate((ratios, np.ones((*ratios.shape[:-1], 1))), axis=-1)


class Motion(NamedTuple):
    """State of a tumbling body at one time.

    Its tangent is ``(a, r, logits)``: attitude ``q Exp(a)`` and angular velocity ``Exp(-a) w + r``. The measured
    rotations determine w in inertial axes far better than they determine the principal axes, so r is small even if a is
    not. With ``w + r`` instead, the likely motions would lie on a curve, and their covariance would be too small across
    it.

    Attributes:
        time: The time [s].
        orientation: q_WT, shape (4,).
        angular_velocity: Angular velocity in T [rad/s], shape (3,).
        logits: Logits of the inertia ratios, shape (2,).
    """

    time: float
    orientation: FloatArray
    angular_velocity: FloatArray
    logits: FloatArray

    def moved(self, steps: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return inertias (n, 3), attitudes (n, 4) and angular velocities (n, 3) after steps of the tangent (n, 8)."""
        turn = exp(steps[:, :3])
        rate = rotate(conjugate(turn), np.broadcast_to(self.angular_velocity, (len(steps), 3))) + steps[:, 3:6]
        return inertia_of(self.logits + steps[:, 6:8]), multiply(self.orientation, turn), rate

    def at(self, time: float) -> Motion:
        """Return the motion at another time [s]."""
        q, w = tumble(*self.moved(np.zeros((1, 8))), np.array([time - self.time]))
        return Motion(time, q[0, 0], w[0, 0], self.logits)

    def transition(self, time: float) -> FloatArray:
        """Return the derivative of the tangent at another time [s] with respect to this tangent, shape (8, 8)."""
        size = _STEPS[:_MOTION]
        steps = np.concatenate((np.diag(size), -np.diag(size)))
        moved = self.moved(steps)
        q, w = (value[:, 0] for value in tumble(*moved, np.array([time - self.time])))
        turn = log(multiply(conjugate(q[8:]), q[:8]))
        rate = w[:8] - rotate(conjugate(exp(turn)), w[8:])
        return np.concatenate((turn.T, rate.T, np.diag(2.0 * size)[6:])) / (2.0 * size)

    def drifted(self, time: float, turned: FloatArray) -> FloatArray:
        """Return the derivative of the tangent at another time with respect to this tangent and to the drift.

        Args:
            time: The time [s].
            turned: Rotation of the frame W by a drift since this motion's time, see `turned_by_bias`, shape (3, 3) [s].

        Returns:
            The derivative, shape (8, 11).
        """
        then = self.at(time)
        turn = -to_matrix(then.orientation).T @ turned
        of_drift = np.concatenate((turn, -skew(then.angular_velocity) @ turn, np.zeros((2, 3))))
        return np.concatenate((self.transition(time), of_drift), axis=1)


class FitOptions(NamedTuple):
    """Internal options of a fit; the options for users are in `PolhodeCharacteriser`.

    Attributes:
        prior: Prior of the logits of the inertia ratios and its standard deviation; None for none.
        q_MT: Principal axes in the model, shape (4,); None if poses relative to the model are not used.
        telescoping: See `PolhodeCharacteriser`.
        memory: Likewise [s].
        drift: Likewise [rad/s].
        evaluations: Maximum number of evaluations of the solver.
        warm: Whether the start is so close that edges which disagree with it may be removed at once.
    """

    prior: tuple[FloatArray, float] | None
    q_MT: FloatArray | None  # noqa: N815
    telescoping: float
    memory: float
    drift: float
    evaluations: int
    warm: bool


class Fit(NamedTuple):
    """Result of a fit.

    Attributes:
        motion: The motion at the start's time, the first frame.
        drift: Error of the gyroscopes' bias [rad/s], shape (3,): the chaser's attitude is ``Exp(theta) q_WB`` with
            ``theta(t) = int R_WB drift dt`` from the first frame on.
        covariance: Covariance of the motion's tangent, see `Motion` [rad, rad/s, -], and of the drift, shape (11, 11),
            for residuals of unit variance.
        residuals: Residuals of the edges in standard deviations, shape (E, 3); zero for poses relative to the model
            without `q_MT`.
        used: Mask of the edges that are used, shape (E,).
        spread: Root of the reduced chi square, correlations between edges included; 1 if the noise is as assumed.
    """

    motion: Motion
    drift: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    used: BoolArray
    spread: float


class _Problem:
    """Residuals of all edges and of the priors, and their derivative."""

    def __init__(self, history: History, start: Motion, options: FitOptions) -> None:
        self._history, self._start, self._options = history, start, options
        to_model = history.first == MODEL
        self._known = np.ones(len(to_model), bool) if options.q_MT is not None else ~to_model
        self.used = self._known.copy()
        self._whiten = np.linalg.inv(np.linalg.cholesky(history.covariance))
        self._mixing: FloatArray | None = None
        self.turned = turned_by_bias(history)

    def correlate(self) -> None:
        """Include the correlations between edges in the residuals from now on."""
        history, share = self._history, self._options.telescoping
        memory = self._options.memory
        if share <= 0.0 and memory <= 0.0:
            return
        from scipy.linalg import solve_triangular

        incidence = np.zeros((len(history.first), len(history.times)))
        rows = np.flatnonzero(history.first != MODEL)
        incidence[rows, history.first[rows]], incidence[rows, history.second[rows]] = -1.0, 1.0
        correlation = 0.5 * share * incidence @ incidence.T
        if memory > 0.0:
            models = np.flatnonzero(history.first == MODEL)
            at = history.times[history.second[models]]
            correlation[np.ix_(models, models)] = (1.0 - _ALONE) * np.exp(-np.abs(at[:, None] - at) / memory)
        correlation[np.diag_indices(len(correlation))] = 1.0
        used = np.flatnonzero(self.used)
        self._mixing = np.zeros_like(correlation)
        root = np.linalg.cholesky(correlation[np.ix_(used, used)])
        self._mixing[np.ix_(used, used)] = solve_triangular(root, np.eye(len(used)), lower=True, check_finite=False)

    def edges(self, parameters: FloatArray) -> FloatArray:
        """Return the residuals of the edges ``Log(q_ij^-1 q_Xi^-1 q_WT(i) q_WT(j)^-1 q_Xj)``, shape (n, E, 3).

        For a pose relative to the model it is ``Log(q_MB^-1 q_MT q_WT^-1 q_X)``.
        """
        history = self._history
        q, _ = tumble(*self._start.moved(parameters), history.times - self._start.time)
        drift = exp(np.einsum("kij,nj->nki", self.turned, parameters[:, _MOTION:]))
        to_chaser = multiply(conjugate(q), multiply(drift, history.chaser))  # q_TB
        second = to_chaser[:, history.second]
        q_MT = np.array([0.0, 0.0, 0.0, 1.0]) if self._options.q_MT is None else self._options.q_MT  # noqa: N806
        is_model = (history.first == MODEL)[:, None]
        first = np.where(is_model, conjugate(q_MT), to_chaser[:, history.first])
        expected = multiply(conjugate(first), second)
        error = log(multiply(conjugate(history.rotation), expected))
        return np.asarray((self._whiten @ error[..., None])[..., 0] * self._known[:, None])

    def vector(self, parameters: FloatArray) -> FloatArray:
        """Return all residuals, shape (n, 3 E + 5)."""
        edges = self.edges(parameters) * self.used[:, None]
        if self._mixing is not None:
            edges = self._mixing @ edges
        prior = np.zeros((len(parameters), 2))
        if self._options.prior is not None:
            logits, sigma = self._options.prior
            prior = (self._start.logits + parameters[:, 6:_MOTION] - logits) / sigma
        drift = parameters[:, _MOTION:] / max(self._options.drift, _LEAST_DRIFT)
        return np.concatenate((edges.reshape(len(parameters), -1), prior, drift), axis=1)

    def jacobian(self, parameters: FloatArray) -> FloatArray:
        """Return the derivative of the residuals by central differences, shape (3 E + 5, 11)."""
        both = self.vector(np.concatenate((parameters + np.diag(_STEPS), parameters - np.diag(_STEPS))))
        return np.asarray((both[:_ALL] - both[_ALL:]).T / (2.0 * _STEPS))


def turned_by_bias(history: History) -> FloatArray:
    """Return ``D(t_k) = int R_WB dt`` from the first frame on [s], shape (F, 3, 3).

    A bias b rotates the attitude of frame k by D(t_k) b.
    """
    rotation = to_matrix(history.chaser)
    steps = 0.5 * np.diff(history.times)[:, None, None] * (rotation[1:] + rotation[:-1])
    return np.concatenate((np.zeros((1, 3, 3)), np.cumsum(steps, axis=0)))


def edge_residuals(history: History, motion: Motion, options: FitOptions) -> FloatArray:
    """Return the residuals of the edges for a motion, in standard deviations, shape (E, 3)."""
    return np.asarray(_Problem(history, motion, options).edges(np.zeros((1, _ALL)))[0])


def fit_motion(history: History, start: Motion, options: FitOptions) -> Fit:
    """Return the free motion that agrees best with the edges.

    The unknowns are attitude and angular velocity at the start's time, the logits of the inertia ratios, and the drift
    of the gyroscopes. The motion is the closed form of `safe_inspect.dynamics.tumble`. In a first solution, all edges
    are used and large residuals have less weight (soft L1); it is skipped if the options say that the start is warm.
    Then edges beyond four times the robust spread are removed, and correlations between edges are included.

    Args:
        history: The edges.
        start: A motion close to the solution.
        options: Options of the fit.
    """
    from scipy.optimize import least_squares

    problem = _Problem(history, start, options)
    tolerance = 1e-6 if options.warm else 1e-12

    def solve(parameters: FloatArray, loss: str, evaluations: int) -> FloatArray:
        found = least_squares(
            lambda x: problem.vector(x[None])[0], parameters, lambda x: problem.jacobian(x), loss=loss,
            f_scale=_SOFT, x_scale=_SCALES, method="trf", max_nfev=evaluations, xtol=tolerance, ftol=tolerance,
            gtol=tolerance,
        )  # fmt: skip
        return np.asarray(found.x)

    parameters = np.zeros(_ALL)
    if not options.warm:
        parameters = solve(parameters, "soft_l1", options.evaluations)
    size = np.linalg.norm(problem.edges(parameters[None])[0], axis=1)
    spread = np.median(size[problem.used]) / MEDIAN_SIZE if problem.used.any() else 1.0
    problem.used &= size <= 4.0 * MEDIAN_SIZE * max(spread, 1e-9) + 1e-6
    problem.correlate()
    parameters = solve(parameters, "linear", options.evaluations)
    jacobian = problem.jacobian(parameters)
    information = jacobian.T @ jacobian
    scaled = information * np.outer(_SCALES, _SCALES)
    covariance = np.asarray(np.linalg.inv(scaled) * np.outer(_SCALES, _SCALES), dtype=np.float64)
    _, q, w = start.moved(parameters[None])
    motion = Motion(start.time, q[0], w[0], start.logits + parameters[6:_MOTION])
    residuals, whitened = problem.edges(parameters[None])[0], problem.vector(parameters[None])[0, :-_PRIORS]
    spread = np.sqrt((whitened**2).sum() / max(3 * int(problem.used.sum()) - _MOTION, 1))
    return Fit(motion, parameters[_MOTION:], covariance, residuals, problem.used.copy(), float(spread))
