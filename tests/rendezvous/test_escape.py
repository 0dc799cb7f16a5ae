from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from safe_inspect.dynamics.quaternion import conjugate, rotate
from safe_inspect.rendezvous.coordination.escape import find_escape, remains_clear, safe_radius
from safe_inspect.rendezvous.estimate import BodyState, EstimateErrors, StateEstimate
from safe_inspect.rendezvous.models import MissionConfig
from safe_inspect.rendezvous.planner.query import Limits
from safe_inspect.rendezvous.target.boxes import EnvisatTarget

_DURATIONS = MissionConfig().escapes
_TARGET = EnvisatTarget()()
_LIMITS = Limits()


def _estimate(position: np.ndarray, seed: int, rate: float = 0.0873) -> StateEstimate:
    generator = np.random.default_rng(seed)
    q = generator.normal(size=4)
    q /= np.linalg.norm(q)
    w = rate * np.array([0.7, 0.5, 0.5]) / np.linalg.norm([0.7, 0.5, 0.5])
    # At rest relative to the turning target.
    chaser = BodyState(
        rotate(q, position), rotate(q, np.cross(w, position)), np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3)
    )
    target = BodyState(np.zeros(3), np.zeros(3), q, w)
    return StateEstimate(7.0, 7.0, chaser, target, _TARGET.principal, EstimateErrors(0.0, 0.0), 0.0)


@pytest.mark.parametrize("seed", range(6))
def test_an_escape_from_the_mating_point_is_clear_and_ends_at_rest_outside(seed: int) -> None:
    estimate = _estimate(_TARGET.mating_point, seed)
    escape = find_escape(estimate, _TARGET, _LIMITS, _DURATIONS)
    assert escape is not None
    np.testing.assert_allclose(escape.position[0], estimate.chaser.position, atol=1e-12)
    np.testing.assert_allclose(escape.velocity[0], estimate.chaser.velocity, atol=1e-12)
    times = np.linspace(escape.times[0], escape.times[-1], 4001)
    position, velocity = escape.at(times)
    q, _ = estimate.predict(times)
    distance = _TARGET.solid.distance(rotate(conjugate(q), position) @ _TARGET.R_MT.T)
    assert distance.min() >= _LIMITS.radius + 0.02 - 1e-6
    assert np.linalg.norm(position[-1]) == pytest.approx(safe_radius(_TARGET, _LIMITS))
    np.testing.assert_allclose(velocity[-1], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.diff(position, axis=0) / np.diff(times)[:, None], velocity[:-1], atol=5e-4)
    assert _LIMITS.mass * np.abs(np.gradient(velocity, times, axis=0)).max() < _LIMITS.force
    assert (np.abs(position) <= np.maximum(_LIMITS.keep_in, np.abs(position[0])) + 1e-6).all()
    # An approach and its tube may start where it ends.
    assert (np.abs(position[-1]) <= np.asarray(_LIMITS.keep_in) - 0.25 + 1e-9).all()


def test_there_is_no_escape_from_inside() -> None:
    assert find_escape(_estimate(np.zeros(3), 0), _TARGET, _LIMITS, _DURATIONS) is None


def test_an_escape_remains_clear_until_the_target_turns_otherwise() -> None:
    blocked = 0
    for seed in range(4):
        estimate = _estimate(_TARGET.mating_point, seed)
        escape = find_escape(estimate, _TARGET, _LIMITS, _DURATIONS)
        assert escape is not None
        assert remains_clear(escape, estimate, _TARGET, _LIMITS)
        struck = replace(
            estimate, target=estimate.target._replace(angular_velocity=-3.0 * estimate.target.angular_velocity)
        )
        blocked += not remains_clear(escape, struck, _TARGET, _LIMITS)
        assert remains_clear(escape, replace(struck, time=float(escape.times[-1])), _TARGET, _LIMITS)
    assert blocked
