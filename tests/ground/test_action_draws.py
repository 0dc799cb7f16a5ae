"""Drawn actions against the formulas in NumPy, with the bits of `Streams`."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.random.action_draws import Categorical, Gaussian, draw_in_rollout
from safe_inspect.random.streams import Streams

SEED, STEP, SLOTS = 2**40 + 1, 9, np.arange(500) * 7
SIZES = (2, 5, 3)


def uniform(width, deputies):
    """Return numbers in (0, 1), a multiple of four a row."""
    blocks = (width + 3) // 4
    bits = Streams(SEED, SLOTS, np.zeros_like(SLOTS)).bits("action", 2 * blocks * (deputies.max() + 1), STEP)
    pairs = np.take_along_axis(bits, 2 * blocks * deputies[:, None] + np.arange(2 * blocks), axis=1)
    words = np.stack((pairs >> np.uint64(32), pairs & np.uint64(0xFFFFFFFF)), axis=-1).reshape(len(SLOTS), -1)
    return (words + 0.5) * 2.0**-32


def gaussian(inputs, deputies):
    width = inputs.shape[1] // 2
    pairs = uniform(width, deputies).reshape(len(inputs), -1, 2)
    radius, angle = np.sqrt(-2.0 * np.log(pairs[..., 0])), 2.0 * np.pi * (pairs[..., 1] - 0.5 * 2.0**-32)
    normal = np.stack((radius * np.cos(angle), radius * np.sin(angle)), axis=-1).reshape(len(inputs), -1)[:, :width]
    return inputs[:, :width] + np.exp(inputs[:, width:].astype(np.float64)) * normal


def choices(inputs, deputies):
    shares = [np.exp(part.astype(np.float64)) for part in np.split(inputs, np.cumsum(SIZES)[:-1], axis=1)]
    share = uniform(len(SIZES), deputies)
    return np.stack(
        [
            (np.cumsum(p, axis=1) / p.sum(axis=1, keepdims=True) < share[:, [j]]).sum(axis=1)
            for j, p in enumerate(shares)
        ],
        axis=1,
    )


@pytest.mark.parametrize("deputies", [np.zeros(500, int), np.full(500, 2), np.arange(500) % 3])
def test_draws_are_those_of_the_formulas(deputies):
    inputs = np.random.default_rng(0).normal(size=(500, 10)).astype(np.float32)
    where = (SEED, SLOTS, deputies, STEP)
    found = draw_in_rollout(Gaussian(5), inputs, True, *where)
    np.testing.assert_allclose(found, gaussian(inputs, deputies), rtol=1e-6, atol=1e-7)
    found = draw_in_rollout(Categorical(SIZES), inputs, True, *where)
    np.testing.assert_array_equal(found, choices(inputs, deputies))
    assert [len(np.unique(column)) for column in found.T] == [2, 5, 3]


def test_the_most_likely_action_is_the_mean_or_the_largest_logit():
    inputs = np.random.default_rng(1).normal(size=(500, 10)).astype(np.float32)
    where = (SEED, SLOTS, np.zeros(500, int), STEP)
    np.testing.assert_array_equal(draw_in_rollout(Gaussian(5), inputs, False, *where), inputs[:, :5])
    likely = np.stack([part.argmax(axis=1) for part in np.split(inputs, np.cumsum(SIZES)[:-1], axis=1)], axis=1)
    np.testing.assert_array_equal(draw_in_rollout(Categorical(SIZES), inputs, False, *where), likely)
