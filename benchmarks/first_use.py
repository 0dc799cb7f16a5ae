"""How long is the first use of an installation, when kernels are compiled?

    python benchmarks/first_use.py [--cases make evaluate train filter team] [--tree FOLDER] [--json result.json]

Each case runs in a separate process with an empty cache folder, and once more with what the first run left there.
`team` begins with the cache that `filter` leaves. Processor time counts the process and what it has waited for; other
work on the machine lengthens the wall time, so compare two trees (`--tree`: another checkout) by processor time, one
measured after the other. A training's processor time leaves out the processes of Ray.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from machine import machine

_ONE = """
import gymnasium, safe_inspect
environment = gymnasium.make("safe_inspect/{}")
environment.reset(seed=1)
environment.step(environment.action_space.sample())
"""
_TEAM = """
import numpy as np
from safe_inspect.environments import TeamEnvironment, load_spec
overrides = ["env_config.rta.config.enabled=True"]
environment = TeamEnvironment(load_spec("safe_inspect/MultiagentTranslationalInspection-v1", overrides), 1, seed=1)
environment.reset()
environment.step([np.zeros((1, 3, 3))])
"""
_POLICY = ("evaluate", "--policy", "translational-inspection", "--episodes", "20")
_TRAINING = ("train", "--cfg", "safe_inspect/TranslationalInspection-v1", "training_iteration=1", "--output")
CASES = {
    "make": "gymnasium.make, reset and step",
    "evaluate": "evaluate a shipped policy, 20 episodes",
    "train": "one iteration of training",
    "filter": "make, reset and step with the safety filter of one deputy",
    "team": "the same with that of a team of three, after `filter`",
}


def command_of(case: str, folder: Path) -> list[str]:
    """Return the command of a case, which may write into a folder."""
    python = [sys.executable, "-W", "ignore"]
    if case == "evaluate":
        return [*python, "-m", "safe_inspect", *_POLICY, "--output", str(folder / "evaluation")]
    if case == "train":
        return [*python, "-m", "safe_inspect", *_TRAINING, str(folder / "runs")]
    names = {"make": "TranslationalInspection-v1", "filter": "FilteredTranslationalInspection-v1"}
    return [*python, "-c", _ONE.format(names[case]) if case in names else _TEAM]


def measure(case: str, cache: Path, tree: Path) -> tuple[float, float]:
    """Run a case; return its wall and its processor time [s].

    Raises:
        SystemExit: It failed; with what it printed.
    """
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(tree)}
    with tempfile.TemporaryDirectory() as folder:
        begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(
            command_of(case, Path(folder)), env=environment, cwd=folder, capture_output=True, text=True
        )
        wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise SystemExit(f"{case} failed:\n{done.stdout}{done.stderr}")
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Measure the cases and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--tree", type=Path, default=Path(__file__).parents[1], help="the checkout that is measured")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    results: dict[str, dict[str, float]] = {}
    print("| case | first: wall [s] | processor [s] | again: wall [s] | processor [s] |\n|---|---:|---:|---:|---:|")
    with tempfile.TemporaryDirectory() as caches:
        for case in given.cases:
            cache = Path(caches) / ("filter" if case == "team" else case)
            if case == "team" and not cache.exists():
                measure("filter", cache, given.tree.resolve())
            first, again = (measure(case, cache, given.tree.resolve()) for _ in range(2))
            results[case] = dict(
                zip(("wall", "processor", "wall_again", "processor_again"), (*first, *again), strict=True)
            )
            print(f"| {CASES[case]} | {first[0]:.1f} | {first[1]:.1f} | {again[0]:.1f} | {again[1]:.1f} |", flush=True)
    if given.json:
        given.json.write_text(json.dumps({"machine": machine(), "cases": results}, indent=2), encoding="utf-8")


if __name__ == "__main__":
    main()
