"""What a Matplotlib figure shows, as plain texts and numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.colors import to_hex


def entries(figure: Any) -> list[list[Any]]:
    """Return an entry for the figure and each visible artist: a text with its kind and look, and its numbers."""
    whole = [f"figure {to_hex(figure.get_facecolor())}", [*_floats(figure.get_size_inches()), float(figure.dpi)]]
    found = [[f"{place} {words}", numbers] for place, artist in _artists(figure) for words, numbers in _told(artist)]
    return [whole, *found]


def _artists(figure: Any) -> Iterator[tuple[str, Any]]:
    for artist in (*figure.texts, *figure.legends, *figure.lines, *figure.patches):
        yield "figure", artist
    for index, axes in enumerate(figure.axes):
        yield f"{index}", axes
        parts = [axes.title, *axes.lines, *axes.patches, *axes.collections, *axes.texts, *axes.images]
        legend = axes.get_legend()
        for artist in [*parts, *([legend] if legend else [])]:
            if artist.get_visible():
                yield f"{index}", artist


def _told(artist: Any) -> list[tuple[str, list[float]]]:
    kind = type(artist).__name__
    if kind in ("Axes", "Axes3D"):
        return [_axes(artist), *(_side(name, axis) for name, axis in artist._axis_map.items() if artist.axison)]
    if kind == "Legend":
        return [
            _legend(artist),
            *(("legend " + words, numbers) for words, numbers in map(_mark, artist.legend_handles)),
        ]
    return [_mark(artist)]


def _mark(artist: Any) -> tuple[str, list[float]]:
    """Return what a text, line, patch, collection or image shows."""
    if hasattr(artist, "get_text"):
        return _text(artist)
    if hasattr(artist, "get_xdata"):
        return _line(artist)
    if hasattr(artist, "get_offsets"):
        return _collection(artist)
    if hasattr(artist, "get_path"):
        vertices = artist.get_patch_transform().transform(artist.get_path().vertices)
        look = f"{_hex(artist.get_facecolor())} {_hex(artist.get_edgecolor())} {artist.get_label()!r}"
        dashes = _dashes(artist._dash_pattern)
        return f"patch {look} {dashes}", [*summary(vertices.T), artist.get_linewidth(), artist.get_zorder()]
    colours = f"{artist.get_cmap().name} {artist.origin}"
    data = np.ma.filled(np.ma.asarray(artist.get_array(), dtype=float), np.nan)
    return f"{type(artist).__name__} {colours}", [*summary(data.reshape(1, -1)), *_floats(artist.get_clim())]


def _text(text: Any) -> tuple[str, list[float]]:
    place = text.get_position_3d() if hasattr(text, "get_position_3d") else text.get_position()
    look = f"{to_hex(text.get_color())} {text.get_ha()} {text.get_va()} {text.get_weight()}"
    numbers = [*_floats(place), float(text.get_size()), float(text.get_rotation()), float(text.get_zorder())]
    box = text.get_bbox_patch()
    if box is not None:
        look += f" on {_hex(box.get_facecolor())} {_hex(box.get_edgecolor())}"
        numbers += [float(box.get_boxstyle().pad), float(box.get_linewidth())]
    return f"text {look} {text.get_text()!r}", numbers


def _line(line: Any) -> tuple[str, list[float]]:
    data = np.array(line.get_data_3d() if hasattr(line, "get_data_3d") else line.get_data(), dtype=float)
    dashes = f"{line.get_linestyle()} {_dashes(line._dash_pattern)} {line.get_drawstyle()}"
    look = f"{to_hex(line.get_color())} {dashes} {line.get_marker()} {line.get_label()!r}"
    if line.get_marker() not in ("None", None, ""):
        look += f" {_hex(line.get_markerfacecolor())} {_hex(line.get_markeredgecolor())} {line.get_markevery()}"
    widths = [line.get_linewidth(), line.get_zorder(), line.get_markersize(), line.get_markeredgewidth()]
    return f"line {look}", [*summary(data), *map(float, widths), 1.0 if line.get_alpha() is None else line.get_alpha()]


def _collection(artist: Any) -> tuple[str, list[float]]:
    paths = [path.vertices for path in artist.get_paths()]
    vertices = np.concatenate(paths) if paths else np.zeros((0, 2))
    colours = " ".join(map(_hex, (*artist.get_facecolor()[:3], *artist.get_edgecolor()[:3])))
    three = [np.asarray(artist._offsets3d, dtype=float)] if hasattr(artist, "_offsets3d") else []
    shown = [vertices.T, np.asarray(artist.get_offsets(), dtype=float).T, *three, artist.get_facecolor().T]
    dashes = " ".join(_dashes(pattern) for pattern in artist.get_linestyle()[:2])
    look = f"{colours} {artist.get_label()!r} {dashes} {artist.get_cmap().name} {artist.get_capstyle()}"
    sizes = artist.get_sizes() if hasattr(artist, "get_sizes") else []
    return f"{type(artist).__name__} {look}", [
        *(number for part in shown for number in summary(part)), artist.get_zorder(), len(paths),
        *_floats(artist.get_linewidth())[:3], *_floats(sizes)[:3],
    ]  # fmt: skip


def _axes(axes: Any) -> tuple[str, list[float]]:
    limits = [axes.get_xlim(), axes.get_ylim(), *([axes.get_zlim()] if hasattr(axes, "get_zlim") else [])]
    view = [axes.elev, axes.azim, *axes._box_aspect, axes._dist] if hasattr(axes, "elev") else []
    spines = [name for name, spine in axes.spines.items() if spine.get_visible()]
    words = f"{axes.get_xlabel()!r} {axes.get_ylabel()!r} {axes.get_xscale()} {axes.get_yscale()} {axes.axison}"
    aspect = axes.get_aspect() if isinstance(axes.get_aspect(), str) else round(axes.get_aspect(), 4)
    return f"axes {words} {aspect} {_hex(axes.get_facecolor())} {' '.join(spines)}", [
        *_floats(axes.get_position().bounds), *_floats(limits), *_floats(view), float(axes.get_zorder()),
        *_floats(axes.titleOffsetTrans.to_values()[4:]),
    ]  # fmt: skip


def _side(name: str, axis: Any) -> tuple[str, list[float]]:
    """Return the ticks of an axis, their texts, and its grid."""
    ticks = axis.get_major_ticks()
    texts = [tick.label1.get_text() for tick in ticks if tick.label1.get_visible()] if axis.get_ticklabels() else []
    look = {tick.gridline.get_visible() for tick in ticks}
    pads = sorted({(tick.get_pad(), float(tick.label1.get_size()), tick.tick1line.get_markersize()) for tick in ticks})
    pane = axis.pane.get_visible() if hasattr(axis, "pane") else None
    return f"{name} axis {texts} grid {sorted(look)} pane {pane}", [
        *_floats(axis.get_majorticklocs()), axis.labelpad, *_floats(axis.label.get_position()), *_floats(pads)
    ]  # fmt: skip


def _legend(legend: Any) -> tuple[str, list[float]]:
    names = [text.get_text() for text in legend.get_texts()]
    lengths = [legend.columnspacing, legend.handlelength, legend.handletextpad, legend.borderpad, legend.labelspacing]
    size = legend.get_texts()[0].get_size() if names else 0.0
    framed, place = legend.get_frame_on(), legend._loc
    return f"legend {names} {framed} {place} {legend.get_title().get_text()!r}", [
        *_floats(legend.get_bbox_to_anchor().bounds), float(legend._ncols), *_floats(lengths), float(size)
    ]  # fmt: skip


def _hex(colour: Any) -> str:
    """Return a colour with its alpha."""
    return "none" if isinstance(colour, str) and colour == "none" else to_hex(colour, keep_alpha=True)


def _dashes(pattern: Any) -> str:
    """Return the lengths of a line's dashes and gaps as it is drawn."""
    return "solid" if pattern[1] is None else "(" + " ".join(f"{length:.4g}" for length in pattern[1]) + ")"


def _floats(values: Any) -> list[float]:
    return [float(value) for value in np.ravel(values)]


def summary(data: Any) -> list[float]:
    """Return for each row of some data (K, n) its length, and mean, slope, least and largest of what is finite."""
    found: list[float] = []
    for row in np.atleast_2d(np.asarray(data, dtype=float)):
        finite = np.isfinite(row)
        values, place = row[finite], np.linspace(-1.0, 1.0, len(row))[finite]
        found += [float(finite.sum())]
        if len(values):
            found += map(float, (values.mean(), (values * place).mean(), values.min(), values.max()))
    return found
