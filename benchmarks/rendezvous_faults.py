"""Missions with faults at any time: each must end at the mating point, or leave the target slowly, without contact.

    OMP_NUM_THREADS=1 python benchmarks/rendezvous_faults.py faults.jsonl [--missions 400] [--first 0] [--seed 20261123]

The chaser knows what its sensors tell and watches the target for 60 s. The kind of fault, its start (uniform from 0 s
to the end of the approach) and its duration (a quarter for good, else log-uniform from 0.5 s to 100 s) depend on the
seed and the mission's number alone. Each mission is appended to the file as a line of JSON, and missions that are there
already are not flown again; processes with different numbers may share a file. In the end the table of all its missions
is printed.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from safe_inspect.config.data import configs_root
from safe_inspect.metrics.statistics import wilson
from safe_inspect.missions.mission import Mission
from safe_inspect.rendezvous.experiment import load_rendezvous

#: Kinds of faults and their shares. "shape" is a target that the front end does not recognise; "blind" is the loss of
#: camera and inertial unit at once.
_KINDS = {
    "camera": 0.25, "imu": 0.2, "blind": 0.1, "imu_bias": 0.12,
    "tumble": 0.15, "planner": 0.15, "shape": 0.03,
}  # fmt: skip
_PARTS = {"blind": ("camera", "imu"), "none": (), "shape": ()}
#: End of the approach at the latest: 2 s of checkout, 60 s of watching, 10 s of waiting, 60 s of approach [s].
_END = 132.0
_FOR_GOOD = 900.0
_SETTINGS = ("mission.observe=60 s", "mission.wait_limit=10 s", "tumble={functor: RandomTumble}")
#: Speed that no mission may have when it gives up [m/s].
_FAST = 0.05


def draw(seed: int, number: int) -> dict[str, Any]:
    """Return the fault of a mission: its kind, start [s] and duration [s]."""
    random = np.random.default_rng([seed, number])
    kind = str(random.choice(list(_KINDS), p=list(_KINDS.values())))
    start, for_good = float(random.uniform(0.0, _END)), bool(random.random() < 0.25)
    duration = _FOR_GOOD if for_good else float(np.exp(random.uniform(np.log(0.5), np.log(100.0))))
    return {"kind": kind, "start": round(start, 1), "duration": round(duration, 1)}


def fly(seed: int, number: int, fault: dict[str, Any], settings: Iterable[str]) -> dict[str, Any]:
    """Fly a mission with its fault and return its line."""
    kind = fault["kind"]
    times = f"start: {fault['start']} s, duration: {fault['duration']} s"
    faults = ", ".join(f"{{kind: {part}, {times}}}" for part in _PARTS.get(kind, (kind,)))
    overrides = [*_SETTINGS, f"seed={seed}", f"mission.faults=[{faults}]", *settings]
    with tempfile.TemporaryDirectory() as folder:
        if kind == "shape":
            path = Path(folder) / "cylinder.stl"
            trimesh.creation.cylinder(radius=0.3, height=1.2).export(path)
            overrides.append(
                f"target={{functor: MeshTarget, config: {{path: {path}, mating_point: [0 m, 0 m, 0.7 m]}}}}"
            )
        start = time.process_time()
        result = Mission(
            load_rendezvous(configs_root() / "tumbling-rendezvous" / "experiment.yml", overrides).config, number
        ).run()
    steps = [event["data"] for event in result.log.events if event["event"] == "transition"]
    summary = result.summary
    return {
        "seed": seed,
        "number": number,
        **fault,
        **{key: value for key, value in summary.items() if key not in ("attitude_error", "planning_time")},
        "contact": summary["least_clearance"] <= 0.0,
        "states": "-".join(step["to"][:3] for step in steps if step["to"] != step["from"]),
        "processor_time": time.process_time() - start,
    }


def share(label: str, count: int, of: int) -> str:
    """Return a count with Wilson's 95 % interval."""
    if not of:
        return f"  {label:<34}   0 of   0"
    low, high = wilson(count, of)
    return f"  {label:<34}{count:>4} of {of:>3}  [{100 * low:.1f} %, {100 * high:.1f} %]"


