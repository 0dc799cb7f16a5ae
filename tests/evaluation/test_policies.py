from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.environments.layout import Layout
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation import BASELINES, Flight, baseline, random_policy


def flight(first: int, count: int) -> Flight:
    action = Layout(("a", "b"), np.array([-1.0, 2.0]), np.array([1.0, 5.0]))
    return Flight(
        np.arange(first, first + count), Layout((), np.zeros(0), np.zeros(0)), action, 10.0, 0.001, np.ones(1)
    )


def draws(seed: int, first: int, count: int, steps: int) -> np.ndarray:
    policy = random_policy(seed)
    policy.begin(flight(first, count))
    return np.stack([policy(np.zeros((count, 0), dtype=np.float32)) for _ in range(steps)])


def test_random_actions_belong_to_their_slot_and_step():
    whole = draws(3, 0, 9, 5)
    np.testing.assert_array_equal(draws(3, 4, 2, 5), whole[:, 4:6])
    assert len(np.unique(whole)) == whole.size
    assert (draws(4, 0, 9, 5) != whole).all()


def test_random_actions_are_uniform_within_their_bounds():
    many = draws(0, 0, 400, 50).reshape(-1, 2)
    share = (many - [-1.0, 2.0]) / [2.0, 3.0]
    assert share.min() >= 0.0
    assert share.max() < 1.0
    np.testing.assert_allclose(share.mean(axis=0), 0.5, atol=0.01)  # 5 standard errors
    np.testing.assert_allclose(share.var(axis=0), 1.0 / 12.0, atol=0.003)


def test_every_baseline_can_be_had_by_its_name():
    for name in BASELINES:
        policy = baseline(name)
        policy.begin(flight(0, 3))
        assert policy(np.zeros((3, 0), dtype=np.float32)).shape == (3, 2)
    assert not np.any(policy(np.zeros((3, 0), dtype=np.float32)))  # the last in the alphabet is zero-thrust


def test_an_unknown_baseline_is_told_from_the_known():
    with pytest.raises(SafeInspectError, match="did you mean `zero-thrust`"):
        baseline("zero_thrust")
