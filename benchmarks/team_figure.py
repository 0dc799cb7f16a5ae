"""Figure of the distance of the closest pair of deputies, under filters that decide together or apart."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from team_safety import TeamReport

from safe_inspect.figures.drawing import style
from safe_inspect.geometry.picture import BLACK, BLUE, GREY, ORANGE, VERMILION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LINES = {
    "none": (GREY, ":", "no filter"),
    "decentralised": (ORANGE, "--", "decentralised: others are assumed to coast"),
    "centralised": (BLUE, "-", "centralised: one decision for all"),
}


def team_safety_figure(reports: Sequence[TeamReport], apart: float) -> Figure:
    """Draw which share of the runs came closer than a distance: one line for each filter.

    Args:
        reports: What `team_report` gave, of two deputies at least.
        apart: Distance below which two deputies collide [m].
    """
    with style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(7.0, 3.6), facecolor="white", layout="constrained")
        axes = figure.subplots()
        right = 0.0
        for report in reports:
            colour, dashes, label = _LINES[report.kind]
            closest = np.sort(report.closest)
            share = 100.0 * np.arange(1, len(closest) + 1) / len(closest)
            broken = int((closest < apart).sum())
            label += f" ({broken:,} of {len(closest):,} runs collide)"
            axes.step(closest, share, where="post", color=colour, linestyle=dashes, label=label)
            right = max(right, float(np.quantile(closest, 0.95)))
        axes.axvspan(0.0, apart, color=VERMILION, alpha=0.10, linewidth=0.0)
        axes.axvline(apart, color=VERMILION, linewidth=1.0)
        axes.text(0.5 * apart, 97.0, "collision", color=BLACK, fontsize=8.0, ha="center", va="top")
        axes.set_xlim(0.0, min(right, 6.0 * apart))
        axes.set_ylim(0.0, 100.0)
        axes.set_xlabel("distance of the closest pair in a run, at the steps and between them [m]")
        axes.set_ylabel("runs that came closer [%]")
        axes.legend(loc="lower right")
    return figure
