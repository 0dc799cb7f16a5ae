import numpy as np
import pytest
from scipy.integrate import solve_ivp

from safe_inspect.dynamics.attitude.inertia import principal_axes
from safe_inspect.dynamics.quaternion import conjugate, log, multiply, normalise

ASTROBEE = np.array([0.153427995, 0.14271405, 0.162302759])


def _reference(inertia, q, w, torque, seconds):
    def rates(_, x):
        w = x[4:]
        acceleration = (torque - np.cross(w, inertia * w)) / inertia
        return np.concatenate((0.5 * multiply(x[:4], np.append(w, 0.0)), acceleration))

    return solve_ivp(rates, (0.0, seconds), np.concatenate((q, w)), "DOP853", rtol=1e-13, atol=1e-15).y[:, -1]


@pytest.fixture
def rotated(rotate_bodies):
    def rotate(q, w, torque, dt, steps):
        q, w = q.copy(), w.copy()
        rotate_bodies(np.tile(ASTROBEE, (len(q), 1)), q, w, torque, dt, steps)
        return q, w

    return rotate


def _bodies(n):
    generator = np.random.default_rng(0)
    q, w = normalise(generator.normal(size=(n, 4))), generator.normal(size=(n, 3)) * 0.1
    return q, w, generator.uniform(-0.025, 0.025, (n, 3)) * 0.3


def test_sixteen_seconds_under_torque_agree_with_a_reference(rotated):
    q, w, torque = _bodies(5)
    after_q, after_w = rotated(q, w, torque, 0.008, 2000)
    for row in range(5):
        expected = _reference(ASTROBEE, q[row], w[row], torque[row], 16.0)
        error = log(multiply(conjugate(normalise(expected[:4])), after_q[row]))
        assert np.linalg.norm(error) < 1e-11
        assert np.allclose(after_w[row], expected[4:], rtol=0.0, atol=1e-11)


def test_the_error_goes_with_the_fourth_power_of_the_step(rotated):
    q, w, torque = _bodies(20)
    exact, _ = rotated(q, w, torque, 0.01, 1600)
    coarse, fine = (rotated(q, w, torque, 16.0 / n, n)[0] for n in (50, 100))
    errors = [np.linalg.norm(log(multiply(conjugate(exact), other)), axis=1).max() for other in (coarse, fine)]
    assert 12.0 < errors[0] / errors[1] < 22.0


def test_a_row_gives_the_same_bits_in_a_batch_of_any_size(rotated):
    q, w, torque = _bodies(7)
    together = rotated(q, w, torque, 0.1, 10)
    alone = [rotated(q[i : i + 1], w[i : i + 1], torque[i : i + 1], 0.1, 10) for i in range(7)]
    assert (together[0] == np.concatenate([one[0] for one in alone])).all()
    assert (together[1] == np.concatenate([one[1] for one in alone])).all()


def test_an_inertia_may_be_rounded():
    moments, _ = principal_axes(np.array([[1.0, 1e-17, 0.0], [-2e-17, 2.0, 0.0], [0.0, 0.0, 2.5]]))
    np.testing.assert_allclose(moments, [1.0, 2.0, 2.5])


@pytest.mark.parametrize(
    ("inertia", "said"),
    [
        (np.diag([1.0, 1.0, 2.1]), "no body has the principal moments 1, 1 and 2.1"),
        (np.diag([1.0, 1.0, -1.0]), "positive definite, its least principal moment is -1"),
        (np.array([[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), "symmetric matrix"),
        (np.eye(2), "symmetric matrix"),
    ],
)
def test_a_matrix_that_is_no_inertia_is_refused(inertia, said):
    with pytest.raises(ValueError, match=said):
        principal_axes(inertia)
