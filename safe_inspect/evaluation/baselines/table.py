"""Text table of a baseline's figures."""

from __future__ import annotations

import numpy as np

from safe_inspect.planning.record import Record
from safe_inspect.types import FloatArray


def baseline_table(record: Record) -> str:
    """Return a record's figures as a table: success rate, and mean, median and range of delta-v, burns and steps."""
    entries = record.entries
    won = np.array([entry.success for entry in entries])
    title = f"{record.kind}, {len(entries):,} episodes of seed {record.seed}"
    if record.effort is not None:
        title += f", effort {record.effort}"
    lines = [
        title,
        f"success   {100.0 * won.mean():6.2f} %   ({int(won.sum()):,} of {len(won):,})",
        f"inspected {np.mean([entry.inspected for entry in entries]):6.2f} points on average",
        f"{'':<14}{'mean':>9}{'median':>9}{'least':>9}{'most':>9}",
    ]
    rows: dict[str, FloatArray] = {
        "delta-v [m/s]": np.array([entry.delta_v for entry in entries]),
        "burns": np.array([entry.burns for entry in entries]),
        "steps": np.array([entry.steps for entry in entries], dtype=np.float64),
    }
    for name, values in rows.items():
        digits = 4 if name.startswith("delta") else 1
        cells = [f"{value:9.{digits}f}" for value in (values.mean(), np.median(values), values.min(), values.max())]
        lines.append(f"{name:<14}{''.join(cells)}")
    if record.kind == "optimiser":
        lines += _against_the_inspector(record)
    return "\n".join(lines)


def _against_the_inspector(record: Record) -> list[str]:
    """Return the lines that compare the plans with the inspector, for the episodes in which both succeed."""
    entries = record.entries
    missing = sum(entry.planned is None for entry in entries)
    refused = sum(entry.planned is not None and not entry.own for entry in entries)
    lines = [
        f"plans     {missing} not found; {refused} not confirmed by the simulator, or costlier than the inspector;",
        f"          the inspector's flight is used in {sum(not entry.own for entry in entries)} episodes",
    ]
    both = [(entry.delta_v, entry.inspector) for entry in entries if entry.success and entry.inspector is not None]
    if both:
        own, other = np.array(both).T
        share = f" ({100.0 * (own.mean() / other.mean() - 1.0):+.1f} %)" if other.mean() > 0.0 else ""
        lines.append(
            f"inspector {other.mean():.4f} m/s on average over {len(both):,} episodes; plans {own.mean():.4f}{share}"
        )
    return lines
