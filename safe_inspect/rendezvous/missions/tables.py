"""The tables of missions: of one, and of a campaign with exact intervals and the causes of failure."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from safe_inspect.rendezvous.missions.folder import MISSION_NUMBER

#: Label, key, factor and unit of the numbers in tables.
_FIGURES = (
    ("time", "time", 1.0, "s"),
    ("time on the approach", "time_on_approach", 1.0, "s"),
    ("rate of the tumble at the start", "tumble_rate", math.degrees(1.0), "deg/s"),
    ("least clearance", "least_clearance", 100.0, "cm"),
    ("position error at the mating point", "mating_position_error", 100.0, "cm"),
    ("velocity error at the mating point", "mating_speed_error", 1000.0, "mm/s"),
    ("delta-v", "delta_v", 1.0, "m/s"),
    ("largest force", "largest_force", 1.0, "N"),
    ("largest gauge of the tube", "largest_gauge", 1.0, ""),
    ("plans", "plans", 1, ""),
    ("planning time", "planning_time", 1.0, "s"),
    ("excursion from the keep-in box", "keep_in_excursion", 100.0, "cm"),
    ("speed at the end", "final_speed", 1000.0, "mm/s"),
    ("range at the end", "final_range", 1.0, "m"),
)
#: How many failed missions of a campaign are shown one by one.
_MOST_SHOWN = 20


def interval(successes: int, count: int, level: float = 0.95) -> tuple[float, float]:
    """Return the interval of Clopper and Pearson (1934) of a probability.

    Args:
        successes: Number of successes.
        count: Number of trials.
        level: Least probability that the interval holds the true value.
    """
    from scipy.stats import binomtest  # slow to import

    found = binomtest(successes, count).proportion_ci(level, "exact")
    return float(found.low), float(found.high)


def rate_of_success(summaries: Sequence[dict[str, Any]]) -> str:
    """Return how many missions succeeded, with the interval of the probability, in a line."""
    return _rate(summaries, "missions succeeded: ")


def mission_table(summary: dict[str, Any]) -> str:
    """Return the table of one mission."""
    outcome = "success" if summary["success"] else f"failed: {_cause(summary)}"
    lines = [outcome]
    for label, key, factor, unit in _FIGURES:
        value = summary.get(key)
        lines.append(f"  {label:<36}{'-' if value is None else f'{factor * value:.3g} {unit}'.strip()}")
    return "\n".join(lines)


def missions_table(summaries: Sequence[dict[str, Any]]) -> str:
    """Return the table of several missions: the rate of success, quantiles, classes of tumbles, and the failures."""
    lines = [rate_of_success(summaries), f"  {'':<36}{'median':>10}{'least':>10}{'largest':>10}"]
    for label, key, factor, unit in _FIGURES:
        values = np.array([summary[key] for summary in summaries if summary.get(key) is not None], dtype=np.float64)
        if len(values):
            shown = "".join(f"{factor * value:>10.3g}" for value in (np.median(values), values.min(), values.max()))
            lines.append(f"  {label:<36}{shown} {unit}")
    classes: dict[str, list[dict[str, Any]]] = {}
    for summary in summaries:
        for name in tumble_classes(summary):
            classes.setdefault(name, []).append(summary)
    lines += [f"  tumble {name:<29}{_rate(classes[name], '')}" for name in sorted(classes)]
    failed = [summary for summary in summaries if not summary["success"]]
    for cause, times in Counter(summary["cause"] for summary in failed).most_common():
        numbers = [str(summary[MISSION_NUMBER]) for summary in failed if summary["cause"] == cause]
        lines.append(f"  {times} failed: {cause} (missions {', '.join(numbers[:10])}{', ...' if times > 10 else ''})")
    for summary in failed[:_MOST_SHOWN]:
        classes_of = ", ".join(tumble_classes(summary))
        lines.append(
            f"    mission {summary[MISSION_NUMBER]} at {summary['time']:.1f} s: {_cause(summary)} [{classes_of}]"
        )
    return "\n".join(lines)


def tumble_classes(summary: dict[str, Any]) -> tuple[str, str]:
    """Return the classes of a mission's tumble: the axis it turns about, and its rate to whole degrees per second."""
    axis, rate = summary["tumble_axis"], math.degrees(summary["tumble_rate"])
    low = math.floor(rate + 1e-9)
    return f"about axis {axis}" if axis else "of constant rate", f"at {low} to {low + 1} deg/s"


def _cause(summary: dict[str, Any]) -> str:
    """Return why a mission has failed, with what the last plan or tube was refused for."""
    detail = summary.get("detail")
    return f"{summary['cause']} ({detail})" if detail else str(summary["cause"])


def _rate(summaries: Sequence[dict[str, Any]], about: str) -> str:
    """Return how many missions of some succeeded, with the exact interval."""
    count, successes = len(summaries), sum(bool(summary["success"]) for summary in summaries)
    low, high = interval(successes, count)
    share = f"{100 * successes / count:.1f} % (95 % interval {100 * low:.1f} to {100 * high:.1f} %)"
    return f"{successes} of {count} {about}{share}"
