"""Figures of run-time assurance: the constraints of the worst episode, and the accepted initial states."""

from __future__ import annotations

import numpy as np

from safe_inspect.evaluation.safety_report import Acceptance, SafetyReport
from safe_inspect.figures.drawing import Figure, new_figure
from safe_inspect.geometry.picture import BLUE, GREY, VERMILION
from safe_inspect.tasks.inspection.sun import sun_directions
from safe_inspect.types import FloatArray


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


def acceptance_figure(found: Acceptance) -> Figure:
    """Draw the distributions of sampled and of accepted initial states: range, speed, range rate and angle to the sun.

    Raises:
        KeyError: The sampler does not provide position, velocity or sun angle.
    """
    with new_figure(8.0, 4.8, layout="constrained") as figure:
        panels = figure.subplots(2, 2)
        for axes, (label, values) in zip(panels.flat, _marginals(found).items(), strict=True):
            edges = np.linspace(values.min(), values.max(), 41)
            axes.hist(values, edges, color=GREY, alpha=0.45, label="drawn")
            axes.hist(values[found.accepted], edges, histtype="step", color=BLUE, linewidth=1.4, label="accepted")
            axes.set_xlabel(label)
            axes.set_ylabel("draws")
        panels[0, 0].legend(loc="lower right")
    return figure


def _marginals(found: Acceptance) -> dict[str, FloatArray]:
    position, velocity = found.states["position"], found.states["velocity"]
    distance = np.sqrt(np.square(position).sum(axis=-1))
    cosine = (position * sun_directions(found.states["sun_angle"])).sum(axis=-1) / distance
    return {
        "range [m]": distance,
        "speed [m/s]": np.sqrt(np.square(velocity).sum(axis=-1)),
        "range rate [m/s]": (position * velocity).sum(axis=-1) / distance,
        "angle between deputy and sun, from the chief [deg]": np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))),
    }
