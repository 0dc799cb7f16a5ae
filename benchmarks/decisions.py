"""Speed of vectors of environments whose decisions last, compared with one that decides at every control step.

    python benchmarks/decisions.py [--envs 64 1024] [--seconds 4]

Every case flies the task of `experiment-burn-and-coast.yml` with random burns. `step by step`: all durations are one
control step. `mixed`: half of the decisions take one control step, the others 4 to 64. `whole batch`: the same, but
environments that wait are stepped on, as an environment without parts does. `sampler`: control steps of the batch
itself, each environment deciding again when its decision elapses, as in the batched runner. Rates are for a second
of processor time, of the process alone; the cases take turns.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from collections.abc import Callable
from unittest.mock import patch

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_variable] = "1"  # before NumPy is imported

import numpy as np  # noqa: E402
from machine import machine  # noqa: E402

import safe_inspect  # noqa: E402
from safe_inspect.config.data import configs_root  # noqa: E402
from safe_inspect.config.experiment import load_experiment  # noqa: E402
from safe_inspect.environments import TeamEnvironment  # noqa: E402
from safe_inspect.simulators.simulator import Simulation  # noqa: E402

TASK = configs_root() / "translational-inspection" / "experiment-burn-and-coast.yml"
#: Durations in control steps, and the share of the decisions that has each.
DURATIONS = ["CoastGlue.config.durations=[1, 4, 8, 16, 32, 64]"]
SHARES = (0.5, 0.15, 0.1, 0.1, 0.05, 0.1)
BURNS, LARGEST = 0.15, 0.3
#: Decisions that are drawn ahead, and used again and again.
KEPT = 64


def decisions(count: int, shares: tuple[float, ...]) -> np.ndarray:
    """Return actions at random, shape (KEPT, N, 4)."""
    draw = np.random.default_rng(0)
    burns = draw.random((KEPT, count, 1)) < BURNS
    thrust = np.where(burns, draw.uniform(-LARGEST, LARGEST, (KEPT, count, 3)), 0.0)
    durations = draw.choice(len(shares), (KEPT, count, 1), p=shares)
    return np.concatenate((thrust, durations), axis=-1).astype(np.float32)


def vector(count: int, shares: tuple[float, ...], parts: bool = True) -> Callable[[float], tuple[float, float]]:
    """Return a function that steps a Gymnasium vector for some seconds; it returns both rates."""
    envs, given = safe_inspect.make_vec(TASK, count, DURATIONS, autoreset_mode="SameStep"), decisions(count, shares)
    envs.reset(seed=1)

    def run(seconds: float) -> tuple[float, float]:
        taken, calls, begun = 0, 0, time.process_time()
        divisible = Simulation.divisible if parts else property(lambda self: False)
        with patch.object(Simulation, "divisible", divisible):
            while time.process_time() - begun < seconds:
                *_, infos = envs.step(given[calls % KEPT])
                taken += int(infos.get("final_info", infos)["elapsed_steps"].sum())
                calls += 1
        spent = time.process_time() - begun
        return calls * count / spent, taken / spent

    return run


def sampler(count: int) -> Callable[[float], tuple[float, float]]:
    """Return a function that steps the batch itself; everyone decides when its decision has elapsed."""
    core, given = TeamEnvironment(load_experiment(TASK, DURATIONS).spec, count, seed=1), decisions(count, SHARES)
    core.observes_coasting = False
    core.reset()

    def run(seconds: float) -> tuple[float, float]:
        begun, decided, calls = time.process_time(), 0, 0
        while time.process_time() - begun < seconds:
            decided += np.count_nonzero(core.due()[0])
            over = core.step((given[calls % KEPT, :, None],)).over
            if over.any():
                core.reset(np.flatnonzero(over))
            calls += 1
        spent = time.process_time() - begun
        return decided / spent, calls * count / spent

    return run


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--envs", type=int, nargs="+", default=[64, 1024])
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    print(machine())
    print(f"{'case':14} {'N':>5} {'decisions/s':>12} {'control steps/s':>16}")
    for count in arguments.envs:
        cases = {
            "step by step": vector(count, (1.0,)),
            "mixed": vector(count, SHARES),
            "whole batch": vector(count, SHARES, parts=False),
            "sampler": sampler(count),
        }
        for run in cases.values():
            run(0.2)
        found: dict[str, list[tuple[float, float]]] = {name: [] for name in cases}
        for _ in range(arguments.rounds):
            for name, run in cases.items():
                found[name].append(run(arguments.seconds / arguments.rounds))
        for name, rates in found.items():
            decided, stepped = (statistics.median(column) for column in zip(*rates, strict=True))
            print(f"{name:14} {count:5} {decided:12,.0f} {stepped:16,.0f}")


if __name__ == "__main__":
    main()
