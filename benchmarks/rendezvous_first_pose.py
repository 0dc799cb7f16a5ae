"""How often the first pose of a known target is right: the front end alone, on random tumbles.

    python benchmarks/rendezvous_first_pose.py [--target upper_stage] [--tumbles 100] [--seconds 40] [--seed 1] \
        [OVERRIDE ...]

Overrides are those of configs/tumbling-rendezvous/experiment.yml. A pose is wrong if its attitude is off by more than
10 degrees. The summary counts the tumbles in which the shape was found, in which the first pose was wrong, and in
which the last one was, and gives the time until the first pose and how many of the following frames gave no pose.
"""

from __future__ import annotations

import argparse
import os
from multiprocessing import get_context

import numpy as np
from machine import machine
from rendezvous_perception import gyro_turn

from safe_inspect.geometry.pointing import R_BC
from safe_inspect.metrics.statistics import wilson
from safe_inspect.missions.sensor_log_writer import watch
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.experiment import load_rendezvous
from safe_inspect.rendezvous.front_end.base import FrontEndContext
from safe_inspect.rendezvous.plugins import ModelFrontEnd, PipelineEstimator
from safe_inspect.rendezvous.poses import MODEL, difference, pose

_FOLDER = "configs/tumbling-rendezvous"
_WRONG = 10.0


def _measure(job: tuple[tuple[str, ...], int, float]) -> tuple[int, float, float, float, float]:
    """Return number, time of the first pose [s], errors of the first and last pose [degrees], frames without one."""
    overrides, number, seconds = job
    config = load_rendezvous(f"{_FOLDER}/experiment.yml", overrides).config
    estimator = config.estimator
    front_end = estimator.front_end if isinstance(estimator, PipelineEstimator) else ModelFrontEnd()
    streams = Streams(config.seed, np.array([number]), np.zeros(1, np.int64))
    mount = pose(R_BC, np.array(config.chaser.camera_position))
    run = front_end(FrontEndContext(config.sensors.camera.geometry, mount, config.target(), streams))
    times, errors, last = [], [], 0.0
    for seen in watch(config, number, seconds):
        last = seen.frame.time
        for edge in run.step(seen.frame, None, gyro_turn(seen)):
            if edge.first == MODEL:
                times.append(last)
                errors.append(float(np.rad2deg(np.linalg.norm(difference(seen.T_MB, edge.pose)[:3]))))
    if not times:
        return number, np.nan, np.nan, np.nan, np.nan
    missing = (last - times[0]) / config.sensors.frame_period + 1.0 - len(times)
    return number, times[0], errors[0], errors[-1], missing


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("overrides", nargs="*", metavar="OVERRIDE")
    parser.add_argument("--target", help="a file of configs/tumbling-rendezvous/targets; Envisat by default")
    parser.add_argument("--tumbles", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=40.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    target = [f"target=!include {_FOLDER}/targets/{arguments.target}.yml"] if arguments.target else []
    overrides = ("tumble={functor: RandomTumble}", f"seed={arguments.seed}", *target, *arguments.overrides)
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    jobs = [(overrides, number, arguments.seconds) for number in range(arguments.tumbles)]
    rows = []
    with get_context("spawn").Pool(arguments.workers) as pool:
        for row in pool.imap_unordered(_measure, jobs):
            rows.append(row)
            print(f"{len(rows)} of {len(jobs)}: tumble {row[0]}, first pose at {row[1]:.0f} s, off by {row[2]:.1f}, "
                  f"in the end by {row[3]:.1f} degrees, {row[4]:.0f} frames without", flush=True)  # fmt: skip
    _, times, first, final, missing = np.array(sorted(rows)).T
    found = np.isfinite(times)
    for name, count, of in (
        ("shape found", int(found.sum()), len(rows)),
        ("first pose wrong", int((first[found] > _WRONG).sum()), int(found.sum())),
        ("last pose wrong", int((final[found] > _WRONG).sum()), int(found.sum())),
    ):
        low, high = wilson(count, of) if of else (np.nan, np.nan)
        print(f"{name}: {count} of {of} [{100.0 * low:.1f} %, {100.0 * high:.1f} %]")
    if found.any():
        print(f"first pose after {np.median(times[found]):.0f} s (median), {np.nanmax(times):.0f} s (largest); "
              f"{int(np.nansum(missing))} frames without a pose after it")  # fmt: skip
    print(f"{arguments.target or 'Envisat'}, seed {arguments.seed}, {' '.join(arguments.overrides)}; {machine()}")


if __name__ == "__main__":
    main()
