"""Figure of run-time assurance: the constraints of the worst episode."""

from __future__ import annotations

import numpy as np

from safe_inspect.evaluation.safety_report import SafetyReport
from safe_inspect.figures.drawing import Figure, new_figure
from safe_inspect.geometry.picture import BLUE, VERMILION


def safety_figure(report: SafetyReport) -> Figure:
    """Draw every constraint's plain safety quantity over time, for the environment that came nearest to a violation."""
    rows = -(-len(report.names) // 2)
    with new_figure(8.0, 1.35 * rows + 0.4, layout="constrained") as figure:
        panels = figure.subplots(rows, 2, sharex=True, squeeze=False)
        hours = np.arange(len(report.worst)) * report.step_size / 3600.0
        for axes, name, unit, values in zip(panels.flat, report.names, report.units, report.worst.T, strict=False):
            axes.axhline(0.0, color=VERMILION, linewidth=0.9)
            axes.plot(hours, values, color=BLUE, linewidth=0.9)
            axes.set_ylabel(f"{name}\n[{unit}]")
        for axes in panels.flat[len(report.names) :]:
            axes.set_axis_off()
        for axes in panels[-1]:
            axes.set_xlabel("time [h]")
        figure.suptitle("safety quantities at the steps; unsafe below the red line", fontsize=9.5)
    return figure
