"""Tubes of a rendezvous: how wide are they, does a flight ever leave one, and how long is a step?

    python benchmarks/rendezvous_tube.py [--plans 20] [--draws 5] [--json result.json]

The reference data are approaches of 60 s to a mating point of a body that tumbles at 5 degrees per second,
from 1.5 m and random attitudes; obstacles are ignored. The estimate has errors of 0.7 degrees and 0.07 degrees per
second (standard deviations, each component), renewed at 1 Hz; bounds are joint and conformal at 95 %. In a flight each
update's estimate is propagated to the end, as a chaser would, and 3 mN of uniform noise act on each axis.
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

from safe_inspect.dynamics.quaternion import exp, multiply  # noqa: E402
from safe_inspect.dynamics.tumble import tumble  # noqa: E402
from safe_inspect.geometry.oriented_boxes import OrientedBoxes  # noqa: E402
from safe_inspect.random.streams import Streams  # noqa: E402
from safe_inspect.rendezvous.control.bound import Bound, conformal_bound  # noqa: E402
from safe_inspect.rendezvous.control.design import DesignRequest, TubeDesign, design_tube  # noqa: E402
from safe_inspect.rendezvous.control.mpc import TubeMPC  # noqa: E402
from safe_inspect.rendezvous.control.tightening import TrackedReference, TrackingLimits  # noqa: E402
from safe_inspect.rendezvous.control.tracker import AxisStatus, LQRTrackerRun, TrackerOutput  # noqa: E402
from safe_inspect.rendezvous.control.trials import BoundQuery, Updates, sample_errors  # noqa: E402
from safe_inspect.rendezvous.control.tube import Axis, no_tube  # noqa: E402
from safe_inspect.rendezvous.estimate import EstimateErrors  # noqa: E402
from safe_inspect.rendezvous.planner.paths import SplinePath  # noqa: E402
from safe_inspect.rendezvous.planner.problem import Path, approach_problem, sampled_plan, to_inertial, torque_free  # noqa: E402
from safe_inspect.rendezvous.planner.query import Plan, PlanQuery  # noqa: E402

AXIS = Axis(9.583788668)
INERTIA = np.array([0.1314, 0.9661, 1.0])
ERRORS = EstimateErrors(float(np.deg2rad(0.7)), float(np.deg2rad(0.07)))
LIMITS = TrackingLimits(keep_in=(1.6, 3.0, 1.6))
UPDATE = 5  # steps of control


class PlainMPC(TubeMPC):
    """Model predictive control without a tube: each step starts from the measured error."""

    def step(self, estimate: Any, reference: TrackedReference, k: int) -> TrackerOutput:
        """Return the force at a step."""
        self._solutions = [None] * 3
        return super().step(estimate, reference, k)


def straight_plan(generator: Any) -> Plan:
    """Return the cheapest approach to a target of random attitude, whatever is in its way."""
    orientation = generator.normal(size=4)
    rate = np.array([0.7, 0.5, 0.5])
    query = PlanQuery(
        t0=0.0,
        state=np.array([0.0, -1.5, 0.0, 0.0, 0.0, 0.0]),
        orientation=orientation / np.linalg.norm(orientation),
        angular_velocity=np.deg2rad(5.0) * rate / np.linalg.norm(rate),
        inertia=INERTIA,
        mating_point=np.array([0.25, 0.0, 0.42]),
        boxes=OrientedBoxes(np.zeros((1, 3)), np.full((1, 3), 0.1), np.eye(3)[None]),
        R_MT=np.eye(3),
    )
    problem = approach_problem(query, 0.0, 60.0, 20, 121)
    return sampled_plan(query, SplinePath(problem.basis, problem.cold()))


def bound_of(plan: Plan, seed: int, trials: int = 300) -> Bound:
    streams = Streams(seed, np.arange(trials), np.zeros(trials, dtype=np.int64))
    return conformal_bound(sample_errors(BoundQuery(plan, INERTIA, ERRORS, Updates(1.0)), streams))


def estimates(plan: Plan, generator: Any) -> list[TrackedReference]:
    """Return the reference of each update, propagated over the whole plan."""
    path = Path(plan.position_target, plan.velocity_target, plan.acceleration_target)
    references = []
    for k in range(0, len(plan.times), UPDATE):
        attitude = multiply(plan.orientation[k], exp(ERRORS.attitude * generator.normal(size=3)))
        rate = plan.angular_velocity[k] + ERRORS.rate * generator.normal(size=3)
        q, w = tumble(INERTIA, attitude[None], rate[None], plan.times - plan.times[k])
        outside = to_inertial(torque_free(INERTIA, q[0], w[0]), path)
        references.append(TrackedReference(outside.position, outside.velocity))
    return references


def fly(tracker: Any, plan: Plan, design: TubeDesign, known: list[TrackedReference], noise: Any) -> dict[str, Any]:
    """Return the figures of one flight."""
    state = np.stack((plan.position[0], plan.velocity[0]), axis=1)
    seconds, share, peak, worst, unsolved = [], 0.0, 0.0, 0.0, 0
    for k in range(len(plan.times)):
        began, used = time.perf_counter(), time.process_time()
        output = tracker.step(state.T.ravel(), known[k // UPDATE], k)
        seconds.append((time.perf_counter() - began, time.process_time() - used))
        error = np.abs(state[:, 0] - plan.position[k])
        deviation = np.abs(state[:, 0] - plan.position[k] - output.nominal[:, 0])
        share = max(share, float((deviation / design.tube.clearance[k]).max()))
        worst, peak = max(worst, float(np.linalg.norm(error))), max(peak, float(np.abs(output.force).max()))
        unsolved += max(output.status) is not AxisStatus.SOLVED
        if k + 1 < len(plan.times):
            state = state @ AXIS.A.T + (output.force + noise[k])[:, None] * AXIS.B
    return {
        "share": share,
        "largest error": worst,
        "end error": float(np.linalg.norm(state[:, 0] - plan.position[-1])),
        "peak force": peak,
        "unsolved": unsolved,
        "seconds": seconds,
    }


def within(plan: Plan, known: list[TrackedReference], bound: Bound) -> bool:
    """Whether a flight's estimates keep the bound while they are in use."""
    return all(
        np.all(np.abs(known[k // UPDATE].position[k] - plan.position[k]) <= bound.position[k])
        and np.all(np.abs(known[k // UPDATE].velocity[k] - plan.velocity[k]) <= bound.velocity[k])
        for k in range(len(plan.times))
    )


def summary(flights: list[dict[str, Any]], kept: list[bool]) -> dict[str, Any]:
    seconds = np.concatenate([flight["seconds"][1:] for flight in flights]) * 1e3
    return {
        "flights": len(flights),
        "within b": sum(kept),
        "left the tube": sum(flight["share"] > 1.0 for flight in flights),
        "left it within b": sum(flight["share"] > 1.0 for flight, inside in zip(flights, kept, strict=True) if inside),
        "largest share of the tube": max(flight["share"] for flight in flights),
        "unsolved steps": sum(flight["unsolved"] for flight in flights),
        "largest error [m]": max(flight["largest error"] for flight in flights),
        "end error, mean [m]": float(np.mean([flight["end error"] for flight in flights])),
        "end error, largest [m]": max(flight["end error"] for flight in flights),
        "peak force [N]": max(flight["peak force"] for flight in flights),
        "step p50, p99 [ms]": np.percentile(seconds[:, 0], (50, 99)).tolist(),
        "step p50, p99, processor time [ms]": np.percentile(seconds[:, 1], (50, 99)).tolist(),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plans", type=int, default=20)
    parser.add_argument("--draws", type=int, default=5, help="flights of each plan")
    parser.add_argument("--json", help="file to write the figures to")
    arguments = parser.parse_args()
    generator = np.random.default_rng(0)
    designs: list[TubeDesign] = []
    results: dict[str, list[dict[str, Any]]] = {"tube": [], "plain": [], "lqr": []}
    kept: list[bool] = []
    refused = 0
    began = time.perf_counter()
    for seed in range(arguments.plans):
        plan = straight_plan(generator)
        bound, far = bound_of(plan, seed), np.full(len(plan.times), np.inf)
        design = design_tube(DesignRequest(plan, bound, far, AXIS, LIMITS, force_error=3e-3), reserve=0.03)
        if not design.accepted:
            refused += 1
            print(design.refusal)
            continue
        designs.append(design)
        for _ in range(arguments.draws):
            known = estimates(plan, generator)
            noise = generator.uniform(-3e-3, 3e-3, (len(plan.times), 3))
            kept.append(within(plan, known, bound))
            trackers = {
                "tube": TubeMPC(AXIS, design.tube, LIMITS),
                "plain": PlainMPC(AXIS, no_tube(1), LIMITS),
                "lqr": LQRTrackerRun(AXIS),
            }
            for name, tracker in trackers.items():
                results[name].append(fly(tracker, plan, design, known, noise))
    if not designs:
        raise SystemExit("no plan was accepted")
    margins = np.array([design.margin for design in designs])
    figures = {
        "refused plans": refused,
        "natural frequency at the start and the end, median [rad/s]": [
            float(np.median([np.sqrt(-design.tube.gain_at(k)[0] / AXIS.mass) for design in designs])) for k in (0, 300)
        ],
        "margin at 0, 10 s, end, largest; median [m]": [
            float(np.median(values)) for values in (margins[:, 0], margins[:, 50], margins[:, -1], margins.max(axis=1))
        ],
        "least force reserve [N]": min(float(design.force_reserve.min()) for design in designs),
        **{name: summary(flights, kept) for name, flights in results.items()},
        "seconds": time.perf_counter() - began,
    }
    print(json.dumps(figures, indent=1))
    if arguments.json:
        with open(arguments.json, "w", encoding="utf-8") as file:
            json.dump(figures, file, indent=1)


if __name__ == "__main__":
    main()
