"""Common parts of all figures: lazy import of Matplotlib, colours and font sizes.

Figures are made without pyplot, so that none stays in memory and no display is needed.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.errors import OutputError, SafeInspectError
from safe_inspect.evaluation.recorder import Trajectory
from safe_inspect.geometry.picture import BLACK, BLUE, DEPUTY_COLOURS, GREEN, GREY, PALE, VERMILION
from safe_inspect.outputs import new_file
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Figure
else:
    Figure = Any  # so that other modules can name the class, which is loaded only when a figure is drawn

#: File name endings that `save` supports.
FIGURE_ENDINGS = (".png", ".pdf", ".svg")
#: Colours of quantities along x, y and z.
AXIS_COLOURS = (VERMILION, BLUE, GREEN)
#: Colour map that is perceptually uniform and readable in grey and for colour-blind people.
SEQUENTIAL = "viridis"

_STYLE: Any = {
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "axes.edgecolor": GREY,
    "axes.labelcolor": BLACK,
    "axes.linewidth": 0.7,
    "xtick.color": BLACK,
    "ytick.color": BLACK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": PALE,
    "grid.linewidth": 0.5,
    "axes.axisbelow": True,
    "lines.linewidth": 1.4,
    "legend.frameon": False,
}

_FARTHEST = 1000.0
_ENDINGS = {DoneStatus.WIN: "success", DoneStatus.LOSE: "lost", DoneStatus.DRAW: "neither won nor lost"}


def deputy_line(index: int) -> dict[str, Any]:
    """Return colour and dashes of a deputy's lines; after five deputies the colours repeat with other dashes."""
    return {
        "color": DEPUTY_COLOURS[index % len(DEPUTY_COLOURS)],
        "linestyle": ("-", (0, (4, 1.5)), (0, (1, 1)))[index // len(DEPUTY_COLOURS) % 3],
    }


def require_matplotlib() -> None:
    """Raise an error if Matplotlib is not installed.

    Raises:
        SafeInspectError: Matplotlib is not installed.
    """
    try:
        import matplotlib  # noqa: F401
    except ModuleNotFoundError as error:
        if error.name != "matplotlib":
            raise
        message = "figures need Matplotlib; install it with: pip install 'safe_inspect[plot]'"
        raise SafeInspectError(message) from None


def style() -> Any:
    """Return a context in which figures have the common style.

    Raises:
        SafeInspectError: Matplotlib is not installed.
    """
    require_matplotlib()
    import matplotlib

    return matplotlib.rc_context(_STYLE)


@contextmanager
def new_figure(width: float, height: float, **more: Any) -> Iterator[Figure]:
    """Return a context with a new figure, in which it is drawn in the common style.

    Args:
        width: Width [inches].
        height: Height [inches].
        **more: Further arguments of Matplotlib's class.

    Raises:
        SafeInspectError: Matplotlib is not installed.
    """
    with style():
        from matplotlib.figure import Figure

        yield Figure(figsize=(width, height), facecolor="white", **more)


def save(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a figure to a file; the ending of its name determines the format (png, pdf, svg).

    Raises:
        OutputError: The file cannot be written, or the format is unknown.
    """
    try:
        with new_file(path) as work, style():
            figure.savefig(work, dpi=150)
    except ValueError as error:  # raised for an unknown format
        raise OutputError(f"{os.fspath(path)}: the file cannot be written ({error}); give another file") from None


def clock(episode: Trajectory) -> tuple[float, str]:
    """Return the unit of time of the figure, in seconds, and its symbol."""
    return (3600.0, "h") if episode.time[-1] >= 86_400.0 else (60.0, "min")


def reach_of(episode: Trajectory) -> float:
    """Return the largest range that is shown [m].

    A deputy that drifts far away would make everything else too small, so ranges are shown up to 1 km, or 1.5 times the
    deputies' largest range at the start if that is more.
    """
    most = max(_FARTHEST, 1.5 * float(episode.range[0].max()))
    return float(episode.range[episode.range <= most].max())


def ending(episode: Trajectory) -> str:
    """Return how an episode ended, in words; empty while it is running."""
    return _ENDINGS.get(episode.status, "")


def speed_limit_of(episode: Trajectory) -> FloatArray | None:
    """Return the largest safe speed at each deputy's range [m/s], shape (T + 1, D); None without a chief in orbit.

    It is the task's ``speed_limit`` if a component records it, else the published limit for inspection, v0 + 2 n (r -
    d0): 0.2 m/s at 10 m, increasing by twice the mean motion per metre.
    """
    if not episode.mean_motion:
        return None
    if "speed_limit" in episode.arrays:
        return episode.arrays["speed_limit"]
    limit = ConstraintParameters(n=episode.mean_motion)
    return np.asarray(limit.v0 + limit.v1 * (episode.range - limit.speed_distance))
