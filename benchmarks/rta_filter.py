"""The safety filters: do they hold over a 10 s hold, how much do they change, and how long do they take?

    python benchmarks/rta_filter.py [--rows 1024] [--steps 1000] [--compare 1000] [--json result.json]

Start states are drawn as the shipped task draws them (each satisfies phi >= 0 and h >= 0 of all eight constraints); for
the count of violations those are kept from which the default filter has a backup plan. The desired controls are
adversarial, a sixth of the rows each: towards the chief, towards the axis of the sun cone, outward, maximum thrust
at random, bang-bang along the velocity, and none.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable
from typing import Any

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_variable] = "1"  # before NumPy is imported

import numpy as np  # noqa: E402
from admissible import admissible  # noqa: E402

from safe_inspect.dynamics.cwh import propagate, transition  # noqa: E402
from safe_inspect.environments import BatchedEnvironment, load_spec  # noqa: E402
from safe_inspect.rta.backup.safety_filter import BackupFilter  # noqa: E402
from safe_inspect.rta.constraints import RelativeState  # noqa: E402
from safe_inspect.rta.continuous import ContinuousFilter  # noqa: E402
from safe_inspect.simulators.view import FilterResult  # noqa: E402
from safe_inspect.types import FloatArray  # noqa: E402

TASK = "safe_inspect/TranslationalInspectionSeed-v0"
KINDS = ("to the chief", "to the sun cone", "outward", "random", "bang-bang", "zero")
Filter = Callable[[RelativeState, FloatArray], FilterResult]


def starts(rows: int, seed: int) -> RelativeState:
    """Return initial states of the shipped task."""
    environment = BatchedEnvironment(load_spec(TASK), rows, seed=seed)
    environment.reset()
    state = environment.state
    return RelativeState(
        state.position[:, 0] - state.position[:, 1], state.velocity[:, 0] - state.velocity[:, 1], state.sun_angle.copy()
    )


def desired_controls(state: RelativeState, kind: FloatArray, step: int, generator: Any) -> FloatArray:
    """Return the adversaries' controls [N], shape (R, 3)."""
    p, theta = state.position, state.sun_angle
    r = np.sqrt((p * p).sum(axis=1, keepdims=True))
    axis = np.stack((-np.cos(theta), np.sin(theta), np.zeros(len(p))), axis=1)
    to_axis = r * axis - p
    to_axis /= np.sqrt((to_axis * to_axis).sum(axis=1, keepdims=True)) + 1e-9
    bang = np.sign(state.velocity + 1e-12) * (1.0 if step // 7 % 2 else -1.0)
    corners = generator.choice([-1.0, 1.0], p.shape)
    choices = np.stack((-1.8 * p / r, 1.8 * to_axis, 1.8 * p / r, corners, bang, np.zeros(p.shape)))
    return np.clip(choices[kind, np.arange(len(p))], -1.0, 1.0)


def fly(
    run: Filter | None, names: tuple[str, ...], phi: Any, start: RelativeState, steps: int, dense: int
) -> dict[str, Any]:
    """Fly the adversaries under a filter, or none; return what happened, by kind and by constraint.

    Args:
        run: The filter.
        names: The constraints.
        phi: Gives their plain safety quantities.
        start: The first states.
        steps: Number of holds.
        dense: Of how many holds one is looked at second by second.
    """
    rows, kind = len(start), np.arange(len(start)) % len(KINDS)
    generator = np.random.default_rng(1)
    n = 0.001027
    whole, part = transition(n, 12.0, 10.0), transition(n, 12.0, 1.0)
    p, v, theta = start.position.copy(), start.velocity.copy(), start.sun_angle.copy()
    least, inside = np.full((rows, len(names)), np.inf), np.full((rows, len(names)), np.inf)
    at_steps, between = np.zeros(len(names)), np.zeros(len(names))
    changed, distance, infeasible, backup = (np.zeros(rows) for _ in range(4))
    active = np.zeros(len(names))
    looked, seconds = 0, 0.0
    for step in range(steps):
        state = RelativeState(p, v, theta)
        want = desired_controls(state, kind, step, generator)
        begin = time.perf_counter()
        result = None if run is None else run(state, want)
        seconds += time.perf_counter() - begin
        control = want if result is None else result.control
        if result is not None:
            away = result.control - want
            changed += result.intervening
            distance += np.sqrt((away * away).sum(axis=1))
            infeasible += result.infeasible
            backup += result.backup
            active += [(result.active >> j & 1).sum() for j in range(len(names))]
        if step % dense == 0:
            q, w, sun = p.copy(), v.copy(), theta.copy()
            for _ in range(9):
                propagate(q, w, control, *part, q, w)
                sun += n
                value = phi(RelativeState(q, w, sun))
                inside = np.minimum(inside, value)
                between += (value < 0.0).sum(axis=0)
                looked += rows
        propagate(p, v, control, *whole, p, v)
        theta = theta + n * 10.0
        value = phi(RelativeState(p, v, theta))
        least = np.minimum(least, value)
        at_steps += (value < 0.0).sum(axis=0)
    total = rows * steps
    return {
        "filtered steps": total,
        "us per state with phi": 1e6 * seconds / total,
        "constraints": {
            name: {
                "broken at steps %": 100.0 * at_steps[j] / total,
                "broken between %": 100.0 * between[j] / max(looked, 1),
                "count at steps": int(at_steps[j]),
                "count between": int(between[j]),
                "least phi": float(min(least[:, j].min(), inside[:, j].min())),
                "refused %": 100.0 * active[j] / total,
            }
            for j, name in enumerate(names)
        },
        "kinds": {
            name: {
                "intervening %": 100.0 * changed[kind == k].sum() / (steps * (kind == k).sum()),
                "mean change N": distance[kind == k].sum() / (steps * (kind == k).sum()),
                "backup %": 100.0 * backup[kind == k].sum() / (steps * (kind == k).sum()),
                "infeasible %": 100.0 * infeasible[kind == k].sum() / (steps * (kind == k).sum()),
            }
            for k, name in enumerate(KINDS)
        },
    }


def timings(filters: dict[str, Filter], start: RelativeState, settled: RelativeState) -> dict[str, Any]:
    """Return microseconds per state at N = 1, 64, 1024: small and full random thrust, and adversaries in mid-flight."""
    generator = np.random.default_rng(2)
    kind = np.arange(len(start)) % len(KINDS)
    cases = {
        "start states, thrust of 2 %": (start, generator.uniform(-0.02, 0.02, (len(start), 3))),
        "start states, full thrust": (start, generator.uniform(-1.0, 1.0, (len(start), 3))),
        "adversaries after 100 steps": (settled, desired_controls(settled, kind, 0, generator)),
    }
    table: dict[str, Any] = {}
    for name, run in filters.items():
        for case, (state, want) in cases.items():
            for size in (1, 64, 1024):
                rows = min(size, len(state))
                groups = [slice(i, i + rows) for i in range(0, len(state) - rows + 1, rows)][:256]
                parts = [(state[group], want[group]) for group in groups]
                run(*parts[0])
                best = np.inf
                for _ in range(5):
                    begin = time.perf_counter()
                    for part in parts:
                        run(*part)
                    best = min(best, time.perf_counter() - begin)
                table[f"{name}: {case}, N = {size}"] = 1e6 * best / (rows * len(parts))
    return table


def show(title: str, result: dict[str, Any]) -> None:
    print(f"\n{title}: {result['filtered steps']:,} filtered steps")
    for group in ("constraints", "kinds"):
        columns = list(next(iter(result[group].values())))
        print(f"  {'':18}" + "".join(f"{column:>19}" for column in columns))
        for name, row in result[group].items():
            print(f"  {name:18}" + "".join(f"{row[column]:>19.6g}" for column in columns))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=1024)
    parser.add_argument("--steps", type=int, default=1000, help="holds under the default filter")
    parser.add_argument("--compare", type=int, default=1000, help="holds of 128 rows under the others")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", default="")
    arguments = parser.parse_args()
    backup = BackupFilter()
    drawn = starts(arguments.rows + arguments.rows // 20 + 8, arguments.seed)
    recoverable = backup.recoverable(drawn)
    print(f"start states without a backup plan: {100.0 * (1.0 - recoverable.mean()):.2f} % of {len(drawn)}")
    start = drawn[np.flatnonzero(recoverable)[: arguments.rows]]
    report: dict[str, Any] = {"without plan %": 100.0 * (1.0 - recoverable.mean())}
    few = start[: min(128, len(start))]
    others: dict[str, Filter | None] = {
        "no filter": None,
        "continuous form, passes the desired control on where infeasible": ContinuousFilter(infeasible="pass"),
        "continuous form, least violation where infeasible": ContinuousFilter(),
    }
    for name, run in others.items():
        report[name] = fly(run, backup.names, backup.phi, few, arguments.compare, 10)
        show(name, report[name])
    report["default"] = fly(backup, backup.names, backup.phi, start, arguments.steps, 10)
    show("default: backup filter", report["default"])
    kind = np.arange(len(start)) % len(KINDS)
    p, v, theta = start.position.copy(), start.velocity.copy(), start.sun_angle.copy()
    generator = np.random.default_rng(3)
    for step in range(100):
        state = RelativeState(p, v, theta)
        control = backup(state, desired_controls(state, kind, step, generator)).control
        propagate(p, v, control, *transition(0.001027, 12.0, 10.0), p, v)
        theta = theta + 0.001027 * 10.0
    report["us per state"] = timings(
        {
            "default": backup,
            "continuous": ContinuousFilter(),
            "phi alone": lambda state, want: backup.phi(state),  # type: ignore[dict-item, return-value]
            "plan search alone": lambda state, want: backup.recoverable(state),  # type: ignore[dict-item, return-value]
            "test of the desired control": lambda state, want: admissible(backup, state, want),  # type: ignore[dict-item, return-value]
        },
        start, RelativeState(p, v, theta),
    )  # fmt: skip
    print("\nmicroseconds per state")
    for name, value in report["us per state"].items():
        print(f"  {name:60} {value:10.2f}")
    if arguments.json:
        with open(arguments.json, "w", encoding="utf-8") as stream:
            json.dump(report, stream, indent=2)


if __name__ == "__main__":
    main()
