"""The hurdle distribution: draws with its probabilities, and their log-probabilities."""

from __future__ import annotations

import numpy as np

from safe_inspect.random.action_draws import Categorical, DrawRows, Gaussian, Hurdle, draw_choices

ROWS = 20_000


def drawn(hurdle, inputs, explore=True, seed=1):
    count = len(inputs)
    whole = np.zeros(count, np.int64)
    rows = DrawRows(np.uint64(seed), np.arange(count, dtype=np.uint64), whole, whole + 7, whole + 1)
    action, log = np.empty((count, hurdle.width), np.float32), np.empty(count, np.float32)
    hurdle.draw(np.ascontiguousarray(inputs, np.float32), explore, rows, action, log)
    return action, log


def test_draws_have_their_probabilities():
    hurdle = Hurdle(5, 3)
    assert hurdle.inputs == 14
    line = np.concatenate(([np.log(0.3 / 0.7)], np.arange(5.0), np.log([0.1, 0.2, 0.3, 0.4, 0.5]), np.log([1, 2, 5])))
    action, log = drawn(hurdle, np.tile(line, (ROWS, 1)))
    burns = (action[:, :5] != 0.0).any(axis=1)
    assert abs(burns.mean() - 0.3) < 4.5 * np.sqrt(0.21 / ROWS)
    numbers = action[burns, :5]
    assert (action[~burns, :5] == 0.0).all()
    deviation = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    np.testing.assert_allclose(numbers.mean(axis=0), np.arange(5.0), atol=4.5 * 0.5 / np.sqrt(len(numbers)))
    np.testing.assert_allclose(numbers.std(axis=0), deviation, rtol=0.05)
    assert np.abs(np.corrcoef(numbers.T) - np.eye(5)).max() < 0.07
    shares = np.bincount(action[:, 5].astype(int), minlength=3) / ROWS
    np.testing.assert_allclose(shares, np.array([1, 2, 5]) / 8, atol=0.02)
    assert abs(np.corrcoef(burns, action[:, 5])[0, 1]) < 0.04
    z = (numbers.astype(float) - np.arange(5.0)) / deviation
    density = np.log(0.3) - (0.5 * z**2 + np.log(deviation) + 0.5 * np.log(2 * np.pi)).sum(axis=1)
    wanted = np.where(burns, 0.0, np.log(0.7)) + np.log(np.array([1, 2, 5]) / 8)[action[:, 5].astype(int)]
    wanted[burns] += density
    np.testing.assert_allclose(log, wanted, atol=1e-4)


def test_without_exploration_it_is_the_most_likely_action():
    hurdle = Hurdle(2, 2)
    inputs = np.array([[0.1, 0.5, -0.5, -1, -1, 0, 1], [-0.1, 0.5, -0.5, -1, -1, 1, 0], [900, 1, 2, 0, 0, 0, 0]])
    action, log = drawn(hurdle, inputs, explore=False)
    np.testing.assert_array_equal(action, np.float32([[0.5, -0.5, 1], [0, 0, 0], [1, 2, 0]]))
    assert np.isfinite(log).all()
    quiet, _ = drawn(hurdle, hurdle.without_noise(np.tile(inputs[:1], (100, 1))))
    burns = quiet[:, 0] != 0.0
    assert 20 < burns.sum() < 80
    np.testing.assert_allclose(quiet[burns, :2], np.tile([[0.5, -0.5]], (burns.sum(), 1)), atol=1e-6)
    assert len(set(quiet[:, 2])) == 2
    single, _ = drawn(Hurdle(2), inputs[:, :5], explore=False)
    np.testing.assert_array_equal(single, action[:, :2])


def test_a_draw_is_a_function_of_its_row():
    hurdle = Hurdle(3, 4)
    inputs = np.random.default_rng(0).normal(size=(50, hurdle.inputs))
    one, other = drawn(hurdle, inputs)[0], drawn(hurdle, inputs[:20])[0]
    np.testing.assert_array_equal(one[:20], other)
    assert (drawn(hurdle, inputs, seed=2)[0] != one).any()


def test_choices_are_drawn_and_numbers_are_means():
    """A rollout that draws the choices alone: the numbers are the means where there is a burn."""
    hurdle, rows = Hurdle(2, 3), 4000
    line = np.concatenate(([np.log(0.9 / 0.1)], [4.0, -3.0], np.log([0.5, 0.5]), np.log([1, 2, 5])))
    actions = draw_choices(hurdle, np.tile(line, (rows, 1)).astype(np.float32), 3)
    burns = actions[:, 0] != 0.0
    assert abs(burns.mean() - 0.9) < 4.5 * np.sqrt(0.09 / rows)
    np.testing.assert_allclose(actions[burns, :2], np.tile([4.0, -3.0], (burns.sum(), 1)), rtol=1e-6)
    np.testing.assert_allclose(np.bincount(actions[:, 2].astype(int)) / rows, np.array([1, 2, 5]) / 8, atol=0.03)


def test_only_choices_are_drawn():
    gaussian = Gaussian(2)
    line = np.array([4.0, -3.0, 0.0, 0.0], np.float32)
    np.testing.assert_array_equal(draw_choices(gaussian, np.tile(line, (5, 1)), 3), np.tile(line[:2], (5, 1)))
    choices = draw_choices(Categorical((2, 2)), np.zeros((4000, 4), np.float32), 3)
    np.testing.assert_allclose(choices.mean(axis=0), 0.5, atol=0.04)
