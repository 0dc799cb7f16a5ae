"""`mission_page`: a rendezvous as one self-contained HTML file that needs no network."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.dynamics.quaternion import to_matrix
from safe_inspect.figures.drawing import AXIS_COLOURS
from safe_inspect.figures.mission_figure import outcome_of, tracking_error
from safe_inspect.figures.mission_scene import (
    CAMERA,
    FLIGHT,
    MATING,
    PHASE_COLOURS,
    PLANNED,
    TUBE,
    DrawnSolid,
    best_view,
    camera_cone,
)
from safe_inspect.figures.page import chart, page_of, rounded
from safe_inspect.geometry.picture import BLACK, GREY
from safe_inspect.missions.record import MissionRecord
from safe_inspect.missions.summary import true_reference
from safe_inspect.types import AnyArray

#: Largest number of states in a page; of longer missions it contains every second, third, ... state.
_MOST_STATES = 3000
_DASHES = [5, 3]


def mission_page(record: MissionRecord, title: str = "Rendezvous") -> str:
    """Return an HTML page that shows a mission: phases, charts, and a scene in W or in the target's axes.

    Args:
        record: The mission.
        title: Title of the page.
    """
    return page_of(mission_data(record), title, "mission_scene.js")


def mission_data(record: MissionRecord) -> dict[str, Any]:
    """Return the data that the page draws, as plain lists; lengths in metres, times in seconds.

    Positions are rounded to 0.1 mm, quaternions to 1e-5.
    """
    arrays, solid, radius = record.arrays, DrawnSolid.of_target(record), record.config.chaser.radius
    count = len(arrays["t"])
    rows = np.unique(np.append(np.arange(0, count, -(-count // _MOST_STATES)), count - 1))
    shown = slice(record.approach(), None)
    view = best_view(arrays["x"][shown, :3], solid, to_matrix(arrays["target_q"][-1]))
    reach = radius + max(record.target.swept_radius, float(np.linalg.norm(arrays["x"][:, :3], axis=1).max()))
    return {
        "view": {
            "azimuth": round(float(np.degrees(np.arctan2(view.sight[1], view.sight[0]))), 3),
            "elevation": round(float(np.degrees(np.arcsin(view.sight[2]))), 3),
        },
        "most_zoom": 12.0,
        "reach": round(reach, 3),
        "time": rounded(arrays["t"][rows] - arrays["t"][0], 3),
        "unit": "s",
        "unit_seconds": 1.0,
        "position": rounded(arrays["x"][rows, :3], 4),
        "body": rounded(arrays["q"][rows], 5),
        "attitude": rounded(arrays["target_q"][rows], 5),
        "reference": rounded(np.where(np.isfinite(arrays["tube"])[:, None], true_reference(arrays), np.nan)[rows], 4),
        "tube": rounded(arrays["tube"][rows], 4),
        "distance": rounded(record.mating_distance()[rows], 4),
        "plans": [
            {
                "start": round(float(plan.times[0]), 3),
                "position": rounded(plan.position[::2], 4),
                "position_target": rounded(plan.position_target[::2], 4),
            }
            for plan in record.plans
        ],
        "target": {**_solid(solid), "radius": round(record.target.swept_radius, 4)},
        "chaser": {**_solid(DrawnSolid.of_chaser(record)), "radius": radius, "cone": rounded(camera_cone(record), 4)},
        "mating_point": rounded(record.target.mating_point, 4),
        "bands": [
            {"start": start, "end": end, "name": phase.value, "colour": PHASE_COLOURS.get(phase, GREY)}
            for phase, start, end in record.phases()
        ],
        "colours": {"flight": FLIGHT, "plan": PLANNED, "tube": TUBE, "mating": MATING, "camera": CAMERA},
        "charts": _charts(record, rows),
        "ending": outcome_of(record),
    }


def _solid(solid: DrawnSolid) -> dict[str, Any]:
    return {name: rounded(getattr(solid, name), 4) for name in solid._fields}


def _charts(record: MissionRecord, rows: AnyArray) -> list[dict[str, Any]]:
    arrays, limit = record.arrays, record.config.chaser.limits.force

    def line(values: AnyArray, colour: str, digits: int, **more: Any) -> dict[str, Any]:
        return {"colour": colour, "values": rounded(values[rows], digits), "width": 1.2, **more}

    tube, spare = 100.0 * arrays["tube"], limit - arrays["tube_force"]
    error = tracking_error(arrays)
    edges = [line(sign * tube, GREY, 4, dashes=_DASHES) for sign in (-1.0, 1.0)]
    limits = [line(sign * spare, GREY, 4, dashes=_DASHES) for sign in (-1.0, 1.0)]
    axes, force = list(enumerate(AXIS_COLOURS)), record.force_in_inertial()
    return [
        chart(
            "clearance, and the margin of the tube (dashed) [m]",
            [line(arrays["clearance"], FLIGHT, 4, width=1.6), line(arrays["margin"], GREY, 4, dashes=_DASHES)],
            low=min(0.0, float(arrays["clearance"].min())),
        ),
        chart("distance from the mating point [m]", [line(record.mating_distance(), BLACK, 4)], low=0.0),
        chart(
            "error from the reference: x red, y blue, z green; tube (dashed) [cm]",
            [*(line(100.0 * error[:, k], colour, 4) for k, colour in axes), *edges],
        ),
        chart(
            "force, and its limit less the tube's share (dashed) [N]",
            [*(line(force[:, k], colour, 4, step=True) for k, colour in axes), *limits],
            low=-limit,
            high=limit,
        ),
    ]
