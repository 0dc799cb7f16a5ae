"""From rotations to motion: exact data, what cannot be seen, and covariances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from safe_inspect.dynamics.quaternion import conjugate, exp, from_matrix, log, multiply, normalise, rotate, to_matrix
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.rendezvous.estimation.change import covariance_at
from safe_inspect.rendezvous.estimation.characteriser import (
    KnownBody,
    PolhodeCharacteriser,
    angular_velocities,
    principal_axes_of_motion,
)
from safe_inspect.rendezvous.estimation.states import (
    FitOptions,
    History,
    Motion,
    TargetEstimate,
    fit_motion,
    logits_of,
    ratios_of,
)
from safe_inspect.rendezvous.poses import HALF_TURNS, MODEL
from safe_inspect.types import FloatArray

_INERTIA = np.array([0.1314, 0.9661, 1.0])
_LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
#: For errors that are independent, and a bias that is known.
_CHARACTERISER = PolhodeCharacteriser(telescoping=0.0, memory=0.0, drift=0.0)


def _axes_error(q_GT: FloatArray, truth: FloatArray) -> float:  # noqa: N803
    """Return the angle between estimated and true principal axes, whatever their directions [rad]."""
    candidates = from_matrix(to_matrix(q_GT) @ HALF_TURNS)
    return float(np.linalg.norm(log(multiply(conjugate(truth), candidates)), axis=-1).min())


def _tumbling(
    inertia: FloatArray, direction: list[float], seed: int = 0, seconds: int = 120
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return times, q_WT and w in T of a tumble at 5 degrees per second, and a random q_GT."""
    rng = np.random.default_rng(seed)
    rate = np.deg2rad(5.0) * np.array(direction) / np.linalg.norm(direction)
    times = np.arange(seconds + 1.0)
    q, w = tumble(inertia, normalise(rng.normal(size=4))[None], rate[None], times)
    return times, q[0], w[0], normalise(rng.normal(size=4))


def _history(
    times: FloatArray,
    q: FloatArray,
    q_GT: FloatArray,  # noqa: N803
    sigma: float = 0.0,
    seed: int = 0,
    skips: int = 2,
) -> History:
    """Return the edges that a chaser at rest measures; G is B at the first frame."""
    rng = np.random.default_rng(seed)
    chaser = multiply(q[0], conjugate(q_GT))
    glued = multiply(multiply(q_GT, conjugate(q)), chaser)
    pairs = [(j - skip, j) for j in range(1, len(times)) for skip in range(1, skips + 1) if j >= skip]
    first, second = np.array(pairs).T
    exact = multiply(conjugate(glued[first]), glued[second])
    measured = multiply(exact, exp(sigma * rng.normal(size=(len(pairs), 3))))
    covariance = np.tile(np.eye(3) * max(sigma, 1e-4) ** 2, (len(pairs), 1, 1))
    noisy = multiply(glued, exp(sigma * rng.normal(size=(len(times), 3))))
    noisy[0] = glued[0]
    return History(times, np.tile(chaser, (len(times), 1)), noisy, first, second, measured, covariance)


@pytest.mark.parametrize("direction", [[0.7, 0.5, 0.5], [0.2, 0.4, 0.9]])
@pytest.mark.parametrize("inertia", [[0.1314, 0.9661, 1.0], [0.5, 0.8, 1.0], [0.3, 0.75, 1.0]])
def test_the_polhode_gives_axes_and_ratios_of_exact_rates(inertia: list[float], direction: list[float]) -> None:
    times = np.arange(0.0, 120.0, 0.1)
    j = np.array(inertia)
    rate = np.deg2rad(5.0) * np.array(direction) / np.linalg.norm(direction)
    _, w = tumble(j, _LEVEL[None], rate[None], times)
    q_GT = normalise(np.array([0.3, -0.5, 0.2, 0.7]))  # noqa: N806
    shown = principal_axes_of_motion(times, rotate(q_GT, w[0]))
    assert shown.observable
    assert np.rad2deg(_axes_error(from_matrix(shown.axes), q_GT)) < 0.01
    np.testing.assert_allclose(shown.ratios, j[:2], rtol=1e-6)


@pytest.mark.parametrize("direction", [[0.7, 0.5, 0.5], [0.2, 0.4, 0.9]])
def test_exact_edges_are_fitted_exactly(direction: list[float]) -> None:
    times, q, w, q_GT = _tumbling(_INERTIA, direction)  # noqa: N806
    found = _CHARACTERISER(_history(times, q, q_GT), KnownBody())
    assert found is not None
    assert found.observable
    assert np.rad2deg(_axes_error(found.q_GT, q_GT)) < 0.01
    np.testing.assert_allclose(found.ratios, _INERTIA[:2], rtol=1e-6)
    assert abs(np.linalg.norm(found.angular_velocity) - np.linalg.norm(w[-1])) < 1e-8


