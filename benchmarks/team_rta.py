"""Three deputies under adversaries: does a filter that decides for all keep them apart, and one for each?

    python benchmarks/team_rta.py [--steps 100000] [--deputies 3] [--num-envs 1024] [--seed 0]
        [--filters none decentralised centralised] [--timings] [--json result.json] [--plot figure.png]

Starts are drawn at ranges of 50 to 100 m and up to 0.3 m/s such that every constraint is met and a joint plan exists.
The adversaries are those of `team_safety.py`. Each environment is one run. The steps count
environments: with three deputies, three thrusts are filtered in each.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from typing import Any

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_variable] = "1"  # before NumPy is imported

import numpy as np  # noqa: E402
from team_figure import team_safety_figure  # noqa: E402
from team_flight import TeamFlight  # noqa: E402
from team_safety import FILTERS, draw_teams, team_report, team_thrust  # noqa: E402

from safe_inspect.figures.drawing import save  # noqa: E402
from safe_inspect.rta.team.safety_filter import TeamFilter, TeamState  # noqa: E402
from safe_inspect.types import FloatArray  # noqa: E402


def timings(run: TeamFilter, start: TeamState, seed: int) -> dict[str, float]:
    """Return microseconds of processor time for an environment step at N = 1, 64 and 1024.

    The cases: first steps with thrusts of 2 % of the largest in random directions, and the adversaries' after 60 steps.
    """
    slots = np.arange(len(start))
    flight = TeamFlight("centralised", run, start, 1)
    for hold in range(60):
        flight.fly(flight.filtered(team_thrust(flight.state, hold, slots, seed))[0])
    small = np.random.default_rng(seed).uniform(-0.02, 0.02, start.position.shape)
    cases: dict[str, tuple[TeamState, FloatArray]] = {
        "starts, thrust of 2 %": (start, small),
        "adversaries after 60 steps": (flight.state, team_thrust(flight.state, 60, slots, seed)),
    }
    table = {}
    for name, (state, want) in cases.items():
        for size in (1, 64, 1024):
            rows = min(size, len(start))
            groups = [slice(i, i + rows) for i in range(0, len(start) - rows + 1, rows)][:140]
            best = np.inf
            for _ in range(3):
                begin = time.process_time()
                for group in groups:
                    run(state[group], want[group])
                best = min(best, time.process_time() - begin)
            table[f"{name}, N = {size}"] = 1e6 * best / (rows * len(groups))
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=100_000, help="environment steps under each filter")
    parser.add_argument("--deputies", type=int, default=3)
    parser.add_argument("--num-envs", type=int, default=1024, help="environments at a time, each one run")
    parser.add_argument("--substeps", type=int, default=10, help="parts of a hold at whose ends is looked")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--filters", nargs="+", choices=FILTERS, default=list(FILTERS))
    parser.add_argument("--timings", action="store_true")
    parser.add_argument("--json", default="")
    parser.add_argument("--plot", default="")
    arguments = parser.parse_args()
    if min(arguments.steps, arguments.deputies, arguments.num_envs, arguments.substeps) < 1:
        parser.error("steps, deputies, num-envs and substeps are at least 1")
    run = TeamFilter()
    begin = time.perf_counter()
    start = draw_teams(run, arguments.num_envs, arguments.deputies, arguments.seed)
    run(start[:1], np.zeros((1, arguments.deputies, 3)))
    print(f"starts drawn and filter compiled or loaded in {time.perf_counter() - begin:.1f} s")
    result: dict[str, Any] = {"deputies": arguments.deputies, "reports": []}
    if arguments.timings:
        result["us per environment step"] = timings(run, start, arguments.seed)
        print("microseconds per environment step")
        for name, value in result["us per environment step"].items():
            print(f"  {name:40} {value:10.1f}")
    reports = []
    for kind in arguments.filters:
        begin = time.perf_counter()
        report = team_report(kind, run, start, arguments.steps, arguments.seed, arguments.substeps)
        reports.append(report)
        result["reports"].append(report.as_dict())
        print(f"\n{report}\n{time.perf_counter() - begin:.0f} s in all")
        sys.stdout.flush()
    if arguments.json:
        with open(arguments.json, "w", encoding="utf-8") as stream:
            json.dump(result, stream, indent=2)
    if arguments.plot and arguments.deputies > 1:
        save(team_safety_figure(reports, 2.0 * run.deputy_radius), arguments.plot)


if __name__ == "__main__":
    main()
