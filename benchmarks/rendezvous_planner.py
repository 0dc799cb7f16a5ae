"""The planner of approaches: how many random queries of a scenario it solves with a certificate, and how fast.

    python benchmarks/rendezvous_planner.py [--queries 150] [--scenarios base nook ...] [--multi] [--slsqp 5]

A target like Envisat at 1/20 tumbles at 5 deg/s (`fast`: 10) about a random axis-1 motion from a random attitude; the
chaser rests 1.5 m away, or nearby (`placed`). Queries whose ends break a limit count as infeasible, not as failures. A
failure of the cold start is tried again from the bent ones.
"""

from __future__ import annotations

import argparse
import os
import time
from dataclasses import replace

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_variable] = "1"  # before NumPy is imported

import numpy as np  # noqa: E402
from rendezvous_slsqp import optimise_slsqp  # noqa: E402

from safe_inspect.dynamics.quaternion import normalise  # noqa: E402
from safe_inspect.dynamics.tumble import classify, tumble  # noqa: E402
from safe_inspect.geometry.oriented_boxes import OrientedBoxes  # noqa: E402
from safe_inspect.rendezvous.planner.problem import approach_problem  # noqa: E402
from safe_inspect.rendezvous.planner.query import Limits, PlanQuery, PlanStatus  # noqa: E402
from safe_inspect.rendezvous.planner.scp import optimise_scp  # noqa: E402
from safe_inspect.rendezvous.plugins import SplineSCPPlanner  # noqa: E402
from safe_inspect.types import FloatArray  # noqa: E402

ENVISAT = np.array([[17023.3, 397.1, -2171.4], [397.1, 124825.7, 344.2], [-2171.4, 344.2, 129112.2]])
NOOK, BASE = np.array([0.25, 0.0, 0.42]), np.array([0.0, 0.45, 0.0])
SCENARIOS = ("base", "nook", "tight", "placed", "fast", "cone")


def envisat_boxes(scale: float = 0.05) -> OrientedBoxes:
    """Return bus, solar array, boom and radar antenna."""
    tilt = np.deg2rad(22.0)
    turned = np.array([[1.0, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    centre = np.array([[-1.14, 0, 0], [12.9, 0, 0], [4.88, 0, 0], [-1.14, 0, -1.45]])
    half_size = np.array([[5, 1.375, 1.05], [7, 2.5, 0.06], [1.02, 0.15, 0.15], [5, 0.65, 0.10]])
    return OrientedBoxes(scale * centre, scale * half_size, np.stack((np.eye(3), turned, np.eye(3), np.eye(3))))


def principal_axes(inertia: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the principal moments, ascending, and R_MT with a positive diagonal."""
    moments, axes = np.linalg.eigh(inertia)
    return moments, axes * np.sign(np.diag(axes))


def random_query(scenario: str, generator: np.random.Generator) -> PlanQuery:
    """Return a query of a scenario, with random attitude and phase."""
    moments, r_mt = principal_axes(ENVISAT)
    rate = np.deg2rad(10.0 if scenario == "fast" else 5.0)
    direction = np.array([0.7, 0.5, 0.5])
    w = rate * direction / np.linalg.norm(direction)
    q = normalise(generator.normal(size=4))
    phase = generator.uniform(0.0, classify(moments, w[None]).period[0])
    _, w_t = tumble(moments, q[None], w[None], np.array([phase]))
    position = np.array([0.0, -1.5, 0.0])
    if scenario == "placed":
        position = position + generator.uniform(-0.2, 0.2, 3)
    limits, margin = Limits(), 0.08
    if scenario == "tight":
        limits, margin = replace(limits, planned_force=0.12, speed=0.09), 0.10
    if scenario == "fast":
        limits = replace(limits, line_of_sight_rate=0.35)
    if scenario == "cone":
        limits = replace(limits, cone=np.deg2rad(30.0))
    return PlanQuery(
        t0=0.0,
        state=np.concatenate((position, np.zeros(3))),
        orientation=q,
        angular_velocity=w_t[0, 0],
        inertia=moments,
        mating_point=BASE if scenario in ("base", "cone") else NOOK,
        solid=envisat_boxes(),
        R_MT=r_mt,
        limits=limits,
        margin=lambda times: np.full(times.shape, margin),
    )


def run(scenario: str, queries: int, multi: bool, seed: int) -> None:
    """Solve the queries of a scenario and print what came of them."""
    generator = np.random.default_rng([seed, SCENARIOS.index(scenario)])
    cold, seconds, busy, costs, iterations = [], [], [], [], []
    infeasible = solved = 0
    planner = SplineSCPPlanner(multi_start=multi)
    for number in range(queries):
        query = random_query(scenario, generator)
        began, used = time.perf_counter(), time.process_time()
        plan = planner(query)
        seconds.append(time.perf_counter() - began)
        busy.append(time.process_time() - used)
        if plan.status in (PlanStatus.TERMINAL_INFEASIBLE, PlanStatus.START_INFEASIBLE):
            infeasible += 1
            continue
        is_cold = plan.solved and (multi or plan.report.starts == 1)
        cold.append(is_cold)
        iterations.append(plan.report.iterations)
        if not is_cold:
            print(f"  {scenario} {number}: the cold start fails; {plan.status.value} {plan.report.message}")
        solved += plan.solved
        costs.append(plan.report.cost if plan.solved else np.nan)
    print(
        f"{scenario:7} {'multi' if multi else 'cold '} {sum(cold)}/{len(cold)}, several starts {solved}/{len(cold)}"
        f" ({infeasible} infeasible), processor mean {np.mean(busy):.3f} s, wall mean {np.mean(seconds):.3f} s,"
        f" median {np.median(seconds):.3f} s,"
        f" p99 {np.quantile(seconds, 0.99):.3f} s, {np.mean(iterations):.1f} iterations,"
        f" cost {np.nanmedian(costs):.4f} N^2 s",
        flush=True,
    )


def cross_check(scenario: str, queries: int, seed: int) -> None:
    """Solve queries by both optimisers from the cheapest spline, and print costs and times."""
    generator = np.random.default_rng([seed, SCENARIOS.index(scenario)])
    ratios, seconds = [], []
    for _ in range(queries):
        problem = approach_problem(random_query(scenario, generator), 0.0, 60.0, 20, 121)
        results = []
        for optimiser in (optimise_scp, optimise_slsqp):
            used = time.process_time()
            results.append(optimiser(problem, problem.cold()))
            seconds.append(time.process_time() - used)
        if all(result.feasible for result in results):
            ratios.append(results[0].cost / results[1].cost)
    spent = np.reshape(seconds, (-1, 2)).mean(axis=0)
    print(
        f"{scenario:7} both solved {len(ratios)}/{queries}, cost of convex programming / SLSQP: median"
        f" {np.median(ratios):.4f}, {np.min(ratios):.3f} to {np.max(ratios):.3f};"
        f" processor {spent[0]:.3f} and {spent[1]:.3f} s",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--queries", type=int, default=150)
    parser.add_argument("--scenarios", nargs="+", choices=SCENARIOS, default=SCENARIOS)
    parser.add_argument("--multi", action="store_true", help="always try the bent starts too")
    parser.add_argument("--slsqp", type=int, default=0, help="queries of each scenario to solve by SLSQP too")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    for scenario in arguments.scenarios:
        if arguments.queries:
            run(scenario, arguments.queries, arguments.multi, arguments.seed)
        if arguments.slsqp:
            cross_check(scenario, arguments.slsqp, arguments.seed)


if __name__ == "__main__":
    main()
