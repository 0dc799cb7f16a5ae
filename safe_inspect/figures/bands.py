"""Combination of the learning curves of several seeds: a centre and its confidence band over the environment steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from safe_inspect.types import FloatArray, IntArray

#: How the seeds are combined: by the arithmetic mean, or by the mean of the middle half.
Centre = Literal["mean", "iqm"]


@dataclass(frozen=True)
class Band:
    """The centre of several curves and its confidence interval, on one grid of steps.

    Attributes:
        steps: Environment steps, shape (S,).
        centre: Mean or interquartile mean over the curves that are known at a step, NaN if there is none, shape (S,).
        low: Lower end of the interval, NaN where fewer than two curves are known, shape (S,).
        high: Upper end of the interval, NaN as in `low`, shape (S,).
        curves: Number of curves that are known, shape (S,).
    """

    steps: FloatArray
    centre: FloatArray
    low: FloatArray
    high: FloatArray
    curves: IntArray


def centre_of(values: FloatArray, centre: Centre) -> FloatArray:
    """Return the centre over the second to last axis, shape (..., S), of values of shape (..., K, S).

    The interquartile mean excludes floor(K / 4) of the sorted values at each end.
    """
    if centre == "iqm":
        cut = values.shape[-2] // 4
        values = np.sort(values, axis=-2)[..., cut : values.shape[-2] - cut, :]
    return np.asarray(values.mean(axis=-2))


def band(
    curves: Sequence[tuple[FloatArray, FloatArray]],
    centre: Centre = "mean",
    *,
    points: int = 200,
    level: float = 0.95,
    resamples: int = 1000,
    seed: int = 0,
) -> Band:
    """Return the band of curves with possibly different steps and lengths.

    Every curve is interpolated between its points and is unknown outside of them. The interval is the percentile
    bootstrap interval over the curves that are known at a step.

    Args:
        curves: Steps and values of each curve, sorted by steps; values that are not finite are left out.
        centre: How the curves are combined.
        points: Size of the grid.
        level: Confidence level.
        resamples: Number of resamples.
        seed: Seed of the resampling.
    """
    known = [(steps[np.isfinite(values)], values[np.isfinite(values)]) for steps, values in curves]
    known = [(steps, values) for steps, values in known if len(steps)]
    if not known:
        empty = np.empty(0)
        return Band(empty, empty, empty, empty, np.empty(0, dtype=np.int64))
    first, last = min(steps[0] for steps, _ in known), max(steps[-1] for steps, _ in known)
    ends = np.unique([end for steps, _ in known for end in (steps[0], steps[-1])])  # where a curve starts or ends
    grid = np.unique(np.concatenate((np.linspace(first, last, points), ends)))
    rows = np.stack([np.interp(grid, steps, values, left=np.nan, right=np.nan) for steps, values in known])
    there = np.isfinite(rows)
    middle, low, high = (np.full(len(grid), np.nan) for _ in range(3))
    generator = np.random.default_rng(seed)
    for pattern in np.unique(there, axis=1).T:  # groups the steps at which the same curves are known
        columns = (there == pattern[:, None]).all(axis=0)
        values = rows[np.ix_(pattern, columns)]
        count = len(values)
        if not count:
            continue
        middle[columns] = centre_of(values, centre)
        if count > 1:
            drawn = generator.integers(count, size=(resamples, count))
            found = centre_of(values[drawn], centre)
            share = 50.0 * (1.0 - level)
            low[columns], high[columns] = np.percentile(found, (share, 100.0 - share), axis=0)
    return Band(grid, middle, low, high, there.sum(axis=0))
