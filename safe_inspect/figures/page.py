"""`episode_page`: an episode as one self-contained HTML file that needs no network.

The page draws on plain canvases with the scripts of this package. Plotly's script alone has 4.5 MB and would be an
additional dependency; a whole page of this module has 0.05 to 0.3 MB.
"""

from __future__ import annotations

import html
import json
import os
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from safe_inspect.errors import OutputError
from safe_inspect.evaluation.recorder import Trajectory
from safe_inspect.figures.drawing import AXIS_COLOURS, clock, deputy_line, ending, reach_of, speed_limit_of
from safe_inspect.figures.scene import FEW_BURNS, largest_burns, ring_radii, stroke
from safe_inspect.geometry.distance import lengths
from safe_inspect.geometry.picture import BLACK, GREY, VIEW, pieces
from safe_inspect.outputs import new_file
from safe_inspect.types import AnyArray, FloatArray


def episode_page(episode: Trajectory, title: str = "Inspection of a chief") -> str:
    """Return an HTML page that shows an episode: a scene that can be turned, a time slider and charts.

    Args:
        episode: The episode.
        title: Title of the page.
    """
    return page_of(_episode_data(episode), title, "episode_scene.js")


def page_of(data: dict[str, Any], title: str, scene: str) -> str:
    """Return an HTML page.

    Args:
        data: Data that it draws, as plain lists.
        title: Its title.
        scene: File name of the script of its scene.
    """
    folder = files("safe_inspect.figures")
    text, style, script, own = (
        folder.joinpath(name).read_text(encoding="utf-8") for name in ("page.html", "page.css", "page.js", scene)
    )
    written = json.dumps(data, separators=(",", ":"), allow_nan=False)
    parts = {
        "@TITLE@": html.escape(title),
        "@STYLE@": style.strip(),
        "@SCRIPT@": script.strip() + "\n\n" + own.strip(),
        "@DATA@": written.replace("<", "\\u003c"),  # so that no name can end the script element
    }
    for mark, part in parts.items():
        text = text.replace(mark, part)
    return text


def save_page(text: str, path: str | os.PathLike[str]) -> None:
    """Write a page to a file.

    Raises:
        OutputError: The file cannot be written, or its name does not end in .html.
    """
    target = Path(path)
    if target.suffix.lower() not in (".html", ".htm"):
        raise OutputError(f"cannot write the page {os.fspath(path)!r}: its name must end in .html")
    with new_file(path) as work:
        work.write_text(text, encoding="utf-8")


def _episode_data(episode: Trajectory) -> dict[str, Any]:
    """Return the data that the page draws, as plain lists; lengths in metres, times in seconds.

    Numbers are rounded to the precision that a picture can show: positions to a millimetre, speeds to 0.1 mm/s.
    """
    scale, unit = clock(episode)
    rings = ring_radii(reach_of(episode))
    deputies = range(len(episode.deputies))
    reach = max(reach_of(episode), 1.1 * rings[-1])
    turns = "orientation" in episode.arrays
    radius = episode.radius or episode.docking_radius or 1.0
    return {
        "view": {"azimuth": VIEW["azim"], "elevation": VIEW["elev"]},
        "most_zoom": 2.0 * reach / radius,
        "time": rounded(episode.time, 3),
        "unit": unit,
        "unit_seconds": scale,
        "deputies": [{"name": name, **_look(index)} for index, name in enumerate(episode.deputies)],
        "position": [rounded(episode.position[:, index], 3) for index in deputies],
        "delta_v": [rounded(episode.delta_v[:, index], 5) for index in deputies],
        "sun": rounded(episode.sun_angle, 5) if "sun_angle" in episode.arrays else None,
        "beta": rounded(episode.beta_angle, 5) if "beta_angle" in episode.arrays else None,
        "sunlight": rounded(episode.sunlight, 2) if "sunlight" in episode.arrays else None,
        "points": rounded(episode.points, 3),
        "chief": rounded(episode.chief_orientation, 5) if "chief_orientation" in episode.arrays else None,
        "orientation": [rounded(episode.orientation[:, index], 5) for index in deputies] if turns else None,
        "cone": {"axis": list(episode.camera[0]), "half": episode.camera[1]} if episode.camera and turns else None,
        "inspected_at": [round(when, 3) if np.isfinite(when) else None for when in episode.inspected_at.tolist()],
        "inspector": [int(index) for index in episode.inspector],
        "docking_radius": episode.docking_radius,
        "radius": radius,
        "rings": rings,
        "reach": reach,
        "burns": [_burns(episode, index) for index in deputies],
        "charts": _charts(episode),
        "ending": ending(episode),
    }


