r"""How well the motion of a target of unknown shape is known after an observation, on random tumbles.

    python benchmarks/rendezvous_unknown_shape.py [--target rock] [--tumbles 20] [--seconds 120] [--seed 1] \
        [OVERRIDE ...]

Each tumble is recorded and characterised as by `safe-inspect record-log` and `safe-inspect characterise`. The attitude
is that of the principal axes, up to half turns, which nothing determines; the rate is in these axes; both at the end.
Overrides are those of configs/tumbling-rendezvous/experiment.yml.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from machine import machine
from tumbles import FOLDER, Job, measured, parsed

from safe_inspect.errors import ConfigError
from safe_inspect.missions.log_estimate import estimate_log, summary_of
from safe_inspect.missions.sensor_log import read_sensor_log
from safe_inspect.missions.sensor_log_writer import record_watch
from safe_inspect.rendezvous.experiment import load_rendezvous
from safe_inspect.rendezvous.plugins import GicpSubmapFrontEnd, PipelineEstimator


def _measure(job: Job) -> tuple[float, ...]:
    """Return frames without a pose, attitude error [deg], its sigma [deg] and rate error [deg/s]; NaN if unknown."""
    overrides, number, seconds = job
    config = load_rendezvous(f"{FOLDER}/experiment.yml", overrides).config
    with TemporaryDirectory() as folder:
        record_watch(Path(folder), config, number, seconds)
        log = read_sensor_log(folder)
        try:
            found = summary_of(log, estimate_log(log, PipelineEstimator(front_end=GicpSubmapFrontEnd()), None))
        except ConfigError:
            return (float(len(log)), np.nan, np.nan, np.nan)
    errors = found["errors"]
    lost = found["frames"] - 1 - found["frames_with_edges"]
    return (
        float(lost), errors["attitude_at_the_end_deg"], found["attitude_sigma_deg"],
        errors["rate_at_the_end_deg_per_s"],
    )  # fmt: skip


def main() -> None:
    """Print a line for each tumble, then quantiles."""
    assert __doc__ is not None
    arguments = parsed(__doc__, 120.0, 20)
    rows = []
    for row in measured(_measure, arguments):
        rows.append(row)
        print(f"tumble {len(rows) - 1}: {row[0]:.0f} frames without a pose, attitude off by {row[1]:.2f} deg "
              f"(sigma {row[2]:.1f}), rate by {row[3]:.3f} deg/s", flush=True)  # fmt: skip
    lost, attitude, _, rate = np.array(rows).T
    known = np.isfinite(attitude)
    print(f"motion found in {known.sum()} of {len(rows)}; {lost[known].sum():.0f} frames without a pose")
    for name, values, unit in (("attitude", attitude[known], "deg"), ("rate", rate[known], "deg/s")):
        print(f"error of the {name}: median {np.median(values):.2f}, largest {values.max():.2f} {unit}")
    print(f"{arguments.target or 'Envisat'}, seed {arguments.seed}, {' '.join(arguments.overrides)}; {machine()}")


if __name__ == "__main__":
    main()
