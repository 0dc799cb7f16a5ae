"""The figure of a training: return, success, inspected points and delta-v over the environment steps."""

from __future__ import annotations

import csv
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from safe_inspect.errors import SafeInspectError, did_you_mean
from safe_inspect.figures.drawing import style
from safe_inspect.geometry.picture import BLUE, GREY, ORANGE
from safe_inspect.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Column of progress.csv with the number of environment steps.
STEPS = "steps"
#: Column of progress.csv, label, factor.
PANELS = (
    ("return_mean", "return [-]", 1.0),
    ("success_rate", "success [%]", 100.0),
    ("inspected_fraction", "inspected [%]", 100.0),
    ("delta_v", "delta-v [m/s]", 1.0),
)


def read_learning_curve(path: str | os.PathLike[str]) -> dict[str, FloatArray]:
    """Return the columns of a ``progress.csv`` by name; an empty cell is NaN.

    Raises:
        SafeInspectError: The file is missing or damaged, has no rows, or lacks a column that is drawn.
    """
    try:
        with Path(path).open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            rows, names = list(reader), tuple(reader.fieldnames or ())
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SafeInspectError(f"cannot read {os.fspath(path)!r}: {error}") from None
    missing = [name for name in (STEPS, *(column for column, _, _ in PANELS)) if name not in names]
    if missing:
        near = did_you_mean(missing[0], names)
        hint = f"; {near}" if near.startswith("did you mean") else ""
        raise SafeInspectError(
            f"{os.fspath(path)!r} is not the progress.csv of a training: it has no column `{missing[0]}`{hint}"
        )
    if not rows:
        raise SafeInspectError(f"{os.fspath(path)!r} has no rows yet; wait for the first iteration")
    columns = {
        name: np.array([_number(path, line, name, row.get(name)) for line, row in enumerate(rows, 2)]) for name in names
    }
    steps = columns[STEPS]
    back = np.flatnonzero(~(np.diff(steps) >= 0.0))
    if not np.isfinite(steps[0]) or len(back):
        line = int(back[0]) + 3 if np.isfinite(steps[0]) else 2
        raise SafeInspectError(
            f"{os.fspath(path)}:{line}: the file is damaged: `{STEPS}` must not decrease from row to row"
        )
    return columns


def _number(path: str | os.PathLike[str], line: int, name: str, cell: str | None) -> float:
    try:
        return float(cell or "nan")
    except ValueError:
        message = f"{os.fspath(path)}:{line}: the file is damaged: `{name}` is {cell!r:.40}, not a number"
        raise SafeInspectError(message) from None


def learning_curve_figure(progress: str | os.PathLike[str]) -> Figure:
    """Draw a training from its ``progress.csv``; evaluations are drawn as points if the file has any.

    Raises:
        SafeInspectError: The file cannot be read, or Matplotlib is not installed.
    """
    columns = read_learning_curve(progress)
    with style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(8.0, 4.8), facecolor="white", layout="constrained")
        panels = figure.subplots(2, 2, sharex=True)
        scale, unit = step_unit(columns[STEPS])
        steps = columns[STEPS] / scale
        for axes, (name, label, factor) in zip(panels.flat, PANELS, strict=True):
            lines = [_draw(axes, steps, columns[name] * factor, "training", color=BLUE)]
            evaluated = columns.get(f"evaluation_{name}")
            if evaluated is not None:
                lines.append(
                    _draw(axes, steps, evaluated * factor, "evaluation", color=ORANGE, marker="o", linestyle="")
                )
            if not any(lines):
                axes.text(0.5, 0.5, "no episode has ended", transform=axes.transAxes, ha="center", color=GREY)
            axes.set_ylabel(label)
            if factor == 100.0:
                axes.set_ylim(-3, 103)
        for axes in panels[1]:
            axes.set_xlabel(f"environment steps{unit}")
        if len(panels[0, 0].get_lines()) > 1:
            panels[0, 0].legend(loc="best")
    return figure


def _draw(axes: Any, steps: FloatArray, values: FloatArray, label: str, **kwargs: Any) -> bool:
    """Draw the known values of a curve and return whether there are any; a single value is drawn as a dot."""
    known = np.isfinite(values) & np.isfinite(steps)
    if not known.any():
        return False
    if known.sum() == 1:
        kwargs.setdefault("marker", "o")
    axes.plot(steps[known], values[known], label=label, markersize=4, **kwargs)
    return True


def step_unit(steps: FloatArray) -> tuple[float, str]:
    """Return the number by which a figure divides steps, and the corresponding text for the axis label."""
    largest = np.nanmax(steps, initial=0.0)
    if largest >= 2e6:
        return 1e6, " [millions]"
    return (1e3, " [thousands]") if largest >= 2e3 else (1.0, "")
