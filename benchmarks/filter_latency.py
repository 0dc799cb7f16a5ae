"""How long does the safety filter take for one state at a time, as on board: median and 99th percentile?

    python benchmarks/filter_latency.py [--calls 3000] [--seed 0] [--json result.json]

Processor time of `BackupFilter` for a batch of one, on one core: at initial states of the shipped task with small
thrusts, and in flight under the adversaries of `rta_filter.py`, after 60 steps.
"""

from __future__ import annotations

import argparse
import json
import os
import time

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_variable] = "1"  # before NumPy is imported

import numpy as np  # noqa: E402
from rta_filter import KINDS, desired_controls, starts  # noqa: E402

from safe_inspect.dynamics.cwh import propagate, transition  # noqa: E402
from safe_inspect.rta.backup.safety_filter import BackupFilter  # noqa: E402
from safe_inspect.rta.constraints import RelativeState  # noqa: E402
from safe_inspect.types import FloatArray  # noqa: E402

_N, _MASS, _DT = 0.001027, 12.0, 10.0


def times(run: BackupFilter, state: RelativeState, desired: FloatArray, calls: int) -> FloatArray:
    """Return the processor time of each call for one of the states in turn [us], shape (calls,)."""
    rows = [(state[np.array([i])], desired[i : i + 1]) for i in range(len(state))]
    run(*rows[0])
    found = np.empty(calls)
    for k in range(calls):
        begin = time.process_time_ns()
        run(*rows[k % len(rows)])
        found[k] = 1e-3 * (time.process_time_ns() - begin)
    return found


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--calls", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", help="write the rows to this file")
    arguments = parser.parse_args()
    run, generator = BackupFilter(), np.random.default_rng(arguments.seed)
    start = starts(1200, arguments.seed)
    start = start[np.flatnonzero(run.recoverable(start))]
    small = generator.uniform(-0.02, 0.02, (len(start), 3))
    kind = np.arange(len(start)) % len(KINDS)
    p, v, theta = start.position.copy(), start.velocity.copy(), start.sun_angle.copy()
    for step in range(60):
        state = RelativeState(p, v, theta)
        control = run(state, desired_controls(state, kind, step, generator)).control
        propagate(p, v, control, *transition(_N, _MASS, _DT), p, v)
        theta = theta + _N * _DT
    flown = RelativeState(p, v, theta)
    cases = {
        "initial states, thrusts of 2 %": (start, small),
        "adversaries after 60 steps": (flown, desired_controls(flown, kind, 60, generator)),
    }
    rows = []
    print("| one state at a time | median [us] | 99 % below [us] | largest [us] |\n|---|---:|---:|---:|")
    for name, (state, desired) in cases.items():
        found = times(run, state, desired, arguments.calls)
        row = {"median": np.median(found), "p99": np.percentile(found, 99), "largest": found.max()}
        rows.append({"case": name, **{key: float(value) for key, value in row.items()}})
        print(f"| {name} | {' | '.join(f'{value:.0f}' for value in row.values())} |", flush=True)
    if arguments.json:
        with open(arguments.json, "w", encoding="utf-8") as stream:
            json.dump(rows, stream, indent=2)


if __name__ == "__main__":
    main()
