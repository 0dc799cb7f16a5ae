"""What a Matplotlib figure shows, as plain texts and numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.colors import to_hex


def entries(figure: Any) -> list[list[Any]]:
    """Return an entry for each visible artist of a figure: a text that tells its kind and look, and its numbers."""
    return [[f"{place} {words}", numbers] for place, artist in _artists(figure) for words, numbers in [_told(artist)]]


def _artists(figure: Any) -> Iterator[tuple[str, Any]]:
    for text in figure.texts:
        yield "figure", text
    for legend in figure.legends:
        yield "figure", legend
    for index, axes in enumerate(figure.axes):
        yield f"{index}", axes
        parts = [axes.title, *axes.lines, *axes.patches, *axes.collections, *axes.texts, *axes.images]
        legend = axes.get_legend()
        for artist in [*parts, *([legend] if legend else [])]:
            if artist.get_visible():
                yield f"{index}", artist


def _told(artist: Any) -> tuple[str, list[float]]:
    kind = type(artist).__name__
    told = {"Axes": _axes, "Axes3D": _axes, "Legend": _legend}.get(kind)
    if told is not None:
        return told(artist)
    if hasattr(artist, "get_text"):
        place = artist.get_position_3d() if hasattr(artist, "get_position_3d") else artist.get_position()
        look = f"{to_hex(artist.get_color())} {artist.get_ha()} {artist.get_va()}"
        return f"text {look} {artist.get_text()!r}", [*_floats(place), float(artist.get_size())]
    if hasattr(artist, "get_xdata"):
        data = np.array(artist.get_data_3d() if hasattr(artist, "get_data_3d") else artist.get_data(), dtype=float)
        look = f"{to_hex(artist.get_color())} {artist.get_linestyle()} {artist.get_marker()} {artist.get_label()!r}"
        return f"line {look}", [*summary(data), artist.get_linewidth(), artist.get_zorder(), artist.get_markersize()]
    if hasattr(artist, "get_offsets"):
        paths = [path.vertices for path in artist.get_paths()]
        vertices = np.concatenate(paths) if paths else np.zeros((0, 2))
        colours = " ".join(to_hex(colour) for colour in artist.get_facecolor()[:3])
        three = [np.asarray(artist._offsets3d, dtype=float)] if hasattr(artist, "_offsets3d") else []
        shown = [vertices.T, np.asarray(artist.get_offsets(), dtype=float).T, *three, artist.get_facecolor().T]
        return f"{kind} {colours} {artist.get_label()!r}", [
            *(number for part in shown for number in summary(part)), artist.get_zorder(),
            *_floats(artist.get_linewidth()),
        ]  # fmt: skip
    if hasattr(artist, "get_path"):
        vertices = artist.get_patch_transform().transform(artist.get_path().vertices)
        look = f"{to_hex(artist.get_facecolor())} {to_hex(artist.get_edgecolor())} {artist.get_label()!r}"
        return f"patch {look}", [*summary(vertices.T), artist.get_linewidth(), artist.get_zorder()]
    return kind, summary(np.atleast_2d(np.asarray(artist.get_array(), dtype=float)))


def _axes(axes: Any) -> tuple[str, list[float]]:
    limits = [axes.get_xlim(), axes.get_ylim(), *([axes.get_zlim()] if hasattr(axes, "get_zlim") else [])]
    view = [axes.elev, axes.azim] if hasattr(axes, "elev") else []
    words = f"{axes.get_xlabel()!r} {axes.get_ylabel()!r} {axes.get_xscale()} {axes.get_yscale()} {axes.axison}"
    marks = [*axes.get_xticks(), *axes.get_yticks()] if axes.axison else []
    return f"axes {words}", [
        *_floats(axes.get_position().bounds), *_floats(limits), *_floats(view), *summary(np.atleast_2d(marks))
    ]  # fmt: skip


def _legend(legend: Any) -> tuple[str, list[float]]:
    names = [text.get_text() for text in legend.get_texts()]
    return f"legend {names}", [*_floats(legend.get_bbox_to_anchor().bounds), float(legend._ncols)]


def _floats(values: Any) -> list[float]:
    return [float(value) for value in np.ravel(values)]


def summary(data: Any) -> list[float]:
    """Return for each row of some data (K, n) its length, and mean and slope of what is finite."""
    found = []
    for row in np.atleast_2d(np.asarray(data, dtype=float)):
        finite = np.isfinite(row)
        values, place = row[finite], np.linspace(-1.0, 1.0, len(row))[finite]
        found += [float(finite.sum()), float(values.mean()) if len(values) else 0.0]
        found += [float((values * place).mean()) if len(values) else 0.0]
    return found
