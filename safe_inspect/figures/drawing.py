"""Common parts of all figures: lazy import of Matplotlib, colours and font sizes.

Figures are made without pyplot, so that none stays in memory and no display is needed.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from safe_inspect.errors import OutputError, SafeInspectError
from safe_inspect.geometry.picture import BLACK, DEPUTY_COLOURS, GREY, PALE
from safe_inspect.outputs import new_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: File name endings that `save` supports.
FIGURE_ENDINGS = (".png", ".pdf", ".svg")
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


def deputy_line(index: int) -> dict[str, Any]:
    """Return colour and dashes of a deputy's lines; after five deputies the colours repeat with other dashes."""
    return {
        "color": DEPUTY_COLOURS[index % len(DEPUTY_COLOURS)],
        "linestyle": ("-", (0, (4, 1.5)), (0, (1, 1)))[index // len(DEPUTY_COLOURS) % 3],
    }


def deputy_marker(index: int) -> str:
    """Return the marker of the points that a deputy has inspected."""
    return ("o", "^", "s")[index // len(DEPUTY_COLOURS) % 3]


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


def save(figure: Figure, path: str | os.PathLike[str], dpi: int = 150) -> None:
    """Write a figure to a file; the ending of its name determines the format (png, pdf, svg).

    Raises:
        OutputError: The file cannot be written, or the format is unknown.
    """
    try:
        with new_file(path) as work, style():
            figure.savefig(work, dpi=dpi)
    except ValueError as error:  # raised for an unknown format
        raise OutputError(f"{os.fspath(path)}: the file cannot be written ({error}); give another file") from None
