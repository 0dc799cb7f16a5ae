"""Speed of the environment: steps/s for several batch sizes, compared with a plain loop over scikit-learn's K-means.

    python benchmarks/environment.py [--envs 1 64 1024] [--deputies 1 3 10] [--seconds 2] [--json result.json]

Teams of several deputies fly the multi-agent task. Everything counts: dynamics, points, clustering, sensors, rewards,
dones, and the resets of the episodes that end. One BLAS thread. The measurements take turns over several rounds, so
that a ratio compares what ran under the same load.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import cycle, islice
from pathlib import Path
from typing import Any

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_variable] = "1"  # before NumPy is imported

import numpy as np  # noqa: E402
from machine import machine  # noqa: E402
from scikit_clusters import PlainClusters  # noqa: E402
from stopwatch import Stopwatch, on_the_watch  # noqa: E402

from safe_inspect.config.data import configs_root  # noqa: E402
from safe_inspect.environments import TeamEnvironment, load_spec  # noqa: E402

TASK = "safe_inspect/TranslationalInspectionSeed-v0"
TASK_FILE = configs_root() / "translational-inspection" / "experiment-seed.yml"
#: Tasks that are measured when they are asked for, by the name of their case.
FURTHER_TASKS: dict[str, tuple[str | Path, list[str]]] = {
    "rendezvous": ("safe_inspect/TumblingRendezvous-v0", []),
    "six-dof": ("safe_inspect/WeightedSixDofInspection-v0", []),
    "orbits": (
        configs_root() / "translational-inspection" / "experiment-seed.yml",
        [
            "simulator.config.illumination_params.eclipse=true",
            "simulator.config.illumination_params.beta_angle=3 deg",
            "simulator.config.dynamics={functor: RelativeOrbit, config: {eccentricity: 0.01, drag: {}}}",
            "simulator.config.disturbance=[{functor: BoundedDisturbance, config: {position_error: 5 cm}}, "
            "{functor: ThrusterModel, config: {minimum_impulse: 20 mN s, gain_error: 0.02, misalignment: 1 deg}}, "
            "{functor: SolarPressure}]",
            "parts.Sensor_Position.config.errors={noise: 10 cm}",
        ],
    ),
}
TEAM_TASK = configs_root() / "multiagent-translational-inspection" / "experiment-seed.yml"
OWN_FILTER = "RTAGlueCWHInspection1v1.config.enabled=True"
TEAM_FILTER = "env_config.rta.config.enabled=True"
#: Random thrust as a share of the largest: episodes of a hundred steps and more, and of about thirty.
THRUSTS = {"small": 0.02, "full": 1.0}
#: Steps of filtered flights from a reset: what a filter costs depends on how near the limits the states have come.
FLIGHT = 64
LEGEND = """
batch      the task of one deputy; team: the multi-agent task with D deputies
rendezvous docking with a tumbling target, levels of thrust at random
six-dof    weighted inspection by a deputy that turns; moments are always full
orbits     an elliptic orbit about the oblate Earth, drag, eclipses, noise, errors of thrusters and estimates
steps/s    steps of agents by the clock, N * D in each step of the batch, median of the rounds (best: the best round)
per CPU s  the same for a second of processor time, which other work on the machine changes little
us/step    of one step of all N environments, resets included
ratio      of `per CPU s`, to K-means at every step with the same thrust
share      of the time when every plugin is called by itself, not in the one kernel of the rates above
"""


@dataclass
class Case:
    """One thing to measure: an environment, how it is driven, and the rates found so far."""

    name: str
    num_envs: int
    thrust: str
    environment: TeamEnvironment
    before_step: Callable[[TeamEnvironment], None] | None = None
    flight: int = 0
    steps: int = 0
    resets: int = 0
    per_second: list[float] = field(default_factory=list)
    per_cpu_second: list[float] = field(default_factory=list)

    @property
    def deputies(self) -> int:
        """Number of deputies, D."""
        return len(self.environment.agents)

    def run(self, seconds: float) -> None:
        """Step for about so many seconds and note the rates; with `flight`, so many steps from each of some resets."""
        actions = self._actions()
        steps, spent, used = 0, 0.0, 0.0
        while spent < seconds or steps < 10:
            if self.flight:
                self.environment.reset()
            wall, cpu = time.perf_counter(), time.process_time()
            for action in actions if not self.flight else islice(cycle(actions), self.flight):
                self.step(action)
                steps += 1
            spent, used = spent + time.perf_counter() - wall, used + time.process_time() - cpu
        agents = self.num_envs * self.deputies
        self.steps += steps * agents
        self.per_second.append(steps * agents / spent)
        self.per_cpu_second.append(steps * agents / max(used, 1e-9))

    def step(self, action: np.ndarray) -> None:
        """Step once and reset what has ended."""
        if self.before_step is not None:
            self.before_step(self.environment)
        ended = self.environment.step((action,)).over
        if np.count_nonzero(ended):
            rows = np.flatnonzero(ended)
            self.environment.reset(rows)
            self.resets += len(rows)

    def _actions(self) -> list[np.ndarray]:
        draw = np.random.default_rng(0)
        count = max(1, 64 // self.num_envs)
        layout = self.environment.acting[0].action_layout
        if layout.choices:
            shape = (self.num_envs, self.deputies, layout.size)
            return [draw.integers(0, layout.choices, shape).astype(np.float64) for _ in range(count)]
        size = THRUSTS[self.thrust]
        actions = [draw.uniform(-size, size, (self.num_envs, self.deputies, layout.size)) for _ in range(count)]
        for action in actions:
            action[..., 3:] /= size
        return actions

    def report(self) -> dict[str, Any]:
        """Return what was measured."""
        return {
            "case": self.name,
            "num_envs": self.num_envs,
            "deputies": self.deputies,
            "thrust": self.thrust,
            "steps": self.steps,
            "resets_per_1000_steps": 1000.0 * self.resets * self.deputies / self.steps,
            "steps_per_second_median": float(np.median(self.per_second)),
            "steps_per_second_best": max(self.per_second),
            "steps_per_cpu_second": float(np.median(self.per_cpu_second)),
        }


def profile(case: Case, seconds: float) -> dict[str, float]:
    """Return the share of each section in the time of a step, resets included, largest first.

    Every plugin is called separately: in the kernel that replaces them otherwise, their times cannot be distinguished.
    """
    case.environment = TeamEnvironment(case.environment.spec, case.num_envs, seed=1, _fused=False)
    case.environment.reset()
    watch = Stopwatch()
    with on_the_watch(watch, case.environment):
        case.run(seconds)
    case.per_second.pop(), case.per_cpu_second.pop()  # the watch slows it
    total = sum(watch.seconds.values())
    return {name: spent / total for name, spent in sorted(watch.seconds.items(), key=lambda item: -item[1])}


def make_cases(
    envs: list[int], deputies: list[int], plain: bool, filtered: bool = False, further: Sequence[str] = ()
) -> list[Case]:
    """Return what is to be measured."""
    spec = load_spec(TASK)
    cases = [Case("batch", count, thrust, TeamEnvironment(spec, count, seed=1)) for count in envs for thrust in THRUSTS]
    for name in further:
        task = load_spec(*FURTHER_TASKS[name])
        for thrust in ("levels",) if name == "rendezvous" else THRUSTS:
            cases += [Case(name, count, thrust, TeamEnvironment(task, count, seed=1)) for count in envs]
    if plain:
        for name, every in (("K-means at every step", True), ("K-means when points change", False)):
            for thrust in THRUSTS:
                cases.append(Case(name, 1, thrust, TeamEnvironment(spec, 1, seed=1), PlainClusters(every)))
    for size in deputies:
        team = load_spec(TEAM_TASK, [f"blue#_ctrl.count={size}"])
        cases += [
            Case("team", count, thrust, TeamEnvironment(team, count, seed=1)) for count in envs for thrust in THRUSTS
        ]
    if filtered:
        guarded = [("batch, filtered", load_spec(TASK_FILE, [OWN_FILTER]))]
        guarded += [
            ("team, filtered", load_spec(TEAM_TASK, [f"blue#_ctrl.count={size}", TEAM_FILTER])) for size in deputies
        ]
        cases += [
            Case(name, count, "small", TeamEnvironment(spec, count, seed=1), flight=FLIGHT)
            for name, spec in guarded
            for count in envs
        ]
    return cases


def costs(cases: list[Case]) -> list[dict[str, Any]]:
    """Return what a step of the smallest batch costs with several deputies, as multiples of one deputy's.

    Each round gives a ratio of processor times, of measurements that follow each other; the median counts.
    """
    smallest = min(case.num_envs for case in cases)
    shown = []
    for one in cases:
        if one.deputies > 1 or one.num_envs != smallest or one.name not in ("batch", "team"):
            continue
        for team in cases:
            if team.deputies > 1 and (team.num_envs, team.thrust) == (smallest, one.thrust):
                pairs = zip(one.per_cpu_second, team.per_cpu_second, strict=True)
                ratio = float(np.median([single / several * team.deputies for single, several in pairs]))
                shown.append(
                    {
                        "deputies": team.deputies,
                        "num_envs": smallest,
                        "thrust": one.thrust,
                        "of": "the task of one deputy" if one.name == "batch" else "a team of one",
                        "cost_of_a_step": ratio,
                    }
                )
    return shown


def measure(
    envs: list[int],
    deputies: list[int],
    seconds: float,
    rounds: int,
    plain: bool,
    filtered: bool = False,
    further: Sequence[str] = (),
    shares: bool = True,
) -> dict[str, Any]:
    """Measure every case in turns and return the report."""
    cases = make_cases(envs, deputies, plain, filtered, further)
    for case in cases:
        case.environment.reset()
        case.run(min(0.3, seconds))  # compile, and let the episodes of a batch drift apart
        case.steps = case.resets = 0
        case.per_second.clear(), case.per_cpu_second.clear()
    for _ in range(rounds):
        for case in cases:
            case.run(seconds / rounds)
    rows = [case.report() for case in cases]
    base = {row["thrust"]: row for row in rows if row["case"] == "K-means at every step"}
    for row in rows:
        if row["thrust"] in base:
            row["ratio"] = row["steps_per_cpu_second"] / base[row["thrust"]]["steps_per_cpu_second"]
    shown = costs(cases)
    profiles = [
        {
            "num_envs": case.num_envs,
            "deputies": case.deputies,
            "thrust": case.thrust,
            "shares": profile(case, seconds / 2.0),
        }
        for case in cases
        if shares and (case.name == "batch" or (case.name == "team" and case.deputies == 3))
    ]
    return {"machine": machine(), "rates": rows, "costs": shown, "profiles": profiles}


def show(report: dict[str, Any]) -> None:
    """Print the report as tables."""
    print("  ".join(f"{key} {value}" for key, value in report["machine"].items()))
    head = ("case", "N", "D", "thrust", "steps/s", "best", "per CPU s", "us/step", "resets/1000", "ratio")
    rows = [
        (
            row["case"],
            str(row["num_envs"]),
            str(row["deputies"]),
            row["thrust"],
            f"{row['steps_per_second_median']:,.0f}",
            f"{row['steps_per_second_best']:,.0f}",
            f"{row['steps_per_cpu_second']:,.0f}",
            f"{1e6 * row['num_envs'] * row['deputies'] / row['steps_per_second_median']:,.0f}",
            f"{row['resets_per_1000_steps']:.1f}",
            f"{row['ratio']:,.1f}" if "ratio" in row else "-",
        )
        for row in report["rates"]
    ]
    print()
    _table([head, *rows], left=4)
    print(LEGEND)
    for row in report["costs"]:
        shown = f"a step with {row['deputies']} deputies costs {row['cost_of_a_step']:.2f} times that of {row['of']}"
        print(f"N = {row['num_envs']}, {row['thrust']} thrust: {shown}")
    columns = report["profiles"]
    if not columns:
        return
    print()
    names = sorted(
        {name for item in columns for name in item["shares"]}, key=lambda name: -columns[0]["shares"].get(name, 0)
    )
    head = ("share of the time", *(f"N={item['num_envs']} D={item['deputies']} {item['thrust']}" for item in columns))
    _table(
        [head, *((name, *(f"{100 * item['shares'].get(name, 0.0):.1f} %" for item in columns)) for name in names)],
        left=1,
    )


def _table(rows: list[tuple[str, ...]], left: int) -> None:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (
            cell.ljust(width) if index < left else cell.rjust(width)
            for index, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        print("  ".join(cells).rstrip())


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--envs", type=int, nargs="+", default=[1, 64, 1024], help="batch sizes N")
    parser.add_argument("--deputies", type=int, nargs="+", default=[1, 3, 10], help="sizes D of the teams")
    parser.add_argument("--seconds", type=float, default=5.0, help="time for each case")
    parser.add_argument("--rounds", type=int, default=10, help="turns that the cases take")
    parser.add_argument("--filtered", action="store_true", help="also with the safety filters on")
    parser.add_argument("--rendezvous", action="store_true", help="also the rendezvous with a tumbling target")
    parser.add_argument("--six-dof", action="store_true", help="also six-DoF inspection")
    parser.add_argument("--orbits", action="store_true", help="also inspection on an elliptic orbit, with all errors")
    parser.add_argument("--no-sklearn", action="store_true", help="leave the plain loop out")
    parser.add_argument("--no-shares", action="store_true", help="leave out where the time goes")
    parser.add_argument("--json", type=Path, help="write the report to this file")
    arguments = parser.parse_args(argv)
    if min(*arguments.envs, *arguments.deputies) < 1 or arguments.rounds < 1 or not arguments.seconds > 0.0:
        parser.error("--envs, --deputies, --rounds and --seconds are positive")
    report = measure(
        arguments.envs,
        arguments.deputies,
        arguments.seconds,
        arguments.rounds,
        not arguments.no_sklearn,
        arguments.filtered,
        [name for name in FURTHER_TASKS if getattr(arguments, name.replace("-", "_"))],
        not arguments.no_shares,
    )
    show(report)
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
