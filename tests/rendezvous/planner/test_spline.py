import numpy as np
import pytest

from safe_inspect.rendezvous.planner.paths import SplinePath, spline_basis


@pytest.fixture
def basis():
    return spline_basis(20, 121, 60.0)


@pytest.fixture
def points():
    return np.random.default_rng(0).normal(size=(20, 3))


def test_the_ends_give_position_velocity_and_acceleration(basis):
    start, end = np.random.default_rng(1).normal(size=(2, 3, 3))
    points = basis.ends(start, end)
    for time, state in ((0.0, start), (60.0, end)):
        for value, expected in zip(SplinePath(basis, points).at(np.array([time])), state, strict=True):
            assert np.allclose(value[0], expected, atol=1e-12)
    assert (points[basis.free] == 0.0).all()


def test_derivatives_lie_in_their_hulls(basis, points):
    _, velocity, acceleration = SplinePath(basis, points).at(np.linspace(0.0, 60.0, 2001))
    for values, hull in ((velocity, basis.velocity_hull), (acceleration, basis.acceleration_hull)):
        assert (values <= (hull @ points).max(axis=0) + 1e-12).all()
        assert (values >= (hull @ points).min(axis=0) - 1e-12).all()
    assert np.allclose(velocity[0], (basis.velocity_hull @ points)[0])
    assert np.allclose(acceleration[-1], (basis.acceleration_hull @ points)[-1])


def test_the_samples_are_those_of_the_spline(basis, points):
    for values, expected in zip(basis.values, SplinePath(basis, points).at(basis.times), strict=True):
        assert np.allclose(values @ points, expected, atol=1e-12)


def test_the_gram_matrix_integrates_squared_accelerations_exactly(basis, points):
    times = np.linspace(0.0, 60.0, 200_001)
    squares = (SplinePath(basis, points).at(times)[2] ** 2).sum(axis=1)
    exact = np.einsum("ia,ij,ja->", points, basis.gram, points)
    assert np.isclose(exact, np.trapezoid(squares, times), rtol=1e-7)


def test_the_cheapest_spline_is_stationary_and_keeps_its_ends(basis, points):
    cheapest = basis.cheapest(points)
    assert np.allclose((basis.gram @ cheapest)[basis.free], 0.0, atol=1e-12)
    assert (cheapest[:3] == points[:3]).all()
    assert (cheapest[-3:] == points[-3:]).all()


def test_time_scales_the_derivatives(points):
    slow, fast = spline_basis(20, 121, 60.0), spline_basis(20, 121, 30.0)
    for order in range(3):
        assert np.allclose(fast.values[order], 2.0**order * slow.values[order], atol=1e-13)
    assert np.allclose(fast.gram, 8.0 * slow.gram)
    assert fast is spline_basis(20, 121, 30.0)
