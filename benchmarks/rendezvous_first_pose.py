"""How often the first pose of a known target is right: the front end alone, on random tumbles.

    python benchmarks/rendezvous_first_pose.py [--target upper_stage] [--tumbles 100] [--seconds 40] [--seed 1] \
        [OVERRIDE ...]

Overrides are those of configs/tumbling-rendezvous/experiment.yml. A pose is wrong if its attitude is off by more than
10 degrees. The summary counts the tumbles in which the shape was found, in which the first pose was wrong, and in
which the last one was, and gives the time until the first pose and how many of the following frames gave no pose.
"""

from __future__ import annotations

import numpy as np
from machine import machine
from rendezvous_perception import gyro_turn
from tumbles import FOLDER, Job, measured, parsed

from safe_inspect.geometry.pointing import R_BC
from safe_inspect.metrics.statistics import wilson
from safe_inspect.missions.sensor_log_writer import watch
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.experiment import load_rendezvous
from safe_inspect.rendezvous.front_end.base import FrontEndContext
from safe_inspect.rendezvous.plugins import ModelFrontEnd, PipelineEstimator
from safe_inspect.rendezvous.poses import MODEL, difference, pose

_WRONG = 10.0


def _measure(job: Job) -> tuple[int, float, float, float, float]:
    """Return number, time of the first pose [s], errors of the first and last pose [degrees], frames without one."""
    overrides, number, seconds = job
    config = load_rendezvous(f"{FOLDER}/experiment.yml", overrides).config
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
    assert __doc__ is not None
    arguments = parsed(__doc__, 40.0, 100)
    rows = []
    for row in measured(_measure, arguments):
        rows.append(row)
        print(f"tumble {row[0]} of {arguments.tumbles}: first pose at {row[1]:.0f} s, off by {row[2]:.1f}, "
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
