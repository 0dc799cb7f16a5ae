"""The output of the estimation from a sensor log: summary and tables."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from safe_inspect.rendezvous.estimation.states import largest_sigma
from safe_inspect.rendezvous.missions.record import json_value
from safe_inspect.rendezvous.poses import MODEL, Edge
from safe_inspect.rendezvous.recording.estimation import ONLINE_COLUMNS, LogEstimate
from safe_inspect.rendezvous.recording.format import TRUTH_PARTS, write_table
from safe_inspect.rendezvous.recording.reader import SensorLog
from safe_inspect.types import FloatArray

ESTIMATE, ONLINE, EDGES = "estimate.json", "estimate.csv", "edges.npz"


def summary_of(log: SensorLog, estimate: LogEstimate) -> dict[str, Any]:
    """Return the estimate at the last frame as a dictionary; angles are in degrees."""
    found, graph = estimate.target, estimate.graph
    time = float(log.times[-1])
    q, w = found.predict(np.array([time]))
    covariance = found.covariance
    summary: dict[str, Any] = {
        "frames": len(log),
        "frames_with_edges": len({edge.second for edge in estimate.edges}),
        "poses_to_the_model": sum(edge.first == MODEL for edge in estimate.edges),
        "seconds": time - float(log.times[0]),
        "time": time,
        "q_WT": q[0],
        "rate_deg_per_s": np.rad2deg(w[0]),
        "attitude_sigma_deg": np.rad2deg(largest_sigma(covariance[:3, :3])),
        "rate_sigma_deg_per_s": np.rad2deg(largest_sigma(covariance[3:6, 3:6])),
        "axes_sigma_deg": np.rad2deg(found.axes_sigma),
        "q_GT": found.q_GT,
        "J1_over_J3": found.ratios[0],
        "J2_over_J3": found.ratios[1],
        "centre_of_mass_W": graph.centre,
        "centre_of_mass_G": graph.centre_glued,
        "centre_sigma": largest_sigma(graph.centre_covariance),
        "axes_are_observable": found.observable,
        "directions_are_known": found.aligned,
        "misfit": found.misfit,
    }
    if log.truth is not None:
        summary["errors"] = _errors(log, estimate, log.truth)
    return summary


def _errors(log: SensorLog, estimate: LogEstimate, truth: FloatArray) -> dict[str, float]:
    rate = truth[-1, TRUTH_PARTS["rate"]]
    error = estimate.attitude_error(log.times, truth[:, TRUTH_PARTS["q_WT"]])
    _, w = estimate.target.predict(log.times[-1:])
    # Without a pose to the model the directions of the axes are only known up to half turns.
    choices = [np.ones(3)]
    if not estimate.target.aligned:
        choices += [2.0 * np.eye(3)[k] - 1.0 for k in range(3)]
    return {
        "attitude_at_the_end_deg": float(np.rad2deg(error[-1])),
        "attitude_median_deg": float(np.rad2deg(np.median(error))),
        "rate_at_the_end_deg_per_s": float(np.rad2deg(min(np.linalg.norm(w[0] * one - rate) for one in choices))),
    }


def write_estimate(folder: Path, log: SensorLog, estimate: LogEstimate) -> None:
    """Write the summary and the tables into an existing folder."""
    summary = json_value(summary_of(log, estimate))
    (folder / ESTIMATE).write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    write_table(folder / ONLINE, ONLINE_COLUMNS, estimate.online, ".10g")
    names = [field.name for field in fields(Edge)]
    columns = {name: np.array([getattr(edge, name) for edge in estimate.edges]) for name in names}
    np.savez_compressed(folder / EDGES, **columns)  # type: ignore[arg-type]


def estimate_table(summary: dict[str, Any]) -> str:
    """Return the summary as lines of text for a terminal."""
    rate = summary["rate_deg_per_s"]
    components = ", ".join(f"{one:.3f}" for one in rate)
    lines = [
        f"{summary['frames_with_edges']} of {summary['frames']} frames in {summary['seconds']:.1f} s gave poses, "
        f"{summary['poses_to_the_model']} of them to the known model",
        f"rate at the end in T           {np.linalg.norm(rate):8.3f} deg/s  ({components}), "
        f"sigma {summary['rate_sigma_deg_per_s']:.3f}",
        f"attitude, sigma                {summary['attitude_sigma_deg']:8.3f} deg",
        f"principal axes, sigma          {summary['axes_sigma_deg']:8.3f} deg"
        + ("" if summary["axes_are_observable"] else "  (the motion does not show the transverse axes)"),
        f"J1/J3, J2/J3                   {summary['J1_over_J3']:8.4f}, {summary['J2_over_J3']:.4f}",
        f"centre of mass, sigma          {1e3 * summary['centre_sigma']:8.1f} mm",
        "directions of the axes         "
        + (
            "    known from the model"
            if summary["directions_are_known"]
            else "    ambiguous by half turns: no known shape"
        ),
    ]
    if "errors" in summary:
        errors = summary["errors"]
        lines.append(
            f"errors against the truth: attitude {errors['attitude_at_the_end_deg']:.2f} deg at the end "
            f"({errors['attitude_median_deg']:.2f} median), rate {errors['rate_at_the_end_deg_per_s']:.3f} deg/s"
        )
    return "\n".join(lines)
