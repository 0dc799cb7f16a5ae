import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from safe_inspect.dynamics import quaternion


@pytest.fixture
def pairs():
    generator = np.random.default_rng(1)
    return quaternion.normalise(generator.normal(size=(2, 200, 4)))


def test_the_product_is_hamiltons(pairs):
    p, q = pairs
    product = quaternion.to_matrix(quaternion.multiply(p, q))
    assert np.allclose(product, quaternion.to_matrix(p) @ quaternion.to_matrix(q), atol=1e-15)
    assert np.allclose(quaternion.multiply(p, quaternion.conjugate(p)), [0.0, 0.0, 0.0, 1.0], atol=1e-15)


def test_matrices_and_rotated_vectors_are_scipys(pairs):
    q, v = pairs[0], np.random.default_rng(2).normal(size=(200, 3))
    assert np.allclose(quaternion.to_matrix(q), Rotation.from_quat(q).as_matrix(), atol=1e-15)
    assert np.allclose(quaternion.rotate(q, v), Rotation.from_quat(q).apply(v), atol=1e-14)
    assert np.allclose(quaternion.rotate_back(q, v), Rotation.from_quat(q).inv().apply(v), atol=1e-14)


def test_a_matrix_gives_its_quaternion_back_also_after_half_a_turn(pairs):
    half_turns = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0.6, 0.8, 0, 1e-9], [0, 0, 0, 1.0]])
    q = np.concatenate((pairs[0], quaternion.normalise(half_turns)))
    back = quaternion.from_matrix(quaternion.to_matrix(q))
    assert np.allclose(back * np.sign((back * q).sum(axis=1))[:, None], q, atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-12, 1e-4, 1.0, 3.14])
def test_log_inverts_exp(angle):
    axis = quaternion.normalise(np.random.default_rng(3).normal(size=(50, 3, 4)))[:, 0, :3]
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    q = quaternion.exp(angle * axis)
    assert np.allclose(quaternion.log(q), angle * axis, rtol=1e-14, atol=1e-15 * angle)
    assert np.allclose(quaternion.log(-q), angle * axis, rtol=1e-14, atol=1e-15 * angle)
    assert np.allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-15)


def test_signs_are_continuous_and_follow_the_first():
    angles = np.linspace(0.0, 20.0, 100)
    smooth = quaternion.exp(angles[:, None] * np.array([0.0, 0.6, 0.8]))[None]
    signs = np.random.default_rng(4).choice([-1.0, 1.0], (1, 100, 1))
    assert (quaternion.continuous(signs * smooth, smooth[:, 0]) == smooth).all()
    assert (quaternion.continuous(signs * smooth, -smooth[:, 0]) == -smooth).all()
