"""A learned policy and the tube controller on the same tumbles: docking, contact, time and delta-v.

    safe-inspect evaluate --policy tumbling-rendezvous --mode --episodes 1000 --seed 1000 --output FOLDER
    python benchmarks/rendezvous_docking.py FOLDER [--flights 200] [--first 0] [--json result.json] [KEY=VALUE ...]

The policy's flights are those of the folder. Each of the same initial states, tumble and position, is flown by a
mission of `configs/tumbling-rendezvous/experiment-truth.yml` to the mating point of the task, [0, 0.45, 0] m, without a
time of observation; its planner chooses when to start within a minute. The ends are those of the task: docked within
3 cm at 1 cm/s at most, lost in contact or 3 m away. Delta-v is the sum of |u_x| + |u_y| + |u_z| over mass, up to then.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path
from typing import Any

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_variable] = "1"  # before NumPy is imported

import numpy as np  # noqa: E402

from safe_inspect.config.data import configs_root  # noqa: E402
from safe_inspect.dynamics.quaternion import rotate  # noqa: E402
from safe_inspect.evaluation.results.files import read_evaluation  # noqa: E402
from safe_inspect.evaluation.results.results import Block  # noqa: E402
from safe_inspect.metrics.statistics import wilson  # noqa: E402
from safe_inspect.missions.mission import Mission  # noqa: E402
from safe_inspect.rendezvous.experiment import load_rendezvous  # noqa: E402
from safe_inspect.tasks.docking.shape import ASTROBEE_RADIUS  # noqa: E402

_MATING_POINT = np.array([0.0, 0.45, 0.0])
_SETTINGS = (
    "mission.checkout=0 s",
    "mission.observe=0 s",
    "mission.time_limit=250 s",
    "target.config.mating_point=[0 m, 0.45 m, 0 m]",
    "chaser.limits.keep_in=[1.7 m, 1.7 m, 1.7 m]",
    "chaser.actuator.force_noise=0 N",
)


def flown(settings: list[str], start: dict[str, Any]) -> dict[str, Any]:
    """Return how a mission from the initial state of an episode ends."""
    rate, attitude = start["target_angular_velocity"].tolist(), start["target_orientation"].tolist()
    speed = float(np.linalg.norm(rate))
    tumble = f"{{functor: TriAxialTumble, config: {{rate: {speed!r} rad/s, direction: {rate}, attitude: {attitude}}}}}"
    position = "chaser.position=[" + ", ".join(f"{x!r} m" for x in start["position"][0].tolist()) + "]"
    path = configs_root() / "tumbling-rendezvous" / "experiment-truth.yml"
    config = load_rendezvous(path, [*settings, f"tumble={tumble}", position]).config
    result = Mission(config, 0).run()
    arrays = result.log.arrays()
    q, w, x = arrays["target_q"], arrays["target_w"], arrays["x"]
    point = np.broadcast_to(_MATING_POINT, w.shape)
    apart = np.linalg.norm(x[:, :3] - rotate(q, point), axis=1)
    lag = np.linalg.norm(x[:, 3:] - rotate(q, np.cross(w, point)), axis=1)
    docked = np.flatnonzero((apart <= 0.03) & (lag <= 0.01))
    lost = np.flatnonzero((arrays["clearance"] < 0.0) | (np.linalg.norm(x[:, :3], axis=1) > 3.0))
    end = min([*docked[:1], *lost[:1], len(x) - 1])
    spent = np.abs(arrays["force"][:end]).sum() * config.mission.step / config.chaser.mass
    return {
        "success": bool(len(docked)) and not (len(lost) and lost[0] <= docked[0]),
        "contact": bool((arrays["clearance"][:end] < 0.0).any()),
        "time": float(arrays["t"][end]),
        "time of the approach": float(arrays["t"][end] - arrays["t"][np.flatnonzero(arrays["state"] == 6)[0]])
        if (arrays["state"] == 6).any()
        else float("nan"),
        "delta_v": float(spent),
        "cause": result.summary["cause"],
        "detail": result.summary["detail"],
    }


def learned(team: Block, number: int) -> dict[str, Any]:
    """Return how an episode of the policy has ended."""
    return {
        "success": bool(team.status[number] == "win"),
        "contact": bool(team.figures["least clearance"][number] < ASTROBEE_RADIUS),
        "time": float(team.figures["length"][number]),
        "delta_v": float(team.figures["delta-v"][number]),
    }


def report(name: str, flights: list[dict[str, Any]]) -> dict[str, Any]:
    """Print and return what came of some flights."""
    count = len(flights)
    docked = [flight for flight in flights if flight["success"]]
    contacts = sum(flight["contact"] for flight in flights)
    figures: dict[str, Any] = {
        "flights": count,
        "docked": len(docked),
        "docked, interval [%]": [round(100.0 * value, 1) for value in wilson(len(docked), count)],
        "contacts": contacts,
        "contacts, interval [%]": [round(100.0 * value, 2) for value in wilson(contacts, count)],
    }
    for key in ("time", "time of the approach", "delta_v"):
        values = np.array([flight[key] for flight in docked if key in flight])
        if len(values):
            error = 1.96 * values.std(ddof=1) / np.sqrt(len(values))
            figures[key + " of docked, mean, half width of the 95 % interval"] = [float(values.mean()), float(error)]
    print(name, json.dumps(figures, indent=1), flush=True)
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("overrides", nargs="*", metavar="KEY=VALUE")
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--json", help="file to write the figures to")
    arguments = parser.parse_args()
    began = time.process_time()
    evaluation = read_evaluation(arguments.folder)
    numbers = range(arguments.first, arguments.first + arguments.flights)
    flights = []
    for number in numbers:
        start = {name: values[number] for name, values in evaluation.initial_states.items()}
        flights.append(flown([*_SETTINGS, *arguments.overrides], start))
        if not flights[-1]["success"]:
            print(number, flights[-1], flush=True)
        if len(flights) % 50 == 0:
            print(f"{len(flights)} flown", flush=True)
    figures = {
        "policy": report("policy", [learned(evaluation.team, number) for number in numbers]),
        "tube": report("tube", flights),
        "processor time [s]": time.process_time() - began,
    }
    if arguments.json:
        with open(arguments.json, "w", encoding="utf-8") as out:
            json.dump({**figures, "flights": flights}, out, indent=1)


if __name__ == "__main__":
    main()
