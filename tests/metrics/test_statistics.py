"""Statistics against values worked out by hand and against distributions that are known."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safe_inspect.metrics.statistics import (
    bootstrap,
    estimate,
    interquartile_mean,
    paired_difference,
    wilson,
)


@pytest.mark.parametrize(
    ("values", "wanted"),
    [
        ([5.0], 5.0),
        ([1.0, 2.0, 9.0], 4.0),  # fewer than four values: nothing is left out
        ([100.0, 1.0, 2.0, -50.0], 1.5),
        ([0.0, 1.0, 2.0, 3.0, 50.0], 2.0),
        ([8.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0], 4.5),
        ([-900.0, -900.0, 3.0, 4.0, 5.0, 6.0, 900.0, 900.0], 4.5),
    ],
)
def test_the_interquartile_mean_by_hand(values, wanted):
    assert interquartile_mean(np.array(values)) == pytest.approx(wanted, rel=1e-15)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=60), st.floats(-1e3, 1e3))
def test_the_interquartile_mean_lies_within_and_moves_with_the_values(values, shift):
    array = np.array(values)
    found = interquartile_mean(array)
    assert array.min() - 1e-6 <= found <= array.max() + 1e-6
    assert interquartile_mean(array + shift) == pytest.approx(found + shift, abs=1e-6)
    assert interquartile_mean(array[::-1]) == pytest.approx(found, abs=1e-6)


@pytest.mark.parametrize(("statistic", "truth"), [(np.mean, 2.0), (interquartile_mean, 2.0)])
def test_intervals_hold_the_truth_as_often_as_they_say(statistic, truth):
    """Of 300 samples of a normal distribution about 95 % hold its centre: 4 standard errors are 5 %."""
    generator = np.random.default_rng(3)
    held = 0
    for _ in range(300):
        found = bootstrap([generator.normal(truth, 1.0, 80)], statistic, resamples=400)
        held += found.low <= truth <= found.high
    assert 0.89 <= held / 300 <= 0.99


def test_the_width_of_the_interval_is_that_of_the_standard_error():
    values = np.random.default_rng(0).normal(size=2000)
    found = bootstrap([values], np.mean)
    assert found.high - found.low == pytest.approx(2 * 1.96 * values.std() / math.sqrt(2000), rel=0.06)


def test_strata_are_resampled_by_themselves():
    """What differs between strata alone is no uncertainty: two constant strata give an interval without a width."""
    low, high = np.zeros(50), np.ones(50)
    apart = bootstrap([low, high], np.mean)
    assert (apart.low, apart.high) == (0.5, 0.5)
    together = bootstrap([np.concatenate((low, high))], np.mean)
    assert together.high - together.low > 0.15


def test_a_stratum_of_one_value_counts():
    found = bootstrap([np.array([10.0]), np.arange(9.0)], np.mean)
    assert 2.0 < found.low < 4.6 < found.high  # the mean of all ten is 4.6
    assert estimate([np.array([10.0]), np.arange(9.0)]).count == 10


def test_the_same_seed_gives_the_same_interval_and_another_seed_another():
    values = np.random.default_rng(1).normal(size=50)
    assert bootstrap([values], np.mean) == bootstrap([values], np.mean)
    assert bootstrap([values], np.mean) != bootstrap([values], np.mean, seed=1)


def test_an_estimate_by_hand():
    found = estimate(np.array([1.0, 2.0, 3.0, 4.0, np.nan]), "m")
    assert (found.count, found.mean, found.iqm, found.unit) == (4, 2.5, 2.5, "m")
    assert found.standard_deviation == pytest.approx(math.sqrt(5.0 / 3.0))
    assert (found.minimum, found.maximum) == (1.0, 4.0)
    assert found.mean_interval.low < 2.5 < found.mean_interval.high


@pytest.mark.parametrize("values", [[], [np.nan, np.nan], [3.0], [3.0, 3.0]])
def test_estimates_of_next_to_nothing_are_valid_json(values):
    told = json.loads(json.dumps(estimate(np.array(values)).as_dict(), allow_nan=False))
    assert told["count"] == np.sum(~np.isnan(values))
    assert told["mean"] == (3.0 if 3.0 in values else None)


@pytest.mark.parametrize(
    ("won", "of", "low", "high"),
    [
        (0, 10, 0.0, 0.2775),  # 1.96^2 / (10 + 1.96^2)
        (10, 10, 0.7225, 1.0),
        (5, 10, 0.2366, 0.7634),
        (990, 1000, 0.9817, 0.9946),
    ],
)
def test_wilsons_interval(won, of, low, high):
    found = wilson(won, of)
    assert (found.low, found.high) == (pytest.approx(low, abs=1e-4), pytest.approx(high, abs=1e-4))


def test_pairs_find_what_their_spread_hides():
    """Episodes differ by 100, the two by 0.1: the paired interval excludes 0, that of the means would not."""
    generator = np.random.default_rng(2)
    hard = generator.normal(0.0, 100.0, 200)
    one, other = hard + 0.1 + generator.normal(0.0, 0.05, 200), hard
    found = paired_difference(one, other, "m/s")
    assert found.mean == pytest.approx(0.1, abs=0.02)
    assert 0.08 < found.interval.low < found.mean < found.interval.high < 0.12
    assert (found.verdict, found.unit, found.count) == ("higher", "m/s", 200)
    assert found.larger > 0.9
    assert paired_difference(other, one).verdict == "lower"
    assert paired_difference(one, one).verdict == ""


def test_rounding_errors_are_no_difference():
    one = np.array([0.99, 0.0, -7.0, 1e6, 3.0])
    found = paired_difference(one, one * (1.0 + 1e-14))
    assert (found.mean, found.smaller, found.larger, found.verdict) == (0.0, 0.0, 0.0, "")
    assert paired_difference(one * (1.0 + 1e-8), one).larger == 0.6


def test_pairs_with_a_missing_value_are_left_out():
    found = paired_difference(np.array([1.0, np.nan, 5.0, 2.0]), np.array([0.0, 1.0, np.nan, 1.0]))
    assert (found.count, found.mean) == (2, 1.0)
    assert paired_difference(np.array([np.nan]), np.array([1.0])).count == 0
    with pytest.raises(ValueError, match="same shape"):
        paired_difference(np.zeros(3), np.zeros(2))