def test_poses_to_the_model_tell_the_directions_of_the_axes() -> None:
    times, q, w, q_GT = _tumbling(_INERTIA, [0.7, 0.5, 0.5], seed=3, seconds=60)  # noqa: N806
    history, q_MT = _history(times, q, q_GT), normalise(np.array([0.02, -0.04, 0.03, 1.0]))  # noqa: N806
    to_model = multiply(multiply(q_MT, conjugate(q)), history.chaser)
    first = np.concatenate((history.first, np.full(len(times), MODEL)))
    second = np.concatenate((history.second, np.arange(len(times))))
    rotation = np.concatenate((history.rotation, to_model))
    covariance = np.tile(np.eye(3) * 1e-8, (len(first), 1, 1))
    with_model = History(times, history.chaser, history.glued, first, second, rotation, covariance)
    q_GM = multiply(q_GT, conjugate(q_MT))  # noqa: N806
    found = _CHARACTERISER(with_model, KnownBody(q_MT=q_MT), model=q_GM)
    assert found is not None
    assert found.aligned
    assert np.linalg.norm(log(multiply(conjugate(q[-1]), found.orientation))) < 1e-6
    np.testing.assert_allclose(found.angular_velocity, w[-1], atol=1e-8)
    ahead = found.predict(np.array([120.0]))[0][0]
    truth = tumble(_INERTIA, q[-1][None], w[-1][None], np.array([60.0]))[0][0, 0]
    assert np.linalg.norm(log(multiply(conjugate(truth), ahead))) < 1e-5


@pytest.mark.parametrize(
    ("inertia", "direction"),
    [
        ([0.1314, 0.9661, 1.0], [0.02, 0.02, 1.0]),
        ([0.5, 1.0, 1.0], [0.7, 0.5, 0.5]),
        ([1.0, 1.0, 1.0], [0.7, 0.5, 0.5]),
    ],
    ids=["near-flat spin", "axisymmetric", "sphere"],
)
def test_what_the_motion_does_not_show_is_said(inertia: list[float], direction: list[float]) -> None:
    """The ratios are then the known target's, and the prediction is still good."""
    sigma = np.deg2rad(0.2)
    j = np.array(inertia)
    times, q, w, q_GT = _tumbling(j, direction, seed=1, seconds=80)  # noqa: N806
    found = _CHARACTERISER(_history(times, q, q_GT, sigma, skips=1), KnownBody(j[:2]))
    assert found is not None
    assert not found.observable
    ahead = found.predict(times[-1] + np.array([0.0, 60.0]))[0]
    truth = tumble(j, q[-1][None], w[-1][None], np.array([0.0, 60.0]))[0][0]
    turned = np.linalg.norm(log(multiply(conjugate(truth[0]), truth[1])))
    estimated = np.linalg.norm(log(multiply(conjugate(ahead[0]), ahead[1])))
    assert np.rad2deg(abs(turned - estimated)) < 3.0


def test_logits_and_ratios_are_inverse_and_always_physical() -> None:
    rng = np.random.default_rng(0)
    logits = rng.normal(size=(200, 2)) * 3.0
    ratios = ratios_of(logits)
    np.testing.assert_allclose(logits_of(ratios), logits, rtol=1e-5, atol=1e-5)
    k1, k2 = ratios_of(rng.normal(size=(500, 2)) * 40.0).T
    assert ((k1 > 0.0) & (k1 <= k2) & (k2 <= 1.0) & (k1 + k2 >= 1.0 - 1e-12)).all()


def test_rates_of_a_constant_spin_are_exact_at_uneven_times() -> None:
    times = np.cumsum(np.array([0.0, 1.0, 1.0, 2.0, 1.0, 5.0, 1.0, 1.0]))
    rate = np.array([0.02, -0.05, 0.07])
    middle, found = angular_velocities(times, exp(rate * times[:, None]))
    assert (np.diff(middle) > 0.0).all()
    np.testing.assert_allclose(found, np.tile(rate, (len(middle), 1)), atol=1e-12)


def test_the_transition_is_the_derivative_of_the_motion() -> None:
    motion = Motion(
        0.0, normalise(np.array([0.1, 0.2, -0.4, 0.8])), np.array([0.06, 0.04, 0.05]), logits_of(_INERTIA[:2])
    )
    transition, later = motion.transition(40.0), motion.at(40.0)
    step = 1e-5 * np.array([0.3, -0.2, 0.5, 0.02, 0.03, -0.01, 0.4, 0.6])
    inertia, q, w = motion.moved(step[None])
    moved_q, moved_w = tumble(inertia, q, w, np.array([40.0]))
    turn = log(multiply(conjugate(later.orientation), moved_q[0, 0]))
    change = np.concatenate((turn, moved_w[0, 0] - rotate(exp(-turn), later.angular_velocity)))
    np.testing.assert_allclose((transition @ step)[:6], change, rtol=1e-3, atol=1e-9)


