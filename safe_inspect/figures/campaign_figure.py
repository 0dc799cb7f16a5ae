"""The figure of many missions: how many succeeded, and the distributions of their figures."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.evaluation.results.results import Evaluation
from safe_inspect.evaluation.results.tables import ends
from safe_inspect.figures.drawing import Figure, new_figure
from safe_inspect.geometry.picture import BLACK, BLUE, GREY, VERMILION
from safe_inspect.missions.summary import MISSION_FIGURES
from safe_inspect.types import BoolArray, FloatArray

#: Label, figure and factor of the panels, in rows of three.
_PANELS = (
    ("least clearance [cm]", MISSION_FIGURES["least_clearance"][0], 100.0),
    ("position error at the mating point [cm]", MISSION_FIGURES["mating_position_error"][0], 100.0),
    ("velocity error at the mating point [mm/s]", MISSION_FIGURES["mating_speed_error"][0], 1000.0),
    ("delta-v [m/s]", "delta-v", 1.0),
    ("largest share of the tube's half width", MISSION_FIGURES["largest_gauge"][0], 1.0),
    ("time [s]", MISSION_FIGURES["time"][0], 1.0),
)
#: Ratio of the largest to the median value above which a panel's axis is logarithmic.
_SPREAD = 20.0
_MOST_CAUSES = 3


def campaign_figure(evaluation: Evaluation) -> Figure:
    """Draw the missions of one experiment.

    Each panel shows the share of the missions, in per cent, whose value is at most that on the horizontal axis: the
    successful ones as a curve, the failed ones as marks on the axis. Above the panels are the success rate with its
    interval and the causes of failure.

    Args:
        evaluation: An evaluation of a rendezvous.

    Raises:
        SafeInspectError: Matplotlib is not installed.
    """
    with new_figure(10.0, 5.4) as figure:
        panels = figure.subplots(2, 3, sharey=True)
        figure.subplots_adjust(left=0.065, right=0.985, top=0.84, bottom=0.1, hspace=0.38, wspace=0.1)
        won = evaluation.team.status == "win"
        for axes, (label, name, factor) in zip(panels.flat, _PANELS, strict=True):
            _draw_distribution(axes, factor * evaluation.team.figures[name], won)
            axes.set_xlabel(label)
        for axes in panels[:, 0]:
            axes.set(ylabel="missions [%]", ylim=(0.0, 102.0), yticks=(0, 25, 50, 75, 100))
        title = f"{len(evaluation)} missions, {ends(evaluation.team)}"
        figure.text(0.065, 0.965, title, fontsize=11, color=BLACK, va="top")
        figure.text(0.065, 0.91, _causes(evaluation), fontsize=9, color=VERMILION, va="top")
    return figure


def _causes(evaluation: Evaluation) -> str:
    causes = evaluation.losses
    named = [f"{times} failed: {cause}" for cause, times in causes[:_MOST_CAUSES]]
    rest = sum(times for _, times in causes[_MOST_CAUSES:])
    return "; ".join([*named, f"{rest} for other causes"] if rest else named)


def _draw_distribution(axes: Any, values: FloatArray, won: BoolArray) -> None:
    known = np.isfinite(values)
    found, good = values[known], won[known]
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
