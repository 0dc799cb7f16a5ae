import numpy as np
import pytest
from scipy.integrate import solve_ivp

from safe_inspect.dynamics.quaternion import conjugate, log, multiply, normalise, rotate
from safe_inspect.dynamics.tumble import angular_acceleration, classify, largest_rate, tumble


def _bodies(n, seed=0):
    """Return moments of random bodies, random attitudes, and angular velocities of 1 to 10 degrees a second."""
    generator = np.random.default_rng(seed)
    semi_axes = generator.uniform(0.1, 1.0, (n, 3)) ** 2
    inertia = np.sort(semi_axes.sum(axis=1)[:, None] - semi_axes, axis=1)
    w = generator.normal(size=(n, 3))
    w *= np.deg2rad(generator.uniform(1.0, 10.0, n) / np.linalg.norm(w, axis=1))[:, None]
    return inertia, normalise(generator.normal(size=(n, 4))), w


def _errors(inertia, q, w, times):
    """Return the largest errors of rate [rad/s] and attitude [rad] against a numerical integration."""

    def rates(_, x):
        return np.concatenate(
            (0.5 * multiply(x[:4], np.append(x[4:], 0.0)), angular_acceleration(np.asarray(inertia), x[4:]))
        )

    start = np.concatenate((q, w))
    x = solve_ivp(rates, (0.0, times[-1]), start, "DOP853", t_eval=times, rtol=1e-13, atol=1e-15).y.T
    attitude, rate = tumble(inertia, q[None], np.asarray(w)[None], times)
    turned = log(multiply(conjugate(normalise(x[:, :4])), attitude[0]))
    return np.abs(rate[0] - x[:, 4:]).max(), np.linalg.norm(turned, axis=1).max()


def _angle(p, q):
    return np.linalg.norm(log(multiply(conjugate(p), q)), axis=-1).max()


def test_random_bodies_agree_with_a_numerical_integration():
    inertia, q, w = _bodies(12)
    assert set(classify(inertia, w).axis) == {1, 3}
    for row in range(12):
        rate, attitude = _errors(inertia[row], q[row], w[row], np.linspace(0.0, 600.0, 31))
        assert rate < 1e-12
        assert attitude < 1e-11


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("distance", [1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 0.0])
def test_bodies_near_the_separatrix(distance, side):
    j1, j2, j3 = inertia = np.array([0.3, 0.5, 0.6])
    w3 = np.sqrt(j1 * (j2 - j1) / (j3 * (j3 - j2))) * 0.05
    w = np.array([0.05, 0.01, w3 * (1.0 + side * distance)])
    rate, attitude = _errors(inertia, _bodies(1)[1][0], w, np.linspace(0.0, 600.0, 31))
    assert rate < 1e-11
    assert attitude < 2e-10


@pytest.mark.parametrize(
    ("inertia", "w"),
    [
        ([0.3, 0.3, 0.5], [0.01, 0.02, 0.05]),
        ([0.3, 0.5, 0.5], [0.01, 0.02, 0.05]),
        ([0.3, 0.5, 0.5], [-0.05, 0.02, 0.0]),
        ([0.4, 0.4, 0.4], [0.01, 0.02, 0.05]),
        ([0.3, 0.3 + 1e-12, 0.5], [0.03, 0.02, 0.03]),
        ([0.3, 0.4, 0.7], [0.01, 0.02, -0.05]),
        ([0.3, 0.4, 0.5], [0.0, 0.0, 0.05]),
        ([0.3, 0.4, 0.5], [0.0, 0.05, 0.0]),
        ([0.3, 0.4, 0.5], [-0.05, 0.0, 0.0]),
        ([0.3, 0.4, 0.5], [0.0, 0.0, 0.0]),
        ([0.3, 0.4, 0.5], [0.0, 0.01, 0.05]),
        ([0.3, 0.4, 0.5], [0.01, 0.0, -0.05]),
        ([0.3, 0.4, 0.5], [0.05, 0.01, 0.0]),
        ([0.3, 0.4, 0.5], [1e-9, 0.0, 0.05]),
        ([0.1314, 0.9661, 1.0], [0.0017, 0.0017, 0.0872]),
    ],
)
def test_degenerate_bodies_and_pure_spins(inertia, w):
    times, q = np.linspace(0.0, 600.0, 13), _bodies(1)[1]
    with np.errstate(divide="raise", invalid="raise"):
        tumble(np.array(inertia), q, np.array([w]), times)
    rate, attitude = _errors(np.array(inertia), q[0], np.array(w), times)
    assert rate < 1e-12
    assert attitude < 1e-10


def test_momentum_stays_in_space_and_energy_in_the_body():
    inertia, q, w = _bodies(300, seed=5)
    q_t, w_t = tumble(inertia, q, w, np.linspace(-600.0, 600.0, 41))
    momentum = rotate(q_t, inertia[:, None] * w_t)
    first = rotate(q, inertia * w)[:, None]
    assert np.allclose(momentum, first, rtol=0.0, atol=1e-11 * np.linalg.norm(first, axis=2).max())
    energy = (inertia[:, None] * w_t * w_t).sum(axis=2)
    assert np.allclose(energy, (inertia * w * w).sum(axis=1)[:, None], rtol=1e-12)