def _squared_error(found: TargetEstimate, q: FloatArray, w: FloatArray) -> float:
    """Return the squared error of the tangent's attitude and rate, for the turn by a half of the axes that is nearest.

    Args:
        found: The estimate.
        q: True q_WT, shape (4,).
        w: True angular velocity in T [rad/s], shape (3,).
    """
    turned = from_matrix(to_matrix(found.orientation) @ HALF_TURNS)
    angles = log(multiply(conjugate(turned), q))
    k = int(np.linalg.norm(angles, axis=1).argmin())
    turn = np.kron(np.eye(2), HALF_TURNS[k])
    rate = w - rotate(exp(-angles[k]), HALF_TURNS[k] @ found.angular_velocity)
    error = np.concatenate((angles[k], rate))
    return float(error @ np.linalg.solve(turn @ found.covariance[:6, :6] @ turn.T, error))


@pytest.mark.parametrize("direction", [[0.7, 0.5, 0.5], [0.2, 0.4, 0.9]])
def test_the_covariance_of_the_fit_is_consistent(direction: list[float]) -> None:
    """Of an unknown body; relative poses alone leave 5 degrees of the axes open, and the second motion the ratios."""
    sigma, found = np.deg2rad(0.3), []
    times, q, w, q_GT = _tumbling(_INERTIA, direction, seconds=90)  # noqa: N806
    for seed in range(16):
        history = _history(times, q, q_GT, sigma, seed, skips=1)
        start = Motion(0.0, q[0], w[0], logits_of(_INERTIA[:2]))
        estimate = _CHARACTERISER(history, KnownBody(), before=start)
        assert estimate is not None
        found.append(_squared_error(estimate, q[-1], w[-1]))
    # The mean of 16 squares with 6 degrees of freedom each: 99.8 % are between 3.6 and 9.1.
    assert 3.5 < np.mean(found) < 9.5


@pytest.mark.parametrize("is_counted", [True, False])
def test_the_drift_of_the_gyroscopes_goes_on_after_the_last_frame(is_counted: bool) -> None:
    """A minute later, the chaser's attitude is off by a degree, and the target's relative to it with it."""
    sigma, drift, squares = np.deg2rad(0.1), 4e-4, []
    times, q, w, q_GT = _tumbling(_INERTIA, [0.7, 0.5, 0.5], seconds=150)  # noqa: N806
    count = 91
    for seed in range(16):
        seen = _history(times[:count], q[:count], q_GT, sigma, seed)
        bias = drift * np.random.default_rng([9, seed]).normal(size=3)
        rotation = to_matrix(seen.chaser[0])  # the chaser keeps its attitude, and believes that it turns
        history = replace(seen, chaser=multiply(exp(-times[:count, None] * (rotation @ bias)), seen.chaser))
        start = Motion(0.0, q[0], w[0], logits_of(_INERTIA[:2]))
        characteriser = PolhodeCharacteriser(telescoping=0.0, memory=0.0, drift=drift)
        found = characteriser(history, KnownBody(), before=start)
        assert found is not None
        turned = (times[-1] - found.time) * rotation if is_counted else np.zeros((3, 3))
        attitude = multiply(exp(-turned @ found.drift), found.predict(times[-1:])[0][0])
        error = log(multiply(conjugate(attitude), multiply(exp(-times[-1] * (rotation @ bias)), q[-1])))
        squares.append(error @ np.linalg.solve(covariance_at(found, times[-1], turned)[:3, :3], error))
    # The mean of 16 squares with 3 degrees of freedom each: 99.8 % are between 1.4 and 5.2.
    assert (1.3 < np.mean(squares) < 5.5) == is_counted, np.mean(squares)


def test_the_axes_in_g_do_not_depend_on_one_frame() -> None:
    """An estimate whose axes are those of a poor first frame disagrees with all later ones: a false alarm."""
    times, q, w, q_GT = _tumbling(_INERTIA, [0.7, 0.5, 0.5], seconds=60)  # noqa: N806
    history = _history(times, q, q_GT, np.deg2rad(0.1))
    history.glued[0] = multiply(history.glued[0], exp(np.deg2rad([3.0, 0.0, 0.0])))
    found = _CHARACTERISER(history, KnownBody(), before=Motion(0.0, q[0], w[0], logits_of(_INERTIA[:2])))
    assert found is not None
    seen = multiply(multiply(history.chaser, conjugate(history.glued)), found.q_GT)[1:]
    apart = np.linalg.norm(log(multiply(conjugate(found.predict(times)[0][1:]), seen)), axis=1)
    assert np.median(apart) < np.deg2rad(0.4)


def test_an_edge_that_is_wrong_does_not_count() -> None:
    times, q, w, q_GT = _tumbling(_INERTIA, [0.7, 0.5, 0.5], seconds=60)  # noqa: N806
    history = _history(times, q, q_GT)
    history.rotation[20] = multiply(history.rotation[20], exp(np.array([0.5, 0.0, 0.0])))
    options = FitOptions(None, None, telescoping=0.0, memory=0.0, drift=0.0, evaluations=40, warm=False)
    fit = fit_motion(history, Motion(0.0, q[0], w[0] * 1.01, logits_of(_INERTIA[:2])), options)
    assert not fit.used[20]
    assert fit.used.sum() == len(fit.used) - 1
    assert np.linalg.norm(log(multiply(conjugate(q[0]), fit.motion.orientation))) < 1e-6