def _charts(episode: Trajectory) -> list[dict[str, Any]]:
    """Return the charts, each with its label, range of values and lines."""
    deputies = range(len(episode.deputies))
    several = len(episode.deputies) > 1
    lines = [_look(index) for index in deputies]
    limit, norm = speed_limit_of(episode), lengths(episode.thrust)

    def all_of(values: FloatArray, digits: int, **more: Any) -> list[dict[str, Any]]:
        return [{**line, **more, "values": rounded(values[:, i], digits)} for i, line in enumerate(lines)]

    coverage = [{"colour": BLACK, "step": True, "values": rounded(100.0 * episode.coverage, 2)}]
    if several and len(episode.points):
        own = np.stack([100.0 * episode.coverage_of(index) for index in deputies], axis=-1)
        coverage += all_of(own, 2, step=True, width=1.2)
    thrust = (
        all_of(_held(norm), 4, step=True, width=1.1)
        if several
        else [
            {"colour": colour, "step": True, "width": 1.1, "values": rounded(_held(episode.thrust[:, 0, axis]), 4)}
            for axis, colour in enumerate(AXIS_COLOURS)
        ]
    )
    near = episode.range <= reach_of(episode)
    far = None if near.all() else 1.05 * reach_of(episode)
    fast, speeds, label = float(episode.speed[near].max()), all_of(episode.speed, 4), "speed"
    if limit is not None:
        fast, label = max(fast, float(limit[near].max())), "speed; dashed: the largest safe one"
        limits = all_of(limit, 4, width=1.0, dashes=[5, 3])
        speeds += limits if several else [{**line, "colour": GREY} for line in limits]
        above = pieces(episode.speed, episode.speed > limit)
        if np.isfinite(above).any():
            label += "; black: above it"
            speeds += [{**line, "colour": BLACK, "dashes": []} for line in all_of(above, 4, width=2.6)]
    return [
        *([chart("inspected [%]", coverage, low=0.0, high=100.0)] if len(episode.points) else []),
        chart("range [m]", all_of(episode.range, 2), low=0.0, high=far),
        chart(f"{label} [m/s]", speeds, 0.0, None if near.all() else 1.05 * fast),
        chart("norm of thrust [N]" if several else "thrust [N]: x red, y blue, z green", thrust),
        chart("delta-v [m/s]", all_of(episode.delta_v, 5, step=True), low=0.0),
    ]


def chart(label: str, lines: list[dict[str, Any]], low: float | None = None, high: float | None = None) -> Any:
    """Return a chart; a value of None is a gap in its line."""
    values = np.array([value for line in lines for value in line["values"] if value is not None] or [0.0])
    bottom, top = (float(values.min()) if low is None else low), (float(values.max()) if high is None else high)
    room = 0.06 * (top - bottom)
    bottom, top = bottom if low is not None else bottom - room, top if high is not None else top + room
    return {"label": label, "lines": lines, "range": [bottom, top] if top > bottom else [bottom - 1.0, top + 1.0]}


def _burns(episode: Trajectory, deputy: int) -> list[dict[str, Any]]:
    """Return a deputy's largest burns: the step of each, and its stroke as a multiple of the outer ring's radius."""
    largest = float(lengths(episode.thrust).max(initial=0.0))
    found = []
    steps = largest_burns(episode, deputy)
    for step in steps:
        thrust = episode.thrust[step, deputy]
        size = float(lengths(thrust))
        drawn = thrust / size * stroke(size / largest, len(steps) <= FEW_BURNS)
        found.append({"step": int(step), "thrust": rounded(drawn, 4)})
    return found


def _held(values: AnyArray) -> AnyArray:
    """Return the thrust at every state; it is zero at the last state."""
    return np.concatenate((values, np.zeros_like(values[:1])))


def _look(deputy: int) -> dict[str, Any]:
    """Return colour and dashes of a deputy's lines."""
    line = deputy_line(deputy)
    dashes = [] if line["linestyle"] == "-" else [2.0 * float(length) for length in line["linestyle"][1]]
    return {"colour": line["color"], "dashes": dashes}


def rounded(values: AnyArray, digits: int) -> Any:
    """Return rounded values as nested lists; whole numbers become integers, values that are not finite become None."""
    return _plain((np.round(np.asarray(values, dtype=np.float64), digits) + 0.0).tolist())


def _plain(value: Any) -> Any:
    if isinstance(value, list):
        return [_plain(item) for item in value]
    if not np.isfinite(value):
        return None
    return int(value) if value == int(value) else value
