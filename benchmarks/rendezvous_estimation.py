r"""How well a tumbling target is known after an observation, from depth frames and an inertial unit.

    python benchmarks/rendezvous_estimation.py --missions 20 --seconds 120
    python benchmarks/rendezvous_estimation.py --missions 20 --group clean
    python benchmarks/rendezvous_estimation.py --missions 20 estimator.config.front_end.functor=GicpSubmapFrontEnd
    python benchmarks/rendezvous_estimation.py --missions 100 --first 50000 --group nominal --json nominal.jsonl \
        "tumble={functor: RandomTumble}"

Each mission draws its own attitude and noise, and ends after the observation. Attitude is that of the principal axes as
the chaser sees them, R_BT; axes are those in the glued frame; ahead is the attitude 60 s later, in W.

Three squared errors over their covariance (NEES) are measured, the first two with six degrees of freedom: attitude and
rate of the target against the covariance that the bound is made from, at the end (nees) and as the mean of all seconds
from the first at which the motion is known (nees_all); and the turn of the chaser's attitude in W against the factor
graph's covariance, three degrees of freedom, as the mean of all seconds from the first (turn_nees), and the turn at the
end in degrees (turn). `--json` gets a line a mission; missions with the same settings that it has are not flown again.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import bootstrap, chi2

from safe_inspect.dynamics.quaternion import conjugate, from_matrix, log, multiply
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.metrics.statistics import wilson
from safe_inspect.missions.mission import Mission
from safe_inspect.missions.summary import attitude_error, normalised_error
from safe_inspect.rendezvous.coordination.context import MissionContext
from safe_inspect.rendezvous.estimate import BodyState, StateEstimate
from safe_inspect.rendezvous.estimation.graph import PoseGraph
from safe_inspect.rendezvous.experiment import RendezvousConfig, load_rendezvous
from safe_inspect.rendezvous.target.model import Target

_EXPERIMENT = Path(__file__).parents[1] / "configs" / "tumbling-rendezvous" / "experiment.yml"
_FIGURES = (
    "attitude", "ahead", "rate", "axes", "k1", "k2", "centre", "nees", "nees_all", "turn", "turn_nees", "sigma",
    "graph_ms",
)  # fmt: skip
_AHEAD = 60.0
_PROFILE = "sensors.camera.profile"
_GROUPS = {
    "nominal": (f"{_PROFILE}=nominal",),
    "clean": (f"{_PROFILE}=clean",),
    "harsh": (f"{_PROFILE}=harsh",),
    "actuators": (f"{_PROFILE}=nominal", "chaser.actuator.scale_error=0.05", "chaser.actuator.lag=0.4 s"),
}
#: Degrees of freedom of each NEES.
_FREEDOM = {"nees": 6, "nees_all": 6, "turn_nees": 3}


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
    """A mission whose newest estimate can be read, and that compares the turn of W with its covariance each second."""

    def __init__(self, config: RendezvousConfig, number: int) -> None:
        super().__init__(config, number, watch=self._compare)
        self.turns: list[tuple[float, float]] = []
        self._attitude = np.array([0.0, 0.0, 0.0, 1.0])  # of the chaser when the newest frame was taken

    def _compare(self, context: MissionContext) -> None:
        pipeline = self.pilot.estimator.pipeline  # type: ignore[attr-defined]
        graph = pipeline.graph
        if context.step % 5 == 0:
            self._attitude = self._truth.chaser.orientation.copy()
        elif graph is not None and context.step % 5 == 1:  # the poses of a frame are known a control step later
            turn = log(multiply(conjugate(self._attitude), from_matrix(graph.chaser[:3, :3])))
            squared = float(turn @ np.linalg.solve(graph.chaser_covariance[:3, :3], turn))
            self.turns.append((_degrees(turn), squared))

    @property
    def estimate(self) -> StateEstimate:
        """The newest estimate."""
        return self.pilot.context.estimate

    @property
    def target(self) -> Target:
        """The target."""
        return self.pilot.context.target

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
        "nees_all": float(np.nanmean(arrays["nees"][::5])),
        "turn": mission.turns[-1][0],
        "turn_nees": float(np.mean([squared for _, squared in mission.turns])),
        "sigma": float(np.rad2deg(estimate.errors.attitude)),
        "graph_ms": float(1e3 * np.mean(watch.times)) if watch.times else float("nan"),
        "known": not estimate.problem,
    }


def _degrees(vector: Any) -> float:
    return float(np.rad2deg(np.linalg.norm(vector)))


def _print_consistency(rows: list[dict[str, Any]]) -> None:
    """Print the mean of each NEES and the share beyond its 95th percentile, with intervals of 95 %."""
    for name, freedom in _FREEDOM.items():
        values = np.array([row[name] for row in rows])
        values = values[np.isfinite(values)]
        most = float(chi2.ppf(0.95, freedom))
        count = int((values > most).sum())
        mean, share = (
            f"mean {values.mean():.2f}",
            ", ".join(f"{bound:.3f}" for bound in wilson(count, len(values))),
        )
        if len(values) > 2:
            low, high = bootstrap((values,), np.mean, rng=np.random.default_rng(0)).confidence_interval
            mean += f" [{low:.2f}, {high:.2f}]"
        print(f"{name:>9}: {mean} ({freedom} expected), {count} of {len(values)} above {most:.2f} [{share}]")


def main() -> None:
    """Observe, and print a line a mission, the medians and how consistent the covariances are."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("overrides", nargs="*", help="key=value of the experiment")
    parser.add_argument("--missions", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--group", choices=sorted(_GROUPS), default="nominal")
    parser.add_argument(
        "--json", type=Path, help="lines of JSON, one for each mission; those in it are not flown again"
    )
    options = parser.parse_intermixed_args()
    settings = [f"seconds={options.seconds:g}", *_GROUPS[options.group], *options.overrides]
    done = {}
    if options.json is not None and options.json.exists():
        lines = [json.loads(line) for line in options.json.read_text(encoding="utf-8").splitlines()]
        done = {line["mission"]: line for line in lines if line["settings"] == settings}
    watch, rows = _Stopwatch(), []
    print("mission " + " ".join(f"{name:>9}" for name in _FIGURES), flush=True)
    for number in range(options.first, options.first + options.missions):
        row = done.get(number)
        if row is None:
            row = observe(number, options.seconds, settings[1:], watch)
            row = {"mission": number, "settings": settings, **row}
            if options.json is not None:
                with options.json.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(row) + "\n")
        rows.append(row)
        print(f"{number:7d} " + " ".join(f"{row[name]:9.3f}" for name in _FIGURES), row["known"], flush=True)
    for name, percent in (("median", 50), ("95 %", 95)):
        print(f"{name:>7} " + " ".join(f"{np.percentile([row[n] for row in rows], percent):9.3f}" for n in _FIGURES))
    _print_consistency(rows)


if __name__ == "__main__":
    main()
