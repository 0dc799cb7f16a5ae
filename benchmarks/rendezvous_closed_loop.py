"""Closed loops on random tumbles: is the target ever touched, and does a flight ever leave its tube?

    python benchmarks/rendezvous_closed_loop.py [--flights 1000] [--first 0] [--disturbance drawn] [--offset 0]
        [--json result.json] [key=value ...]

Flight i has the tumble of mission i of the shipped experiment with `RandomTumble`: a direction and an attitude uniform
at random, 2 to 5 deg/s. The approach is planned and its tube designed as in a mission, for errors of 0.7 deg and
0.07 deg/s (standard deviations of each component) at updates each second, and then flown on the truth at 8 ms, from the
planned start, with 3 mN of uniform noise on each axis. What disturbs a flight:

- `free`: the errors of the estimates as they are drawn;
- `drawn`: these errors, drawn until the references that follow from them keep the bound b(t);
- `corners`: references at a corner of the box of +-b(t) about the true one, another at each update after the first.

With `--offset f` a flight starts off its plan, by a position and a velocity along each axis that are uniform within f
times the tube. Overrides of the experiment change the chaser, such as `chaser.limits.force="0.12 N"`. The
linear-quadratic regulator without a tube, and tube model predictive control with a free nominal state (`nominal_mpc`),
fly the same plans with the same disturbances.
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
from nominal_mpc import NominalMPC  # noqa: E402

from safe_inspect.config.data import configs_root  # noqa: E402
from safe_inspect.dynamics.quaternion import exp, multiply  # noqa: E402
from safe_inspect.dynamics.tumble import tumble  # noqa: E402
from safe_inspect.metrics.statistics import wilson  # noqa: E402
from safe_inspect.missions.scenario import initial_tumbles  # noqa: E402
from safe_inspect.missions.truth import ChaserFlight  # noqa: E402
from safe_inspect.random.streams import Streams  # noqa: E402
from safe_inspect.rendezvous.control.bound import (  # noqa: E402
    Bound,
    BoundQuery,
)
from safe_inspect.rendezvous.control.design import DesignRequest, TubeDesign  # noqa: E402
from safe_inspect.rendezvous.control.tracker import LinearFeedback  # noqa: E402
from safe_inspect.rendezvous.control.tube import (  # noqa: E402
    Axis,
    TrackedReference,
    TrackingLimits,
)
from safe_inspect.rendezvous.coordination.context import (  # noqa: E402
    PlanDemands,
    clearances,
)
from safe_inspect.rendezvous.coordination.pilot import limits_of  # noqa: E402
from safe_inspect.rendezvous.estimate import BodyState, EstimateErrors  # noqa: E402
from safe_inspect.rendezvous.experiment import RendezvousConfig, load_rendezvous  # noqa: E402
from safe_inspect.rendezvous.planner.checks import certify  # noqa: E402
from safe_inspect.rendezvous.planner.problem import Path, to_inertial  # noqa: E402
from safe_inspect.rendezvous.planner.query import Plan, PlanQuery  # noqa: E402
from safe_inspect.rendezvous.target.model import Target  # noqa: E402

_SETTINGS = (
    "tumble={functor: RandomTumble}",
    "sensors.state.attitude_sigma=0.7 deg",
    "sensors.state.rate_sigma=0.07 deg/s",
)
_MOST_DRAWS = 200


def approach(config: RendezvousConfig, target: Target, number: int) -> tuple[Plan, Bound, TubeDesign] | str:
    """Return an approach with its bound and tube, or why there is none, by the turns that a mission takes."""
    mission, chaser = config.mission, config.chaser
    streams = Streams(config.seed, np.array([number]), np.zeros(1, np.int64))
    (orientation,), (rate,) = initial_tumbles(config, streams)
    errors = EstimateErrors(config.sensors.state.attitude_sigma, config.sensors.state.rate_sigma)
    limits, demands = limits_of(chaser), PlanDemands()
    state = np.concatenate((chaser.position, np.zeros(3)))
    reason = "no plan"
    for attempt in range(mission.bound_attempts):
        query = PlanQuery(
            t0=0.0,
            state=state,
            orientation=orientation,
            angular_velocity=rate,
            inertia=target.principal,
            mating_point=target.mating_point,
            solid=target.solid,
            R_MT=target.R_MT,
            limits=demands.limits(limits, state[:3]),
            margin=demands.margin,
            durations=mission.durations if attempt else mission.durations[:1],
            waits=tuple(np.arange(0.0, mission.wait_limit + 0.5 * mission.wait_step, mission.wait_step).tolist()),
        )
        plan = config.planner(query)
        if not plan.solved:
            return f"plan: {plan.status.value}"
        bound = config.bound(BoundQuery(plan, target.principal, errors, 1.0, 0.9, chaser.mass), streams)
        design = config.tracker.design(
            DesignRequest(
                plan=plan,
                bound=bound,
                clearance=target.solid.distance(plan.position_target @ target.R_MT.T) - limits.radius,
                axis=Axis(chaser.mass, mission.step),
                limits=TrackingLimits(limits.force, chaser.limits.tracking_speed, limits.keep_in),
                force_error=chaser.actuator.force_noise,
                gain=demands.gain,
            )
        )
        exact = PlanQuery(**{**vars(query), "margin": design.margin_at})
        reason = design.refusal or "the plan does not keep the tube's clearance"
        if design.accepted and certify(exact, plan.path, plan.t_start).certified:
            return plan, bound, design
        demands = demands.after(design)
    return f"tube: {reason}"


def references(
    plan: Plan, bound: Bound, inertia: Any, errors: Any, generator: np.random.Generator, kind: str
) -> tuple[list[TrackedReference], int]:
    """Return the reference of each update, over the whole plan, and how often they were drawn."""
    every = round(1.0 / float(np.diff(plan.times).mean()))
    starts = np.arange(0, len(plan.times), every)
    if kind == "corners":
        signs = generator.choice([-1.0, 1.0], (len(starts), 2, 3))
        signs[0] = 0.0
        return [
            TrackedReference(
                plan.position + s[0] * bound.position[:, None], plan.velocity + s[1] * bound.velocity[:, None]
            )
            for s in signs
        ], 1
    path = Path(plan.position_target, plan.velocity_target, plan.acceleration_target)
    for draws in range(1, _MOST_DRAWS + 1):
        unit = generator.normal(size=(len(starts), 6))
        for j in range(1, len(starts)):
            unit[j] = 0.9 * unit[j - 1] + np.sqrt(1.0 - 0.81) * unit[j]
        attitude = multiply(plan.orientation[starts], exp(errors.attitude * unit[:, :3]))
        rate = plan.angular_velocity[starts] + errors.rate * unit[:, 3:]
        found, inside = [], True
        for j, k in enumerate(starts):
            q, w = tumble(inertia, attitude[j][None], rate[j][None], plan.times - plan.times[k])
            seen = to_inertial(inertia, q[0], w[0], path)
            used = slice(k, k + every) if kind == "drawn" else slice(0)
            inside &= bool(np.all(np.abs(seen.position[used] - plan.position[used]) <= bound.position[used, None]))
            inside &= bool(np.all(np.abs(seen.velocity[used] - plan.velocity[used]) <= bound.velocity[used, None]))
            if not inside:
                break
            found.append(TrackedReference(seen.position, seen.velocity))
        if inside:
            return found, draws
    raise RuntimeError("no draw of the estimates stays within the bound")


def fly(
    config: RendezvousConfig, target: Target, tracker: Any, approach_: tuple[Plan, Bound, TubeDesign], known: Any,
    noise: Any, offset: Any,
) -> dict[str, Any]:  # fmt: skip
    """Return the figures of one flight."""
    plan, _, design = approach_
    mission = config.mission
    every = round(1.0 / mission.step)
    level, own = np.array([0.0, 0.0, 0.0, 1.0]), config.chaser.actuator
    start = BodyState(plan.position[0] + offset[:3], plan.velocity[0] + offset[3:], level, np.zeros(3))
    flight = ChaserFlight(config, start)
    path, share, seconds, keeps, fuel, fastest = [], 0.0, [], True, 0.0, 0.0
    for k in range(len(plan.times) - 1):
        now = flight.state
        x = np.concatenate((now.position, now.velocity))
        used = time.process_time()
        output = tracker.step(x, known[k // every], k)
        seconds.append(time.process_time() - used)
        keeps &= bool((np.abs(x[:3]) <= np.array(config.chaser.limits.keep_in) + 1e-9).all())
        fastest = max(fastest, float(np.abs(x[3:]).max()))
        fuel += float(np.abs(output.force).sum()) * mission.step / config.chaser.mass
        distance = np.abs(x[:3] - plan.position[k]).max()
        share = max(share, float(distance / design.tube.clearance[k]))
        flown = (1.0 + own.scale_error) * output.force + own.force_noise * noise[k][:3]
        path.append(flight.step(flown, np.zeros(3))[0].position)  # B is along W
    positions = np.concatenate(path)
    times = plan.times[0] + mission.tick * np.arange(1, len(positions) + 1)
    q, _ = tumble(target.principal, plan.orientation[:1], plan.angular_velocity[:1], times - plan.times[0])
    return {
        "clearance": float(clearances(target, positions, q[0], config.chaser.radius).min()),
        "share": share,
        "keep_in": keeps,
        "fuel": fuel,
        "unsolved": getattr(tracker, "unsolved", 0),
        "fastest": fastest,
        "end_error": float(np.linalg.norm(flight.state.position - plan.position[-1])),
        "seconds": seconds[1:],
    }


def report(flights: list[dict[str, Any]]) -> dict[str, Any]:
    """Return what came of some flights."""
    count = len(flights)
    clearance = np.array([flight["clearance"] for flight in flights])
    ends = np.array([flight["end_error"] for flight in flights])
    share = np.array([flight["share"] for flight in flights])
    seconds = 1e3 * np.concatenate([flight["seconds"] for flight in flights])
    low, high = (100.0 * value for value in wilson(int((clearance < 0.0).sum()), count))
    return {
        "flights": count,
        "contacts": int((clearance < 0.0).sum()),
        "interval of the share of contacts [%]": [low, high],
        "least clearance [cm]": 100.0 * float(clearance.min()),
        "median of the least clearances [cm]": 100.0 * float(np.median(clearance)),
        "steps": len(seconds),
        "steps without a solution": sum(flight["unsolved"] for flight in flights),
        "flights out of the keep-in box": sum(not flight["keep_in"] for flight in flights),
        "largest speed along an axis [m/s]": max(flight["fastest"] for flight in flights),
        "mean of the sum of |force| dt / mass [m/s]": float(np.mean([flight["fuel"] for flight in flights])),
        "flights out of the tube": int((share > 1.0 + 1e-9).sum()),
        "largest share of the tube": float(share.max()),
        "end error, median, largest [cm]": [100.0 * float(np.median(ends)), 100.0 * float(ends.max())],
        "step p50, p99, processor time [ms]": np.percentile(seconds, (50, 99)).tolist(),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--disturbance", choices=("free", "drawn", "corners"), default="drawn")
    parser.add_argument("--offset", type=float, default=0.0, help="offset of the start, in widths of the tube")
    parser.add_argument("settings", nargs="*", help="overrides of the experiment, key=value")
    parser.add_argument("--json", help="file to write the figures to")
    arguments = parser.parse_args()
    file = configs_root() / "tumbling-rendezvous" / "experiment-truth.yml"
    config = load_rendezvous(file, (*_SETTINGS, *arguments.settings)).config
    target = config.target()
    errors = EstimateErrors(config.sensors.state.attitude_sigma, config.sensors.state.rate_sigma)
    results: dict[str, list[dict[str, Any]]] = {"tube": [], "lqr": [], "mpc": []}
    refused: dict[str, int] = {}
    began, draws = time.process_time(), 0
    for number in range(arguments.first, arguments.first + arguments.flights):
        found = approach(config, target, number)
        if isinstance(found, str):
            refused[found] = refused.get(found, 0) + 1
            continue
        plan, bound, design = found
        generator = np.random.default_rng([number, 14])
        known, drawn = references(plan, bound, target.principal, errors, generator, arguments.disturbance)
        draws += drawn
        noise = generator.uniform(-1.0, 1.0, (len(plan.times), 6))
        width = np.repeat((design.tube.position[0], design.tube.velocity[0]), 3)
        offset = arguments.offset * width * generator.uniform(-1.0, 1.0, 6)
        force = config.chaser.limits.force
        for name, tracker in (
            ("tube", LinearFeedback(design.axis, design.tube, force)),
            ("lqr", LinearFeedback.of_lqr(design.axis, force)),
            ("mpc", NominalMPC(design.axis, design.tube, design.limits)),
        ):
            results[name].append(fly(config, target, tracker, found, known, noise, offset))
        if (number + 1 - arguments.first) % 50 == 0 or number + 1 == arguments.first + arguments.flights:
            figures: dict[str, Any] = {name: report(flights) for name, flights in results.items() if flights}
            figures |= {"refused": refused, "draws of the estimates": draws}
            figures["processor time [s]"] = time.process_time() - began
            print(json.dumps(figures, indent=1), flush=True)
            if arguments.json:
                with open(arguments.json, "w", encoding="utf-8") as out:
                    json.dump(figures, out, indent=1)


if __name__ == "__main__":
    main()
