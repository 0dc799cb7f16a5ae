"""The figure of many missions: how many succeeded, and the distribution of what each left."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from safe_inspect.figures.drawing import style
from safe_inspect.geometry.picture import BLACK, BLUE, GREY, VERMILION
from safe_inspect.rendezvous.missions.tables import rate_of_success

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Label, key and factor of the panels, in rows of three.
_PANELS = (
    ("least clearance [cm]", "least_clearance", 100.0),
    ("position error at the mating point [cm]", "mating_position_error", 100.0),
    ("velocity error at the mating point [mm/s]", "mating_speed_error", 1000.0),
    ("delta-v [m/s]", "delta_v", 1.0),
    ("largest share of the tube's half width", "largest_gauge", 1.0),
    ("time [s]", "time", 1.0),
)
#: Ratio of largest to median value above which a panel's scale is logarithmic.
_SPREAD = 20.0
_MOST_CAUSES = 3


def campaign_figure(summaries: Sequence[dict[str, Any]]) -> Figure:
    """Draw the missions of one experiment.

    Each panel has the share of the missions, in per cent, whose value is at most that below: the successful ones as a
    curve, the failed ones as marks on the axis. Above are the rate of success with its interval of Clopper and Pearson
    and the causes of failure.

    Args:
        summaries: The summaries of the missions.

    Raises:
        SafeInspectError: Matplotlib is not installed.
    """
    with style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(10.0, 5.4), facecolor="white")
        panels = figure.subplots(2, 3, sharey=True)
        figure.subplots_adjust(left=0.065, right=0.985, top=0.84, bottom=0.1, hspace=0.38, wspace=0.1)
        for axes, (label, key, factor) in zip(panels.flat, _PANELS, strict=True):
            _draw_distribution(axes, summaries, key, factor)
            axes.set_xlabel(label)
        for axes in panels[:, 0]:
            axes.set(ylabel="missions [%]", ylim=(0.0, 102.0), yticks=(0, 25, 50, 75, 100))
        figure.text(0.065, 0.965, rate_of_success(summaries), fontsize=11, color=BLACK, va="top")
        figure.text(0.065, 0.91, _causes(summaries), fontsize=9, color=VERMILION, va="top")
    return figure


def _causes(summaries: Sequence[dict[str, Any]]) -> str:
    causes = Counter(str(summary["cause"]) for summary in summaries if not summary["success"]).most_common()
    named = [f"{times} failed: {cause}" for cause, times in causes[:_MOST_CAUSES]]
    rest = sum(times for _, times in causes[_MOST_CAUSES:])
    return "; ".join([*named, f"{rest} for other causes"] if rest else named)


def _draw_distribution(axes: Any, summaries: Sequence[dict[str, Any]], key: str, factor: float) -> None:
    values, succeeded = [], []
    for summary in summaries:
        value = summary.get(key)
        if value is not None and np.isfinite(value):
            values.append(factor * value)
            succeeded.append(bool(summary["success"]))
    found, good = np.array(values), np.array(succeeded, dtype=bool)
    own = np.sort(found[good])
    if len(own):
        share = 100.0 * np.arange(len(own) + 1) / len(own)
        axes.step(np.append(own[0], own), share, where="post", color=BLUE)
        axes.axvline(float(np.median(own)), color=GREY, linewidth=0.8, linestyle=(0, (4, 2)))
    for value in found[~good]:
        axes.plot([value, value], [0.0, 5.0], color=VERMILION, linewidth=1.4)
    if len(found) and found.min() > 0.0 and found.max() > _SPREAD * np.median(found):
        axes.set_xscale("log")
    if not len(found):
        axes.set_xticks(())
