from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.rendezvous.front_end.features import (
    FeatureCloud,
    consistent,
    horn,
    match,
    point_features,
    robust_pose,
)
from safe_inspect.rendezvous.poses import difference, move, pose, rotation_exp

_TRUE = pose(rotation_exp(np.array([0.5, -0.8, 0.3])), np.array([0.2, -0.1, 0.4]))


def _pairs(outliers: float, noise: float, seed: int, count: int = 100) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    second = random.uniform(-0.5, 0.5, (count, 3))
    first = move(_TRUE, second) + noise * random.normal(size=(count, 3))
    wrong = random.permutation(count) < outliers * count
    first[wrong] = random.uniform(-0.5, 0.5, (int(wrong.sum()), 3))
    return first, second, wrong


def test_horn_is_exact_without_noise() -> None:
    first, second, _ = _pairs(0.0, 0.0, 0)
    np.testing.assert_allclose(horn(first, second, np.ones(len(first))), _TRUE, atol=1e-12)


def test_horn_returns_a_rotation_for_a_plane() -> None:
    _, second, _ = _pairs(0.0, 0.0, 1)
    flat = second * [1.0, 1.0, 0.0]
    found = horn(move(_TRUE, flat), flat, np.ones(len(flat)))
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(found, _TRUE, atol=1e-9)


@pytest.mark.parametrize("outliers", [0.0, 0.5, 0.8])
@pytest.mark.parametrize("seed", range(3))
def test_consistent_pairs_and_a_robust_fit_see_through_outliers(outliers: float, seed: int) -> None:
    first, second, wrong = _pairs(outliers, 0.005, seed)
    kept = consistent(first, second, 0.015)
    assert wrong[kept].mean() < 0.2
    found, fits = robust_pose(first[kept], second[kept], 0.03)
    error = difference(_TRUE, found)
    assert np.rad2deg(np.linalg.norm(error[:3])) < 1.5
    assert fits.sum() >= 0.8 * (~wrong).sum() * 0.8


def test_no_pairs_give_no_clique() -> None:
    assert len(consistent(np.zeros((0, 3)), np.zeros((0, 3)), 0.01)) == 0


def test_features_do_not_depend_on_the_pose() -> None:
    random = np.random.default_rng(2)
    points = random.uniform(-0.2, 0.2, (150, 3)) * [1.0, 1.0, 0.2]
    normals = random.normal(size=(150, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    here = point_features(points, normals, 0.1)
    there = point_features(move(_TRUE, points), normals @ _TRUE[:3, :3].T, 0.1)
    # A value at the border of two bins may fall to either side.
    assert np.abs(here - there).mean() < 1e-3
    pairs = match(FeatureCloud(points, here), FeatureCloud(move(_TRUE, points), there))
    assert (pairs[:, 0] == pairs[:, 1]).mean() > 0.9
