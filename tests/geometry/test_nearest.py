"""The direction to the nearest cluster."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from safe_inspect.geometry.clusters import direction_to_nearest


def nearest_centre(position: np.ndarray, centres: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Return the directions for viewers relative to the body, shape (R, 3)."""
    found = np.full((len(position), 3), np.nan)
    for row in range(len(position)):
        direction_to_nearest(position[row], np.zeros(3), centres[row], count[row], found[row])
    return found


def test_by_hand() -> None:
    centres = np.array([[[9.0, 0.0, 0.0], [0.0, 0.0, -4.0], [0.0, 3.0, 4.0]]] * 5)
    position = np.array([[50.0, 0, 0], [0, 0, -50.0], [0, 30.0, 40.0], [0, 30.0, 40.0], [0, 30.0, 40.0]])
    count = np.array([3, 3, 3, 2, 0])
    expected = [[1, 0, 0], [0, 0, -1], [0, 0.6, 0.8], [1, 0, 0], [0, 0, 0]]
    np.testing.assert_allclose(nearest_centre(position, centres, count), expected, atol=1e-15)


def test_first_of_equals() -> None:
    centres = np.array([[[0.0, 5.0, 0.0], [0.0, -5.0, 0.0]]])
    assert nearest_centre(np.array([[60.0, 0.0, 0.0]]), centres, np.array([2])).tolist() == [[0.0, 1.0, 0.0]]


def test_a_centre_at_the_origin_has_no_direction() -> None:
    position = np.array([[60.0, 0.0, 0.0]])
    for centre in ([0.0, 0.0, 0.0], [1e-16, -1e-16, 0.0]):
        assert not nearest_centre(position, np.array([[centre]]), np.array([1])).any()


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_agrees_with_numpy_row_by_row(seed: int) -> None:
    rng = np.random.default_rng(seed)
    position, centres = rng.normal(0, 60, (8, 3)), rng.normal(0, 5, (8, 10, 3))
    count = rng.integers(0, 11, 8)
    result = nearest_centre(position, centres, count)
    for row in range(8):
        one = slice(row, row + 1)
        assert np.array_equal(nearest_centre(position[one], centres[one], count[one])[0], result[row])
        if count[row] == 0:
            assert not result[row].any()
            continue
        own = centres[row, : count[row]]
        best = own[np.linalg.norm(position[row] - own, axis=1).argmin()]
        np.testing.assert_allclose(result[row], best / np.linalg.norm(best), rtol=1e-14)
