from __future__ import annotations

import math

import numpy as np
import pytest

from safe_inspect.dynamics.cwh import transition
from safe_inspect.rta.constraints import DeputyCollision, DeputyPassiveSafety, PairConstraint, RelativeState
from safe_inspect.rta.constraints.ranges import ChiefCollision, MaximumRange
from safe_inspect.rta.team.safety_filter import TeamFilter, TeamState

N = 0.001027


def pair(position, velocity, sun_angle=0.0):
    return RelativeState(np.atleast_2d(position), np.atleast_2d(velocity), np.array([sun_angle]))


def test_collision_by_hand():
    constraint = DeputyCollision(deputy_radius=5.0, max_acceleration=0.08)
    out = constraint.evaluate(pair([0.0, 30.0, 40.0], [0.0, -0.6, 0.1]))
    assert out.phi == pytest.approx([40.0])
    closing = (30.0 * -0.6 + 40.0 * 0.1) / 50.0
    assert out.h == pytest.approx([math.sqrt(4.0 * 0.08 * 40.0) + closing])


def test_passive_safety_is_the_least_distance_of_two_coasting_deputies():
    rng = np.random.default_rng(3)
    first, second = rng.uniform(-100, 100, (2, 50, 3))
    v_first, v_second = rng.uniform(-0.5, 0.5, (2, 50, 3))
    difference = RelativeState(first - second, v_first - v_second, np.zeros(50))
    least = np.full(50, np.inf)
    states = [np.concatenate((first, v_first), axis=1), np.concatenate((second, v_second), axis=1)]
    for time in np.linspace(0.0, 600.0, 6001):
        phi, _ = transition(N, 12.0, time)
        apart = (states[0] - states[1]) @ phi[:3].T
        least = np.minimum(least, np.sqrt((apart**2).sum(axis=1)))
    found = DeputyPassiveSafety(deputy_radius=4.0, horizon=600.0).phi(difference)
    np.testing.assert_allclose(found, least - 8.0, atol=2e-3)


@pytest.mark.parametrize("constraint", [DeputyCollision(), DeputyPassiveSafety()])
def test_gradients_against_differences(constraint):
    rng = np.random.default_rng(5)
    position, velocity = rng.uniform(-200, 200, (200, 3)), rng.uniform(-0.5, 0.5, (200, 3))
    angle = rng.uniform(0, 2 * math.pi, 200)
    gradient = constraint.gradient(RelativeState(position, velocity, angle))
    numerical = np.empty((200, 6))
    for j in range(6):
        step = np.zeros(6)
        step[j] = 1e-4
        ends = [
            constraint.h(RelativeState(position + sign * step[:3], velocity + sign * step[3:], angle))
            for sign in (1.0, -1.0)
        ]
        numerical[:, j] = (ends[0] - ends[1]) / 2e-4
    off = np.abs(gradient - numerical).max(axis=1) > 1e-4 * (1.0 + np.abs(gradient).max(axis=1))
    assert off.mean() <= 0.01  # a kink may lie between the two ends


class WideBerth(PairConstraint, name="test_wide_berth"):
    """Deputies stay four radii apart."""

    @property
    def about_other(self) -> ChiefCollision:
        return ChiefCollision(collision_radius=4.0 * self.deputy_radius)


class Tether(PairConstraint, name="test_tether"):
    """Deputies stay near to each other, which the team's filter cannot certify."""

    @property
    def about_other(self) -> MaximumRange:
        return MaximumRange(r_max=50.0)


def test_a_team_enforces_a_pair_constraint_of_another_package() -> None:
    run = TeamFilter(names=("test_wide_berth",), deputy_radius=5.0)
    state = TeamState(
        np.array([[[0.0, 100.0, 0.0], [0.0, 100.0, 12.0]], [[0.0, 100.0, 0.0], [0.0, 100.0, 40.0]]]),
        np.zeros((2, 2, 3)), np.zeros(2),
    )  # fmt: skip
    np.testing.assert_allclose(run.phi(state)["test_wide_berth"], [12.0 - 20.0, 40.0 - 20.0])
    np.testing.assert_array_equal(run.recoverable(state), [False, True])


@pytest.mark.parametrize("names", [("test_tether",), ("deputy_collision", "test_wide_berth")])
def test_a_team_refuses_pair_constraints_that_it_cannot_certify(names: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=f"cannot enforce '{names[-1]}'"):
        TeamFilter(names=names)
