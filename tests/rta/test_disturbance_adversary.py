"""The disturbances of the audit of safety filters reach their bounds, in the direction that each flight drew."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.rta.adversaries import PUSHES, DisturbanceAdversary
from safe_inspect.rta.constraints.base import RelativeState

ROWS = 400
BOUNDS = DisturbanceBounds(
    velocity=2e-3, position_error=0.3, velocity_error=5e-3, thrust_gain=0.04, thrust_direction=0.1
)  # fmt: skip


def unit(v):
    return v / np.linalg.norm(v, axis=1, keepdims=True)


@pytest.fixture
def state() -> RelativeState:
    generator = np.random.default_rng(1)
    return RelativeState(
        generator.normal(size=(ROWS, 3)) * 60.0, generator.normal(size=(ROWS, 3)), generator.uniform(0.0, 6.0, ROWS)
    )


@pytest.fixture
def adversary() -> DisturbanceAdversary:
    return DisturbanceAdversary(BOUNDS, ROWS, np.random.default_rng(2))


def phi(rows: int = ROWS) -> dict[str, np.ndarray]:
    """Limits of which the largest range is the nearest in even rows, and a speed in odd ones."""
    even = np.arange(rows) % 2 == 0
    return {"r_max": np.where(even, 0.5, 500.0), "x_vel": np.where(even, 0.9, 0.01), "sun": np.full(rows, 1.0)}


def test_every_push_is_drawn_and_goes_where_its_name_says(state, adversary):
    adversary.estimate(state, phi())
    assert set(adversary.push) == set(range(len(PUSHES)))
    np.testing.assert_allclose(np.linalg.norm(adversary.direction, axis=1), 1.0)
    sun = np.stack((-np.cos(state.sun_angle), np.sin(state.sun_angle), np.zeros(ROWS)), axis=1)
    to_cone = unit(sun * np.linalg.norm(state.position, axis=1, keepdims=True) - state.position)
    outward, along = unit(state.position), unit(state.velocity)
    nearest = np.where(np.arange(ROWS)[:, None] % 2 == 0, outward, along)
    for name, expected in (
        ("inward", -outward), ("outward", outward), ("along the velocity", along), ("against it", -along),
        ("to the sun cone", to_cone), ("to the nearest limit", nearest),
    ):  # fmt: skip
        rows = adversary.push == PUSHES.index(name)
        np.testing.assert_allclose(adversary.direction[rows], expected[rows], atol=1e-12, err_msg=name)


def test_steady_pushes_stay_and_others_swing_or_vary(state, adversary):
    seen = []
    for _ in range(4):
        adversary.estimate(state, phi())
        seen.append(adversary.direction)
    steady = adversary.push == PUSHES.index("always one way")
    for later in seen[1:]:
        np.testing.assert_array_equal(later[steady], seen[0][steady])
    swing = adversary.push == PUSHES.index("to and fro")
    np.testing.assert_array_equal(seen[1][swing], -seen[0][swing])
    np.testing.assert_array_equal(seen[2][swing], seen[1][swing])
    np.testing.assert_array_equal(seen[3][swing], seen[0][swing])
    random = adversary.push == PUSHES.index("at random")
    assert (np.abs(seen[1] - seen[0])[random].max(axis=1) > 1e-3).all()


def test_errors_of_the_estimate_reach_their_bounds_and_two_thirds_lie_on_the_push(state, adversary):
    found = adversary.estimate(state, phi())
    np.testing.assert_array_equal(found.sun_angle, state.sun_angle)
    share = []
    for error, bound in (
        (found.position - state.position, BOUNDS.position_error),
        (found.velocity - state.velocity, BOUNDS.velocity_error),
    ):  # fmt: skip
        np.testing.assert_allclose(np.linalg.norm(error, axis=1), bound, rtol=1e-9)
        share.append((error * adversary.direction).sum(axis=1) / bound)
    both = np.isclose(np.abs(share[0]), 1.0, rtol=1e-9)
    np.testing.assert_array_equal(both, np.isclose(np.abs(share[1]), 1.0, rtol=1e-6))
    assert 0.55 < both.mean() < 0.78
    assert 0.3 < (share[0][both] < 0.0).mean() < 0.7


def test_thrusts_and_velocities_are_disturbed_by_their_bounds(state, adversary):
    adversary.estimate(state, phi())
    control = np.random.default_rng(3).uniform(-1.0, 1.0, (ROWS, 3))
    flown = adversary.flown(control)
    np.testing.assert_allclose((unit(flown) * unit(control)).sum(axis=1), np.cos(BOUNDS.thrust_direction), rtol=1e-12)
    gain = np.linalg.norm(flown, axis=1) / np.linalg.norm(control, axis=1)
    towards = (control * adversary.direction).sum(axis=1) > 0.0
    np.testing.assert_allclose(gain, np.where(towards, 1.04, 0.96), rtol=1e-12)
    turned = (unit(flown) - unit(control)) * adversary.direction
    assert (turned.sum(axis=1) > 0.0).all()
    after = adversary.disturbed(state)
    np.testing.assert_allclose(after.velocity - state.velocity, 2e-3 * adversary.direction, atol=1e-15)
    np.testing.assert_array_equal(after.position, state.position)
