"""Figures of raw episodes, statistics of figures and intervals of statistics, in NumPy alone."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence

import numpy as np

from .one_deputy import DT, Flight, N, hold, sun_direction

#: Quantile of the normal distribution at 97.5 %.
Z = 1.959963984540054
RESAMPLES = 2000
_OWN_RESAMPLES = 20_000


def least_coasting_range(position: np.ndarray, velocity: np.ndarray, horizon: float, grid: float = 1.0) -> np.ndarray:
    """Return the least range of coasting deputies, shape (T,), by a parabola of the squared range about its least one.

    Along a straight line the squared range is a parabola; the curvature of a coast adds 3 n^2 x < 0.01 mm/s^2.
    """
    state = np.concatenate((position, velocity), axis=1)
    times = np.arange(0.0, horizon + 0.5 * grid, grid)
    squared = np.stack([np.square(state @ hold(t)[:3, :6].T).sum(axis=1) for t in times])
    least = squared.min(axis=0)
    before, here, after = squared[:-2], squared[1:-1], squared[2:]
    dip = (here <= before) & (here <= after)
    curvature = np.where(dip, before - 2.0 * here + after, 1.0)
    vertex = np.where(dip, here - (after - before) ** 2 / (8.0 * np.maximum(curvature, 1e-12)), np.inf)
    return np.sqrt(np.minimum(least, vertex.min(axis=0)))


def phi(position: np.ndarray, velocity: np.ndarray, sun_angle: np.ndarray) -> dict[str, np.ndarray]:
    """Return the plain safety quantity of each constraint of docs/safety.md, each of shape (T,)."""
    distance, speed = np.linalg.norm(position, axis=1), np.linalg.norm(velocity, axis=1)
    away = -np.array([sun_direction(angle) for angle in sun_angle])
    cosine = np.einsum("tk,tk->t", position, away) / distance
    return {
        "chief_collision": distance - 10.0,
        "rel_vel": 0.2 + 2.0 * N * (distance - 10.0) - speed,
        "sun": np.arccos(np.clip(cosine, -1.0, 1.0)) - math.radians(30.0),
        "r_max": 800.0 - distance,
        "PSM": least_coasting_range(position, velocity, 100.0) - 10.0,
        **{f"{axis}_vel": 1.0 - np.abs(velocity[:, k]) for k, axis in enumerate("xyz")},
    }


def figures_of(flight: Flight) -> dict[str, float]:
    """Return every figure that an evaluation has of one episode of the task without an enabled filter, by label."""
    position, velocity, counts = np.array(flight.position), np.array(flight.velocity), np.sum(flight.inspected, axis=1)
    total = len(flight.inspected[0])
    distance = np.linalg.norm(position, axis=1)
    terms = {f"reward/{name}": math.fsum(term[name] for term in flight.terms) for name in flight.terms[0]}
    reached = np.flatnonzero(counts >= 0.9 * total - 1e-9)
    # The first step counts the points of the reset too.
    fresh = [step for step in range(1, len(counts)) if counts[step] > (counts[step - 1] if step > 1 else 0)]
    return {
        "return": math.fsum(terms.values()),
        "inspected points": counts[-1],
        "inspected fraction": counts[-1] / total,
        "inspected first": counts[-1],
        "delta-v": flight.delta_v[-1],
        "length": flight.steps,
        **terms,
        "interventions": 0.0,
        "smallest range": distance.min(),
        "largest range": distance.max(),
        "largest speed": np.linalg.norm(velocity, axis=1).max(),
        "time to 90 %": DT * reached[0] if len(reached) else math.nan,
        "delta-v after last point": flight.delta_v[-1] - (flight.delta_v[fresh[-1]] if fresh else 0.0),
        **{f"phi {name}": values.min() for name, values in phi(position, velocity, np.array(flight.sun_angle)).items()},
    }


def iqm(values: np.ndarray) -> np.ndarray:
    """Return the mean of the middle half of the last axis: floor(n / 4) values are left out at each end."""
    cut = values.shape[-1] // 4
    return np.sort(values, axis=-1)[..., cut : values.shape[-1] - cut].mean(axis=-1)


def mean(values: np.ndarray) -> np.ndarray:
    """Return the mean over the last axis."""
    return values.mean(axis=-1)


def wilson(wins: int, count: int) -> tuple[float, float]:
    """Return the roots p of (wins / count - p)^2 = z^2 p (1 - p) / count."""
    share = wins / count
    roots = np.roots([1.0 + Z**2 / count, -(2.0 * share + Z**2 / count), share**2])
    low, high = np.sort(np.clip(roots.real, 0.0, 1.0))
    return float(low), float(high)


def bootstrap_bounds(
    strata: Sequence[np.ndarray], statistic: Callable[[np.ndarray], np.ndarray], resamples: int = RESAMPLES
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return between which values each end of a percentile bootstrap's 95 % interval lies.

    The share of `resamples` draws below a value x has the standard error sqrt(p (1 - p) / resamples), where p is its
    probability; likewise here. So an end of the interval lies between the quantiles at p - 5 s and p + 5 s of the
    draws made here, s^2 = p (1 - p) (1 / resamples + 1 / draws), but for one case in a million. p = 2.5 or 97.5 %.
    """
    strata = [values[~np.isnan(values)] for values in strata]
    generator = np.random.default_rng(99)
    picks = [values[generator.integers(len(values), size=(_OWN_RESAMPLES, len(values)))] for values in strata]
    found = statistic(np.concatenate(picks, axis=1))
    width = 5.0 * math.sqrt(0.025 * 0.975 * (1.0 / resamples + 1.0 / _OWN_RESAMPLES))
    low, high = (
        (
            float(np.quantile(found, max(share - width, 0.0), method="lower")),
            float(np.quantile(found, min(share + width, 1.0), method="higher")),
        )
        for share in (0.025, 0.975)
    )
    return low, high


def cells(line: str) -> list[str]:
    """Return the cells of a line of a printed table."""
    return re.split(r"\s{2,}", line.strip())


def blocks(text: str) -> list[list[list[str]]]:
    """Return the tables of a printed text: lines that begin with two spaces, as cells."""
    found: list[list[list[str]]] = [[]]
    for line in text.splitlines():
        if line.startswith("  "):
            found[-1].append(cells(line))
        elif found[-1]:
            found.append([])
    return [table for table in found if table]


def shows(cell: str, value: float, least: float = 5.1e-5) -> bool:
    """Return whether a cell shows a number: four digits behind the point, three of one below 0.001; ``-`` for none."""
    if not math.isfinite(value):
        return cell == "-"
    return abs(float(cell) - value) <= (least if abs(value) >= 0.000999 else 5.1e-3 * abs(value))


def shows_interval(cell: str, strata: Sequence[np.ndarray], statistic: Callable[[np.ndarray], np.ndarray]) -> bool:
    """Return whether a cell shows the bootstrap interval of a statistic, see `bootstrap_bounds`."""
    known = np.concatenate([values[~np.isnan(values)] for values in strata])
    if len(known) < 2:
        return cell == "-"
    ends = [float(end) for end in cell.split(" to ")]
    return all(
        low - 5.1e-5 <= end <= high + 5.1e-5
        for end, (low, high) in zip(ends, bootstrap_bounds(strata, statistic), strict=True)
    )