def table(rows: list[dict[str, Any]]) -> str:
    """Return the table of missions: how they end, and by kind."""
    given_up = [row for row in rows if row["given_up"]]
    lines = [
        f"{len(rows)} missions",
        share("contact", sum(row["contact"] for row in rows), len(rows)),
        share("arrived", sum(row["success"] for row in rows), len(rows)),
        share("given up", len(given_up), len(rows)),
        share("left the keep-in box", sum(row["keep_in_excursion"] > 0.0 for row in rows), len(rows)),
        share("given up faster than 5 cm/s", sum(row["final_speed"] > _FAST for row in given_up), len(given_up)),
        share("given up and not flying away", sum(row["final_range_rate"] <= 0.0 for row in given_up), len(given_up)),
    ]
    if rows:
        clearance = 100 * min(row["least_clearance"] for row in rows)
        excursion = 100 * max(row["keep_in_excursion"] for row in rows)
        lines.append(f"  least clearance {clearance:.1f} cm, largest excursion from the keep-in box {excursion:.1f} cm")
    for key, unit, label in (("final_speed", "m/s", "speed"), ("final_range", "m", "range"), ("time", "s", "time")):
        if given_up:
            values = np.array([row[key] for row in given_up])
            lines.append(
                f"  {label} at the end where given up: median {np.median(values):.3g} {unit}, {values.min():.3g} to "
                f"{values.max():.3g} {unit}"
            )
    for kind in sorted({row["kind"] for row in rows}):
        own = [row for row in rows if row["kind"] == kind]
        lines.append(share(f"{kind}: arrived", sum(row["success"] for row in own), len(own)))
    for row in rows:
        is_slow_departure = row["given_up"] and 0.0 < row["final_range_rate"] <= row["final_speed"] <= _FAST
        if row["contact"] or row["keep_in_excursion"] > 0.0 or not (row["success"] or is_slow_departure):
            lines.append(f"  look at {line(row)}")
    return "\n".join(lines)


def line(row: dict[str, Any]) -> str:
    """Return a mission in a line."""
    end = "arrived" if row["success"] else f"{row['cause']} ({row['detail']})" if row["detail"] else row["cause"]
    return (
        f"{row['number']:4d} {row['kind']:8} {row['start']:5.1f} s for {row['duration']:5.1f} s  ends at"
        f" {row['time']:5.1f} s {row['final_range']:5.2f} m {100 * row['final_speed']:5.1f} cm/s  least clearance"
        f" {100 * row['least_clearance']:5.1f} cm  {row['states']}  {end}"
    )


def read(path: Path) -> list[dict[str, Any]]:
    """Return the missions of a file, in the order of their numbers; a line that was cut off does not count."""
    rows = {}
    for text in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            row = json.loads(text)
        except ValueError:
            continue
        rows[row["seed"], row["number"]] = row
    return [rows[key] for key in sorted(rows)]


def main() -> None:
    """Fly the missions that are not in the file, and print the table of those that are."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path, help="one line of JSON for each mission")
    parser.add_argument("--missions", type=int, default=400)
    parser.add_argument("--first", type=int, default=0, help="number of the first mission")
    parser.add_argument("--seed", type=int, default=20261123)
    parser.add_argument("--kind", choices=[*_KINDS, "none"], help="this kind alone, or no fault")
    parser.add_argument("--set", action="append", default=[], help="an override of the experiment")
    arguments = parser.parse_args()
    arguments.file.parent.mkdir(parents=True, exist_ok=True)
    for number in range(arguments.first, arguments.first + arguments.missions):
        if (arguments.seed, number) in {(row["seed"], row["number"]) for row in read(arguments.file)}:
            continue
        fault = draw(arguments.seed, number)
        fault["kind"] = arguments.kind or fault["kind"]
        row = fly(arguments.seed, number, fault, arguments.set)
        with arguments.file.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        print(line(row), flush=True)
    print(table(read(arguments.file)))


if __name__ == "__main__":
    main()
