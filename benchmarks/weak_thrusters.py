"""From how many safe states does the backup filter hold with weak thrusters, by plans of one hold and of several?

    python benchmarks/weak_thrusters.py [--states 1500] [--seed 0] [--json result.json]

Those states count that keep all eight constraints: first of states as the shipped task starts in, 50 to 100 m from the
chief with speeds up to 0.3 m/s; then, for plans of several holds, of states at ranges and speeds that are uniform up to
their limits.
"""

from __future__ import annotations

import argparse
import itertools
import json

import numpy as np

from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.constraints import RelativeState
from safe_inspect.rta.filters import SAFE_DRAWS, safe_states

MASSES, THRUSTS, STEPS = (12.0, 24.0, 60.0), (1.0, 0.3), (5.0, 10.0, 20.0)
#: Thrusters that cannot brake against the tide at the largest range and speed: mass, thrust, step.
WEAKER = ((12.0, 0.05, 10.0), (12.0, 0.02, 10.0), (12.0, 0.01, 10.0), (24.0, 0.1, 10.0))


def states(count: int, seed: int) -> RelativeState:
    """Draw states."""
    generator = np.random.default_rng(seed)
    directions = generator.normal(size=(2, count, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return RelativeState(
        directions[0] * generator.uniform(50.0, 100.0, (count, 1)),
        directions[1] * generator.uniform(0.0, 0.3, (count, 1)),
        generator.uniform(0.0, 2.0 * np.pi, count),
    )


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--states", type=int, default=1500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", help="write the rows to this file")
    arguments = parser.parse_args()
    drawn, rows = states(arguments.states, arguments.seed), []
    heads = (
        "mass [kg]",
        "thrust [N]",
        "hold [s]",
        "impulse of a hold [m/s]",
        "starts, one hold",
        "several",
        "everywhere",
    )
    print(f"| {' | '.join(heads)} |")
    print("|---:|---:|---:|---:|---:|---:|---:|")
    for mass, thrust, step in (*itertools.product(MASSES, THRUSTS, STEPS), *WEAKER):
        parameters = {"m": mass, "u_max": thrust, "step_size": step}
        runs = [BackupFilter(parameters, several_holds=several) for several in (False, True)]
        safe = drawn[np.flatnonzero((runs[1].phi(drawn) >= 0.0).all(axis=1))]
        everywhere = safe_states(runs[1].constraints, runs[1].parameters, SAFE_DRAWS)
        pairs = ((runs[0], safe), (runs[1], safe), (runs[1], everywhere))
        shares = [float(run.recoverable(part).mean()) for run, part in pairs]
        found = dict(zip(("one_hold", "several_holds", "everywhere"), shares, strict=True))
        rows.append({**parameters, **found, "states": len(safe), "states_everywhere": len(everywhere)})
        cells = (f"{mass:g}", f"{thrust:g}", f"{step:g}", f"{thrust * step / mass:.2f}", *(f"{x:.1%}" for x in shares))
        print(f"| {' | '.join(cells)} |", flush=True)
    if arguments.json:
        with open(arguments.json, "w", encoding="utf-8") as stream:
            json.dump(rows, stream, indent=2)


if __name__ == "__main__":
    main()
