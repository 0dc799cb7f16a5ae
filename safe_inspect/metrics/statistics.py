"""Statistics over episodes: interquartile mean, bootstrap intervals, Wilson's interval, paired differences.

The interquartile mean and its stratified bootstrap are those of Agarwal et al., "Deep Reinforcement Learning at the
Edge of the Statistical Precipice" (NeurIPS 2021). All intervals are functions of the values and the seed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal, NamedTuple

import numpy as np

from safe_inspect.types import AnyArray, FloatArray

#: Number of resamples of a bootstrap, level of every interval, and seed of the resampling.
RESAMPLES, LEVEL, SEED = 2000, 0.95, 0
#: Largest number of values that a bootstrap draws at once.
_BATCH = 4_000_000
#: Rounding error of a sum over an episode, relative to it.
_ROUNDING = 1e-9


class Interval(NamedTuple):
    """A confidence interval, NaN if there are too few values."""

    low: float = math.nan
    high: float = math.nan


class _Figures:
    """Base class of dataclasses of figures."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain numbers for JSON; None for unknown ones."""
        return {item.name: for_json(getattr(self, item.name)) for item in fields(self)}  # type: ignore[arg-type]


def for_json(value: Any) -> Any:
    """Return a value for JSON: an interval as a list, and None for a number that is not finite."""
    if isinstance(value, Interval):
        return [for_json(end) for end in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@dataclass(frozen=True)
class Estimate(_Figures):
    """Estimate of one quantity over many episodes; NaN if there is no value.

    Attributes:
        count: Number of episodes with a value.
        mean: Arithmetic mean.
        standard_deviation: Sample standard deviation, with n - 1.
        mean_interval: 95 % bootstrap interval of the mean.
        iqm: Interquartile mean.
        iqm_interval: 95 % bootstrap interval of the interquartile mean.
        minimum: Smallest value.
        maximum: Largest value.
        unit: Unit of all of them; ``-`` for a dimensionless quantity.
    """

    count: int
    mean: float
    standard_deviation: float
    mean_interval: Interval
    iqm: float
    iqm_interval: Interval
    minimum: float
    maximum: float
    unit: str = "-"


def interquartile_mean(values: AnyArray, axis: int = -1) -> Any:
    """Return the mean of the middle half: of n sorted values, floor(n / 4) are discarded at each end."""
    from scipy.stats import trim_mean

    return trim_mean(values, 0.25, axis=axis)


def bootstrap(
    strata: Sequence[FloatArray], statistic: Callable[..., Any], *, resamples: int = RESAMPLES, seed: int = SEED
) -> Interval:
    """Return the percentile interval of a statistic by a stratified bootstrap: each stratum is resampled separately.

    Args:
        strata: The values of each stratum, such as the episodes of each training seed. With one stratum this is the
            usual bootstrap.
        statistic: Function from all values and the keyword `axis` to the statistic along that axis.
        resamples: Number of resamples.
        seed: Seed of the resampling.
    """
    strata = [np.asarray(values, dtype=np.float64) for values in strata if len(values)]
    count = sum(map(len, strata))
    if count < 2:
        return Interval()
    whole = np.concatenate(strata)
    if (whole == whole[0]).all():
        return Interval(float(whole[0]), float(whole[0]))
    fixed = np.concatenate([np.empty(0), *(values for values in strata if len(values) < 2)])
    strata = [values for values in strata if len(values) > 1]  # SciPy does not resample a single value
    if not strata:
        return Interval()
    from scipy.stats import bootstrap as resample

    def together(*parts: FloatArray, axis: int) -> Any:
        shape = (*np.shape(parts[0])[:-1], len(fixed))
        return statistic(np.concatenate((*parts, np.broadcast_to(fixed, shape)), axis=-1), axis=axis)

    found = resample(
        tuple(strata),
        together,
        n_resamples=resamples,
        batch=max(_BATCH // count, 1),
        axis=-1,
        confidence_level=LEVEL,
        method="percentile",
        random_state=np.random.default_rng(seed),
    ).confidence_interval
    return Interval(float(found.low), float(found.high))


def estimate(values: AnyArray | Sequence[AnyArray], unit: str = "-") -> Estimate:
    """Return the estimate of a quantity.

    Args:
        values: The value of each episode, NaN if it has none, shape (E,); or a sequence of such arrays, one for each
            stratum.
        unit: Unit of the quantity.
    """
    parts = [values] if isinstance(values, np.ndarray) else list(values)
    strata = [np.asarray(part, dtype=np.float64) for part in parts]
    strata = [part[~np.isnan(part)] for part in strata]
    whole = np.concatenate(strata) if strata else np.empty(0)
    if not len(whole):
        return Estimate(0, math.nan, math.nan, Interval(), math.nan, Interval(), math.nan, math.nan, unit)
    return Estimate(
        count=len(whole),
        mean=float(whole.mean()),
        standard_deviation=float(whole.std(ddof=1)) if len(whole) > 1 else math.nan,
        mean_interval=bootstrap(strata, np.mean),
        iqm=float(interquartile_mean(whole)),
        iqm_interval=bootstrap(strata, interquartile_mean),
        minimum=float(whole.min()),
        maximum=float(whole.max()),
        unit=unit,
    )


def wilson(successes: int, trials: int) -> Interval:
    """Return Wilson's score interval of a success rate.

    Source: E. B. Wilson, "Probable inference, the law of succession, and statistical inference", 1927.
    """
    from scipy.stats import binomtest

    if trials < 1:
        return Interval()
    found = binomtest(successes, trials).proportion_ci(LEVEL, method="wilson")
    return Interval(float(found.low), float(found.high))


@dataclass(frozen=True)
class Difference(_Figures):
    """Difference of a quantity between two evaluations, episode by episode.

    Attributes:
        count: Number of episodes in which both have a value.
        mean: Mean of the differences.
        interval: 95 % bootstrap interval of the mean, over pairs.
        iqm: Interquartile mean of the differences.
        iqm_interval: 95 % bootstrap interval of the interquartile mean, over pairs.
        smaller: Fraction of the pairs with a difference below 0.
        larger: Fraction of the pairs with a difference above 0.
        unit: Unit of the differences.
    """

    count: int
    mean: float
    interval: Interval
    iqm: float
    iqm_interval: Interval
    smaller: float
    larger: float
    unit: str = "-"

    @property
    def verdict(self) -> Literal["lower", "higher", ""]:
        """Whether the interval of the mean is below or above 0; empty if it contains 0."""
        if self.interval.high < 0.0:
            return "lower"
        return "higher" if self.interval.low > 0.0 else ""


def paired_difference(one: AnyArray, other: AnyArray, unit: str = "-") -> Difference:
    """Return the difference of a quantity, `one` - `other`, of the same episodes, shape (E,).

    Differences that are smaller than `_ROUNDING` times the values are rounding errors of sums and count as 0.

    Raises:
        ValueError: Their shapes differ.
    """
    if one.shape != other.shape:
        raise ValueError(f"paired values must have the same shape, not {one.shape} and {other.shape}")
    one, other = np.asarray(one, dtype=np.float64), np.asarray(other, dtype=np.float64)
    apart = np.where(np.isclose(one, other, rtol=_ROUNDING, atol=0.0), 0.0, one - other)
    apart = apart[~np.isnan(apart)]
    found = estimate(apart, unit)
    smaller, larger = (float(side.mean()) if found.count else math.nan for side in (apart < 0.0, apart > 0.0))
    return Difference(
        found.count, found.mean, found.mean_interval, found.iqm, found.iqm_interval, smaller, larger, unit
    )
