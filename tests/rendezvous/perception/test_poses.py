from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from safe_inspect.rendezvous.poses import adjoint, difference, inverse, perturbed, pose, rotation_exp

_SMALL = st.floats(-1.0, 1.0)
_TANGENT = st.tuples(*[_SMALL] * 6).map(np.array)


@given(_TANGENT, _TANGENT)
def test_a_difference_undoes_a_perturbation(at: np.ndarray, tangent: np.ndarray) -> None:
    first = pose(rotation_exp(at[:3]), at[3:])
    np.testing.assert_allclose(difference(first, perturbed(first, tangent)), tangent, atol=1e-9)
    np.testing.assert_allclose(inverse(first) @ first, np.eye(4), atol=1e-12)


@given(_TANGENT, _TANGENT)
def test_the_adjoint_moves_a_tangent_to_the_other_side(at: np.ndarray, tangent: np.ndarray) -> None:
    first, small = pose(rotation_exp(at[:3]), at[3:]), 1e-5 * tangent
    # perturbed(I, Ad(T) a) T = perturbed(T, a) up to second order
    left = perturbed(np.eye(4), adjoint(first) @ small) @ first
    np.testing.assert_allclose(left, perturbed(first, small), atol=1e-8)


def test_a_tangent_is_rotation_first_and_acts_from_the_right() -> None:
    quarter = pose(rotation_exp(np.array([0.0, 0.0, 0.5 * np.pi])), np.zeros(3))
    moved = perturbed(quarter, np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0]))
    np.testing.assert_allclose(moved[:3, 3], [0.0, 1.0, 0.0], atol=1e-12)
    assert difference(quarter, moved)[3] == pytest.approx(1.0)
