"""How well the attitude of a tumbling target is predicted while the camera sees nothing, and whether its sigma holds.

    python benchmarks/rendezvous_dark.py [OVERRIDE ...] [--periods 441 147 88 63] [--missions 10] [--watch 120]
        [--dark 60] [--seed 1]

For each period of the polhode [s] (those of Sensors 25(3) 647, 2025), missions of the default target with a random
direction of the angular velocity, whose magnitude gives the period; directions that need less than 0.5 or more than
10 deg/s are drawn again. The chaser watches, then the camera is dark. In this time the error of the predicted attitude
R_BT is compared with its covariance at each control step: its largest component in standard deviations, and the norm.
Overrides are those of configs/tumbling-rendezvous/experiment.yml.
"""

from __future__ import annotations

import argparse
import os
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np
from machine import machine
from tumbles import check_overrides

from safe_inspect.dynamics.tumble import classify
from safe_inspect.metrics.statistics import wilson
from safe_inspect.missions.mission import Mission
from safe_inspect.missions.summary import attitude_error
from safe_inspect.rendezvous.coordination.context import MissionContext
from safe_inspect.rendezvous.estimate import JointErrors
from safe_inspect.rendezvous.experiment import RendezvousConfig, load_rendezvous

_EXPERIMENT = "configs/tumbling-rendezvous/experiment.yml"
_LIMITS = np.deg2rad([0.5, 10.0])


class _Row(NamedTuple):
    """Figures of a mission; errors in degrees, ratios in standard deviations."""

    number: int
    period: float
    rate: float
    largest: float
    sigma: float
    ratio: float
    is_known: bool


class _Watch(Mission):
    """A mission that compares the estimated attitude with the truth at each step."""

    def __init__(self, config: RendezvousConfig, number: int, dark: float) -> None:
        super().__init__(config, number, watch=self._compare)
        self._dark, self.rows = dark, []

    def _compare(self, context: MissionContext) -> None:
        estimate = context.estimate
        if not isinstance(estimate.errors, JointErrors) or estimate.time < self._dark:
            return
        error = attitude_error(estimate, self._truth.chaser, self._truth.target)
        sigmas = np.sqrt(np.diag(estimate.errors.joint)[2:5])
        self.rows.append((estimate.time, np.linalg.norm(error), sigmas.max(), np.abs(error / sigmas).max()))


def _measure(job: tuple[tuple[str, ...], int, float, float, float]) -> _Row:
    overrides, number, period, watch, dark = job
    inertia = load_rendezvous(_EXPERIMENT, overrides).config.target().principal
    random, rate = np.random.default_rng([number, round(period)]), 0.0
    while not _LIMITS[0] <= rate <= _LIMITS[1]:
        direction = random.normal(size=3)
        direction /= np.linalg.norm(direction)
        rate = float(classify(inertia, direction[None]).period[0]) / period
    tumble = f"{{functor: TriAxialTumble, config: {{rate: {rate} rad/s, direction: {direction.tolist()}}}}}"
    limits = (f"mission.observe={watch + dark + 60.0} s", f"mission.time_limit={watch + dark} s")
    fault = f"mission.faults=[{{kind: camera, start: {watch} s, duration: {dark + 60.0} s}}]"
    config = load_rendezvous(_EXPERIMENT, [*limits, fault, f"tumble={tumble}", *overrides]).config
    mission = _Watch(config, number, watch)
    mission.run()
    rows = np.array(mission.rows)
    if not len(rows):
        return _Row(number, period, np.rad2deg(rate), *([np.nan] * 3), False)
    errors, sigmas = np.rad2deg(rows[:, 1]), np.rad2deg(rows[:, 2])
    return _Row(number, period, np.rad2deg(rate), errors.max(), sigmas[-1], rows[:, 3].max(), True)


def main() -> None:
    """Print a line for each mission and a table for each period."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("overrides", nargs="*", metavar="OVERRIDE")
    parser.add_argument("--periods", type=float, nargs="+", default=[441.0, 147.0, 88.0, 63.0])
    parser.add_argument("--missions", type=int, default=10)
    parser.add_argument("--watch", type=float, default=120.0, help="time of watching before [s]")
    parser.add_argument("--dark", type=float, default=60.0, help="time without a frame [s]")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    overrides = (f"seed={arguments.seed}", *arguments.overrides)
    check_overrides(parser, overrides)
    jobs = [
        (overrides, number, period, arguments.watch, arguments.dark)
        for period in arguments.periods
        for number in range(arguments.missions)
    ]
    rows = []
    with get_context("spawn").Pool(arguments.workers) as pool:
        for row in pool.imap_unordered(_measure, jobs):
            rows.append(row)
            print(f"{len(rows)} of {len(jobs)}: period {row.period:g} s, {row.rate:.2f} deg/s, error at most "
                  f"{row.largest:.2f} deg, {row.ratio:.1f} sigma", flush=True)  # fmt: skip
    print("| period of the polhode | within 3 sigma throughout | largest error in sigma: median, largest | "
          "largest error: median, largest | sigma at the end, median |\n|---|---|---|---|---|")  # fmt: skip
    for period in arguments.periods:
        found = np.array([row for row in rows if row.period == period and row.is_known])
        if not len(found):
            print(f"| {period:g} s | the motion was known in no mission | - | - | - |")
            continue
        errors, sigmas, ratios = found[:, 3], found[:, 4], found[:, 5]
        good = int((ratios <= 3.0).sum())
        low, high = wilson(good, arguments.missions)
        print(f"| {period:g} s | {good} of {arguments.missions} [{100.0 * low:.0f} %, {100.0 * high:.0f} %] | "
              f"{np.median(ratios):.1f}, {ratios.max():.1f} | {np.median(errors):.2f}, {errors.max():.2f} deg | "
              f"{np.median(sigmas):.2f} deg |")  # fmt: skip
    print(f"seed {arguments.seed}, watched for {arguments.watch:g} s, dark for {arguments.dark:g} s; {machine()}")


if __name__ == "__main__":
    main()
