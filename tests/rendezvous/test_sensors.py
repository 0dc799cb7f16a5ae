from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.depth_camera import PROFILES, DepthFrame, DepthRenderer, TimeOfFlightCamera
from safe_inspect.rendezvous.inertial_unit import Imu, ImuNoise
from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.target.boxes import aligned_boxes, mesh_of_boxes
from safe_inspect.rendezvous.target.model import TriangleMesh

_CAMERA = TimeOfFlightCamera().geometry


def _streams(seed: int = 0) -> Streams:
    return Streams(seed, np.zeros(1, np.int64), np.zeros(1, np.int64))


def _frame(mesh: TriangleMesh, profile: str, distance: float = 1.5, seed: int = 0, number: int = 0) -> DepthFrame:
    renderer = DepthRenderer(_CAMERA, mesh, PROFILES[profile])
    return renderer.render(np.eye(3), np.array([0.0, 0.0, -distance]), _streams(seed), number, 0.0)


def _box(half: float = 0.4) -> TriangleMesh:
    return mesh_of_boxes(aligned_boxes(np.zeros((1, 3)), np.full((1, 3), half)))


def test_the_field_of_view_is_that_of_the_camera() -> None:
    x, y = 0.5 * _CAMERA.width / _CAMERA.focal_length, 0.5 * _CAMERA.height / _CAMERA.focal_length
    assert np.rad2deg(2.0 * np.arctan(x)) == pytest.approx(62.0, abs=0.1)
    assert np.rad2deg(np.arctan(y)) == pytest.approx(24.6, abs=0.05)


def test_depth_of_a_box_and_a_sphere_is_exact() -> None:
    frame = _frame(_box(), "ideal")
    assert frame.valid.any()
    np.testing.assert_allclose(frame.depth[frame.valid], 1.1, atol=1e-5)
    np.testing.assert_allclose(frame.points[:, 2], 1.1, atol=1e-5)
    assert frame.flags == ()

    ball = require("trimesh").creation.icosphere(subdivisions=6, radius=0.125)
    mesh = TriangleMesh(np.asarray(ball.vertices), np.asarray(ball.faces, np.int64))
    frame = _frame(mesh, "ideal", distance=0.6)
    along = _CAMERA.directions[frame.valid][:, 2] * 0.6
    gap = 0.125**2 - (0.6**2 - along**2)
    clear = gap > 0.2 * 0.125**2  # near the rim a ray amplifies the height of the triangles' chords
    distance = np.linalg.norm(frame.points, axis=1)
    np.testing.assert_allclose(distance[clear], (along - np.sqrt(np.maximum(gap, 0.0)))[clear], atol=2e-5)
    hit = np.linalg.norm(frame.points - [0.0, 0.0, 0.6], axis=1)
    assert np.abs(hit - 0.125).max() < 1e-5
    assert clear.mean() > 0.7


def test_noise_has_the_stated_variance() -> None:
    exact = _frame(_box(), "ideal")
    for name in ("clean", "nominal", "harsh"):
        noise = PROFILES[name]
        total, count = 0.0, 0
        for number in range(4):
            frame = _frame(_box(), name, number=number)
            inner = frame.valid & exact.valid
            rows, columns = np.nonzero(exact.valid)
            inner[: rows.min() + 2] = inner[rows.max() - 1 :] = False
            inner[:, : columns.min() + 2] = inner[:, columns.max() - 1 :] = False
            cosine = _CAMERA.directions[inner][:, 2]
            distance = exact.depth[inner] / cosine
            sigma = noise.sigma0 + noise.k * distance**2 / cosine
            error = (frame.depth[inner] - exact.depth[inner]) / cosine / sigma
            total, count = total + float(error @ error), count + error.size
        assert abs(total - count) < 4.0 * np.sqrt(2.0 * count), name  # chi-square, four standard deviations
        lost = 1.0 - (frame.valid & exact.valid).sum() / exact.valid.sum()
        assert 0.002 < lost < 0.03


def test_the_same_seed_gives_the_same_bytes_and_frames_are_independent() -> None:
    first, again = _frame(_box(), "harsh"), _frame(_box(), "harsh")
    assert first.depth.tobytes() == again.depth.tobytes()
    other = _frame(_box(), "harsh", number=1)
    both = first.valid & other.valid
    correlation = np.corrcoef(first.depth[both] - 1.1, other.depth[both] - 1.1)[0, 1]
    assert abs(correlation) < 0.05
    assert _frame(_box(), "harsh", seed=1).depth.tobytes() != first.depth.tobytes()


def test_flags_and_range_gate() -> None:
    assert _frame(_box(), "ideal", distance=-3.0).flags == ("out_of_view",)
    assert _frame(_box(), "ideal", distance=5.0).flags == ("out_of_view",)  # beyond the largest range
    assert "inside" in _frame(_box(), "ideal", distance=0.1).flags
    assert _frame(_box(0.02), "ideal", distance=3.0).flags == ("few_points",)


def test_pixels_fly_at_edges_only() -> None:
    frame, exact = _frame(_box(), "clean"), _frame(_box(), "ideal")
    far = np.abs(frame.depth - exact.depth) > 0.015
    far &= frame.valid & exact.valid
    assert far.sum() > 20
    rows, columns = np.nonzero(exact.valid)
    at_rim = np.isin(np.nonzero(far)[0], (rows.min(), rows.max())) | np.isin(
        np.nonzero(far)[1], (columns.min(), columns.max())
    )
    assert at_rim.all()


def test_the_imu_measures_specific_force_and_rate_with_its_biases() -> None:
    truth = np.array([0.2, -0.1, 0.3, 0.01, 0.02, 0.03])

    def measured(noise: ImuNoise, steps: int = 300, samples: int = 10) -> np.ndarray:
        unit, given = Imu(noise, 0.016, _streams()), np.tile(truth, (samples, 1))
        return np.concatenate([np.hstack(unit.measure(given[:, :3], given[:, 3:])) for _ in range(steps)]) - truth

    biases = measured(ImuNoise(acceleration=1e-15, rate=1e-15))  # nothing else is left
    walk = np.diff(biases, axis=0)
    np.testing.assert_allclose(walk[:, :3].std(), 1e-5 * np.sqrt(0.016), rtol=0.05)
    np.testing.assert_allclose(walk[:, 3:].std(), 1e-6 * np.sqrt(0.016), rtol=0.05)
    noisy = measured(ImuNoise())
    errors = noisy - biases
    assert np.abs(errors.mean(axis=0)[:3]).max() < 2e-4
    assert np.abs(errors.mean(axis=0)[3:]).max() < 1.5e-5
    for error, sigma in ((errors[:, :3], 2e-3), (errors[:, 3:], 1.5e-4)):
        chi = float((error**2).sum()) / sigma**2
        assert abs(chi - error.size) < 4.0 * np.sqrt(2.0 * error.size)
    assert measured(ImuNoise(), 2).tobytes() == noisy[:20].tobytes()
    assert measured(ImuNoise(), 3, 0).shape == (0, 6)  # samples farther apart than control steps
