"""How well a tumbling target is known after an observation, from depth frames and an inertial unit.

    python benchmarks/rendezvous_estimation.py --missions 20 --seconds 120
    python benchmarks/rendezvous_estimation.py --missions 20 estimator.config.camera.config.profile=clean
    python benchmarks/rendezvous_estimation.py --missions 20 estimator.config.front_end.functor=GicpSubmapFrontEnd

Each mission draws its own attitude and noise, and ends after the observation. Attitude is that of the principal axes as
the chaser sees them, R_BT; axes are those in the glued frame; ahead is the attitude 60 s later, in W. NEES has six
degrees of freedom: attitude and rate against the covariance that the bound is made from.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, log, multiply
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.rendezvous.back_end.graph import PoseGraph
from safe_inspect.rendezvous.estimate import BodyState, StateEstimate
from safe_inspect.rendezvous.estimation.consistency import attitude_error, normalised_error
from safe_inspect.rendezvous.experiment import load_rendezvous
from safe_inspect.rendezvous.mission import Mission
from safe_inspect.rendezvous.target.model import Target

_EXPERIMENT = Path(__file__).parents[1] / "configs" / "tumbling-rendezvous" / "experiment.yml"
_FIGURES = ("attitude", "ahead", "rate", "axes", "k1", "k2", "centre", "nees", "sigma", "graph_ms")
_AHEAD = 60.0


class _Stopwatch:
    """Adds up the processor time of the graph's updates."""

    def __init__(self) -> None:
        self.times: list[float] = []
        update = PoseGraph.update

        def timed(graph: PoseGraph, *arguments: Any, **named: Any) -> None:
            before = time.process_time()
            update(graph, *arguments, **named)
            self.times.append(time.process_time() - before)

        PoseGraph.update = timed  # type: ignore[method-assign]


class _Observation(Mission):
    """A mission whose newest estimate can be read."""

    @property
    def estimate(self) -> StateEstimate:
        """The newest estimate."""
        return self._flight.estimate

    @property
    def target(self) -> Target:
        """The target."""
        return self._flight.target

    @property
    def truth(self) -> tuple[BodyState, BodyState]:
        """The true states of chaser and target."""
        return self._truth.chaser, self._truth.target


def observe(number: int, seconds: float, overrides: list[str], watch: _Stopwatch) -> dict[str, float | bool]:
    """Return the errors at the end of one observation; angles in degrees."""
    limits = [f"mission.observe={seconds + 60.0} s", "mission.observe_limit=2000 s", f"mission.time_limit={seconds} s"]
    mission = _Observation(load_rendezvous(_EXPERIMENT, [*limits, *overrides]).config, number)
    watch.times.clear()
    arrays = mission.run().log.arrays()
    estimate, last = mission.estimate, {name: array[-1] for name, array in arrays.items()}
    target = mission.target
    later = last["t"] + np.array([0.0, _AHEAD])
    true_q = tumble(target.principal, last["target_q"][None], last["target_w"][None], later - last["t"])[0][0]
    found_q, _ = estimate.predict(later)
    at_start, _ = estimate.predict(np.zeros(1))
    chaser, body = mission.truth
    rate = estimate.target.angular_velocity - body.angular_velocity
    ratios = target.principal[:2] / target.principal[2]
    share = estimate.inertia[:2] / estimate.inertia[2] / ratios - 1.0
    centre = estimate.chaser.position - estimate.target.position - chaser.position
    return {
        "attitude": _degrees(attitude_error(estimate, chaser, body)),
        "ahead": _degrees(log(multiply(conjugate(true_q[1]), found_q[1]))),
        "rate": _degrees(rate),
        "axes": _degrees(log(multiply(conjugate(arrays["target_q"][0]), at_start[0]))),
        "k1": float(100.0 * abs(share[0])),
        "k2": float(100.0 * abs(share[1])),
        "centre": float(np.linalg.norm(centre)),
        "nees": normalised_error(estimate, chaser, body),
        "sigma": float(np.rad2deg(estimate.errors.attitude)),
        "graph_ms": float(1e3 * np.mean(watch.times)) if watch.times else float("nan"),
        "known": not estimate.problem,
    }


def _degrees(vector: Any) -> float:
    return float(np.rad2deg(np.linalg.norm(vector)))


def main() -> None:
    """Observe, and print a line a mission and the medians."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("overrides", nargs="*", help="key=value of the experiment")
    parser.add_argument("--missions", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_intermixed_args()
    watch, rows = _Stopwatch(), []
    print("mission " + " ".join(f"{name:>9}" for name in _FIGURES), flush=True)
    for number in range(options.first, options.first + options.missions):
        rows.append(observe(number, options.seconds, options.overrides, watch))
        print(f"{number:7d} " + " ".join(f"{rows[-1][name]:9.3f}" for name in _FIGURES), rows[-1]["known"], flush=True)
        if options.json is not None:
            options.json.write_text(json.dumps(rows), encoding="utf-8")
    for name, percent in (("median", 50), ("95 %", 95)):
        print(f"{name:>7} " + " ".join(f"{np.percentile([row[n] for row in rows], percent):9.3f}" for n in _FIGURES))
    print(f"   mean {'':>69} {np.mean([row['nees'] for row in rows]):9.3f} (NEES; 6 expected)")


if __name__ == "__main__":
    main()
