"""The metrics of a mission with their labels and units, and a table of them."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

#: Label and unit of the metrics of a summary, by key, without delta-v [m/s], a metric of every episode.
MISSION_FIGURES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "time": ("time", "s"),
        "time_on_approach": ("time on the approach", "s"),
        "tumble_rate": ("rate of the tumble at the start", "rad/s"),
        "tumble_axis": ("axis of the tumble", "-"),
        "least_clearance": ("least clearance", "m"),
        "contact_speed": ("speed at contact", "m/s"),
        "mating_position_error": ("position error at the mating point", "m"),
        "mating_speed_error": ("velocity error at the mating point", "m/s"),
        "attitude_error": ("error of the target's attitude", "rad"),
        "nees": ("NEES of the target's attitude and rate", "-"),
        "largest_force": ("largest force", "N"),
        "largest_gauge": ("largest gauge of the tube", "-"),
        "plans": ("plans", "-"),
        "planning_time": ("planning time", "s"),
        "worst_status": ("worst status of the tracker", "-"),
        "escape_missing": ("steps without an escape", "-"),
        "given_up": ("given up", "-"),
        "keep_in_excursion": ("excursion from the keep-in box", "m"),
        "final_speed": ("speed at the end", "m/s"),
        "final_range": ("range at the end", "m"),
        "final_range_rate": ("range rate at the end", "m/s"),
    }
)


def mission_table(summary: Mapping[str, Any]) -> str:
    """Return the table of one mission: its result, why the last plan or tube was refused, and its metrics."""
    detail = f" ({summary['detail']})" if summary.get("detail") else ""
    lines = ["success" if summary["success"] else f"failed: {summary['cause']}{detail}"]
    for key, (label, unit) in {**MISSION_FIGURES, "delta_v": ("delta-v", "m/s")}.items():
        value = summary.get(key)
        lines.append(f"  {label:<38}{'-' if value is None else f'{value:.3g} {unit}'.removesuffix(' -')}")
    return "\n".join(lines)