def test_a_motion_continues_itself_and_runs_backwards():
    inertia, q, w = _bodies(100, seed=6)
    q_mid, w_mid = tumble(inertia, q, w, np.array([123.0]))
    q_end, w_end = tumble(inertia, q, w, np.array([300.0]))
    q_on, w_on = tumble(inertia, q_mid[:, 0], w_mid[:, 0], np.array([177.0, -123.0]))
    assert _angle(q_on[:, 0], q_end[:, 0]) < 1e-10
    assert _angle(q_on[:, 1], q) < 1e-10
    assert np.allclose(w_on[:, 0], w_end[:, 0], atol=1e-12)
    assert np.allclose(w_on[:, 1], w, atol=1e-12)


def test_a_turned_observer_sees_the_same_motion_turned():
    inertia, q, w = _bodies(50, seed=7)
    turn, times = normalise(np.array([0.3, -0.2, 0.5, 0.7])), np.linspace(0.0, 100.0, 11)
    q_t, w_t = tumble(inertia, q, w, times)
    q_turned, w_turned = tumble(inertia, multiply(turn, q), w, times)
    assert _angle(multiply(turn, q_t), q_turned) < 1e-13
    assert (w_t == w_turned).all()


def test_signs_are_continuous():
    inertia, q, w = _bodies(50, seed=8)
    q_t, _ = tumble(inertia, q, w, np.linspace(0.0, 200.0, 401))
    assert ((q_t[:, 1:] * q_t[:, :-1]).sum(axis=2) > 0.9).all()
    assert np.allclose(q_t[:, 0], q, atol=1e-14)


def test_the_period_is_that_of_the_angular_velocity():
    inertia, q, w = _bodies(100, seed=9)
    period = classify(inertia, w).period
    for row in range(100):
        _, again = tumble(inertia[row], q[row : row + 1], w[row : row + 1], period[row : row + 1])
        assert np.allclose(again[0, 0], w[row], atol=1e-12)


def test_the_extent_is_the_largest_angle_to_the_axis():
    inertia, q, w = _bodies(40, seed=10)
    kind = classify(inertia, w)
    for row in range(40):
        _, w_t = tumble(inertia[row], q[row : row + 1], w[row : row + 1], np.linspace(0.0, kind.period[row], 2001))
        cosine = np.abs(w_t[0, :, kind.axis[row] - 1]) / np.linalg.norm(w_t[0], axis=1)
        assert np.isclose(np.arccos(cosine.min()), kind.extent[row], atol=1e-4)
    envisat = np.array([0.1314, 0.9661, 1.0])
    directions = np.array([[0.7, 0.5, 0.5], [0.2, 0.4, 0.9], [0.0, 0.0, 1.0]])
    kind = classify(envisat, np.deg2rad(5.0) * directions / np.linalg.norm(directions, axis=1)[:, None])
    assert kind.axis.tolist() == [1, 3, 0]
    assert np.allclose(kind.period, [119.0, 167.0, np.inf], atol=0.6)


@pytest.mark.parametrize("inertia", [[0.5, 0.4, 0.6], [0.1, 0.2, 0.5], [0.0, 0.2, 0.2], [np.nan, 1.0, 1.0]])
def test_moments_of_no_body_are_rejected(inertia):
    with pytest.raises(ValueError, match="tumble"):
        tumble(np.array(inertia), np.array([[0.0, 0.0, 0.0, 1.0]]), np.array([[0.0, 0.1, 0.1]]), np.array([1.0]))


@pytest.mark.slow
def test_ten_thousand_bodies_agree_with_the_runge_kutta_rows(rotate_bodies):
    inertia, q, w = _bodies(10_000, seed=11)
    q_t, w_t = tumble(inertia, q, w, np.array([60.0]))
    rotate_bodies(inertia, q, w, np.zeros((10_000, 3)), 0.01, 6000)
    assert _angle(q_t[:, 0], q) < 1e-9
    assert np.abs(w_t[:, 0] - w).max() < 1e-11


def test_the_largest_rate_is_reached_and_not_exceeded():
    inertia, q, w = _bodies(40, seed=12)
    bound, period = largest_rate(inertia, w), classify(inertia, w).period
    for row in range(40):
        _, w_t = tumble(inertia[row], q[row : row + 1], w[row : row + 1], np.linspace(0.0, period[row], 2001))
        largest = np.linalg.norm(w_t[0], axis=1).max()
        assert largest <= bound[row] * (1.0 + 1e-12)
        assert largest >= bound[row] * (1.0 - 1e-5)
    assert largest_rate(np.array([0.3, 0.4, 0.5]), np.array([[0.0, -0.05, 0.0]])) == pytest.approx([0.05])
