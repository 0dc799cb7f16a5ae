"""How much farther from the desired thrust than the nearest safe one is what the backup filter flies?

    python benchmarks/nearest_thrust.py [--states 480] [--rounds 200] [--json result.json]

The states are those of adversarial flights (see `rta_filter.py` in this folder) in which the filter changes the desired
thrust, taken at random. The reference is a search that asks the filter's own test (`admissible.py` in this folder):
thrusts at random in the ball about the desired thrust that is nearer than the best one known, and about the best, at
distances from 0.3 N down to 0.3 mN of it. What it finds is an upper bound of the nearest, so the excess is a lower
bound; more rounds show how near they are.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from typing import Any

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_variable] = "1"  # before NumPy is imported

import numpy as np  # noqa: E402
from admissible import admissible  # noqa: E402
from rta_filter import KINDS, desired_controls, starts  # noqa: E402

from safe_inspect.dynamics.cwh import propagate, transition  # noqa: E402
from safe_inspect.rta.backup.safety_filter import BackupFilter  # noqa: E402
from safe_inspect.rta.constraints import RelativeState  # noqa: E402
from safe_inspect.types import FloatArray  # noqa: E402

#: Candidates of a round: in the ball about the desired thrust, and about the best known.
_IN_BALL, _ABOUT_BEST = 16, 32
#: What counts as nearer [N].
_NEARER = 1e-4


def intervened(run: BackupFilter, count: int, seed: int, holds: int = 150) -> tuple[RelativeState, FloatArray]:
    """Return states of adversarial flights in which the filter intervenes, and the desired thrusts."""
    drawn = starts(96, seed)
    state = drawn[run.recoverable(drawn)]
    kind, generator = np.arange(len(state)) % len(KINDS), np.random.default_rng(seed)
    p, v, theta = state.position, state.velocity, state.sun_angle
    taken: list[Any] = []
    for hold in range(holds):
        here = RelativeState(p.copy(), v.copy(), theta.copy())
        want = desired_controls(here, kind, hold, generator)
        result = run(here, want)
        rows = result.intervening & ~result.infeasible
        taken.append((p[rows], v[rows], theta[rows], want[rows]))
        propagate(p, v, result.control, *transition(0.001027, 12.0, 10.0), p, v)
        theta = theta + 0.001027 * 10.0
    p, v, theta, want = (np.concatenate(parts) for parts in zip(*taken, strict=True))
    chosen = generator.permutation(len(p))[:count]
    return RelativeState(p[chosen], v[chosen], theta[chosen]), want[chosen]


def distance(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the lengths of the differences [N]."""
    length: FloatArray = np.sqrt(((a - b) ** 2).sum(axis=-1))
    return length


def nearest(run: BackupFilter, state: RelativeState, want: FloatArray, first: FloatArray, rounds: int) -> FloatArray:
    """Return the admissible thrusts nearest to the desired ones that a random search from `first` finds [N]."""
    generator = np.random.default_rng(7)
    best, rows = first.copy(), np.arange(len(state))
    for _ in range(rounds):
        radius = distance(best, want)[:, None, None]
        around = generator.normal(size=(len(state), _IN_BALL + _ABOUT_BEST, 3))
        around /= np.sqrt((around**2).sum(axis=-1, keepdims=True))
        around *= generator.random((*around.shape[:2], 1)) ** (1.0 / 3.0)
        around[:, :_IN_BALL] = want[:, None] + radius * around[:, :_IN_BALL]
        size = 10.0 ** generator.uniform(-3.5, -0.5, (len(state), _ABOUT_BEST, 1))
        around[:, _IN_BALL:] = best[:, None] + size * around[:, _IN_BALL:]
        around = np.clip(around, -1.0, 1.0)
        away = distance(around, want[:, None])
        order = np.argsort(away, axis=1)
        open_rows = np.ones(len(state), np.bool_)
        for place in range(around.shape[1]):
            column = order[:, place]
            ask = np.flatnonzero(open_rows & (away[rows, column] < radius[:, 0, 0] - _NEARER))
            if not len(ask):
                break
            trial = around[ask, column[ask]]
            found = ask[admissible(run, state[ask], trial)]
            best[found] = around[found, column[found]]
            open_rows[found] = False
    return best


def summary(excess: FloatArray) -> dict[str, float]:
    """Return what is reported of excess distances [N]."""
    return {
        "states": float(len(excess)), "mean": float(excess.mean()), "median": float(np.median(excess)),
        "p90": float(np.quantile(excess, 0.9)), "p99": float(np.quantile(excess, 0.99)), "max": float(excess.max()),
        "above 0.01 N %": 100.0 * float((excess > 0.01).mean()), "above 0.1 N %": 100.0 * float((excess > 0.1).mean()),
    }  # fmt: skip


def main() -> None:
    """Print the excess, in all and by the constraint that refused the desired thrust."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--states", type=int, default=480)
    parser.add_argument("--rounds", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", default="")
    arguments = parser.parse_args()
    run = BackupFilter()
    state, want = intervened(run, arguments.states, arguments.seed)
    result = run(state, want)
    print(f"{100.0 * admissible(run, state, result.control).mean():.2f} % of what is flown is admissible itself")
    begin = time.process_time()
    best = nearest(run, state, want, result.control, arguments.rounds)
    excess = distance(result.control, want) - distance(best, want)
    groups = {"all": np.ones(len(state), np.bool_), "stage nearest": ~result.backup, "stage backup": result.backup}
    groups |= {f"refused by {name}": result.active >> j & 1 == 1 for j, name in enumerate(run.names)}
    report = {name: summary(excess[group]) for name, group in groups.items() if group.any()}
    print(f"searched in {time.process_time() - begin:.0f} s of processor time; excess over the nearest safe thrust [N]")
    print(f"{'':28}" + "".join(f"{name:>16}" for name in report["all"]))
    for name, row in report.items():
        print(f"{name:28}" + "".join(f"{value:>16.4g}" for value in row.values()))
    if arguments.json:
        with open(arguments.json, "w", encoding="utf-8") as stream:
            json.dump(report, stream, indent=2)


if __name__ == "__main__":
    main()
