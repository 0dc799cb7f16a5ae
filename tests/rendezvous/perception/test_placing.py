"""Where frames together show a map, relative to where the back end predicts it."""

from __future__ import annotations

import numpy as np

from safe_inspect.rendezvous.front_end.placing import Placing
from safe_inspect.rendezvous.poses import difference, perturbed, pose, rotation_exp

_SIGMAS = np.repeat([np.deg2rad(0.3), 4e-3], 3)
_COVARIANCE = np.diag(_SIGMAS**2)
_T_MG = pose(rotation_exp(np.deg2rad([20.0, -50.0, 5.0])), np.array([0.03, -0.01, 0.02]))


def _predicted(second: int) -> np.ndarray:
    """Return T_GB of a chaser that approaches a turning map."""
    turn = rotation_exp(np.deg2rad(5.0) * second * np.array([0.6, 0.0, 0.8]))
    return pose(turn, turn @ np.array([0.0, -1.5 + 0.02 * second, 0.1]))


def _placed(frames: int, noise: float) -> Placing:
    random, placing = np.random.default_rng(3), Placing()
    assert placing.expected(_predicted(0)) is None
    for second in range(frames):
        shown = perturbed(_T_MG @ _predicted(second), noise * _SIGMAS * random.normal(size=6))
        placing.update(float(second), _predicted(second), shown, _COVARIANCE)
    return placing


def test_a_pose_that_all_frames_show_is_found() -> None:
    placing = _placed(20, 0.0)
    np.testing.assert_allclose(placing.expected(_predicted(25)), _T_MG @ _predicted(25), atol=1e-9)
    np.testing.assert_allclose(placing.pose, _T_MG @ _predicted(19), atol=1e-9)
    assert 0.3 * _SIGMAS[3] < placing.mismatch < _SIGMAS[3]  # the frames together err less than one


def test_errors_of_single_frames_are_averaged() -> None:
    """Where the chaser is, all frames together err less than one."""
    off = []
    for frames in range(40, 60):
        expected = _placed(frames, 1.0).expected(_predicted(frames))
        assert expected is not None
        off.append(difference(_T_MG @ _predicted(frames), expected))
    rms = np.sqrt(np.mean(np.square(off), axis=0))
    assert (rms < 0.8 * _SIGMAS).all()


def test_a_change_is_followed() -> None:
    """The predicted attitude departs by 0.1 degrees in each second."""
    placing = Placing()
    for second in range(60):
        departed = pose(rotation_exp(np.deg2rad(0.1) * second * np.array([0.0, 0.0, 1.0])), np.zeros(3))
        placing.update(float(second), _predicted(second), departed @ _T_MG @ _predicted(second), _COVARIANCE)
    assert placing.pose is not None
    off = difference(placing.pose, departed @ _T_MG @ _predicted(59))
    assert np.linalg.norm(off[:3]) < np.deg2rad(0.5)
    assert np.linalg.norm(off[3:]) < 0.02


def test_a_direction_that_no_frame_shows_is_not_corrected() -> None:
    """Frames that see a face know the position along its normal alone."""
    blind, placing, predicted = (
        np.diag([1.0, 1.0, 1.0, 1e-6, 1.0, 1.0]),
        Placing(),
        pose(np.eye(3), np.array([0.0, 0.0, 1.0])),
    )
    placing.update(0.0, predicted, predicted, _COVARIANCE)
    for second in range(1, 10):
        placing.update(float(second), predicted, pose(np.eye(3), np.array([0.02, 0.04, 1.0])), blind)
    assert placing.pose is not None
    np.testing.assert_allclose(placing.pose[:3, 3] - predicted[:3, 3], [0.02, 0.0, 0.0], atol=2e-3)


def test_a_frame_that_shows_the_chaser_elsewhere_is_a_mismatch_for_five_frames() -> None:
    assert _placed(4, 0.0).mismatch == np.inf  # five frames must confirm the position
    placing = _placed(20, 0.0)
    wrong = pose(np.eye(3), np.array([0.0, 0.0, 0.1])) @ _T_MG @ _predicted(20)
    placing.update(20.0, _predicted(20), wrong, _COVARIANCE)
    assert 0.05 < placing.mismatch < 0.12
    for second in range(21, 26):
        expected = placing.expected(_predicted(second))
        assert expected is not None
        placing.update(float(second), _predicted(second), expected, _COVARIANCE)
    assert placing.mismatch < _SIGMAS[3]
