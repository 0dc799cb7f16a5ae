"""Missions with faults at random times: every one shall end at the mating point or in safety, without contact.

python benchmarks/rendezvous_faults.py [--missions 24] [--first 0] [--estimated]

With ``--estimated`` the chaser knows what its sensors tell, watches for 60 s, and the faults are those of camera and
inertial unit and an impulse on the target.
"""

from __future__ import annotations

import argparse
from collections import Counter

import numpy as np

from safe_inspect.config.data import configs_root
from safe_inspect.rendezvous.experiment import load_rendezvous
from safe_inspect.rendezvous.mission import Mission

_KINDS = ("camera", "imu", "planner", "solver")
_DURATIONS = (1.0, 8.0, 900.0)  # s: short, longer than what is tolerated, for good
_ESTIMATED_KINDS = ("tumble", "camera", "imu_bias", "imu")
_ESTIMATED_SETTINGS = ("mission.observe=60 s", "mission.wait_limit=10 s", "tumble={functor: RandomTumble}")
#: When faults begin: from the start, or from the end of the observation, to the end of the approach [s].
_BEGIN, _ESTIMATED_BEGIN = (0.0, 85.0), (62.0, 140.0)
_SETTINGS = (
    "mission.observe=1 s",
    "mission.checkout=0.4 s",
    "mission.wait_limit=10 s",
    "tumble={functor: RandomTumble}",
    "estimator.config.attitude_sigma=0.7 deg",
    "estimator.config.rate_sigma=0.07 deg/s",
)


def main() -> None:
    """Print how each mission ends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--missions", type=int, default=24)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--estimated", action="store_true")
    arguments = parser.parse_args()
    estimated = arguments.estimated
    kinds, settings = (_ESTIMATED_KINDS, _ESTIMATED_SETTINGS) if estimated else (_KINDS, _SETTINGS)
    path = configs_root() / "tumbling-rendezvous" / ("experiment.yml" if estimated else "experiment-truth.yml")
    ends: Counter[tuple[str, str]] = Counter()
    least = np.inf
    for number in range(arguments.first, arguments.first + arguments.missions):
        random = np.random.default_rng(number)
        kind, duration = kinds[number % len(kinds)], _DURATIONS[number // len(kinds) % len(_DURATIONS)]
        start = random.uniform(*(_ESTIMATED_BEGIN if estimated else _BEGIN))
        fault = f"mission.faults=[{{kind: {kind}, start: {start:.1f} s, duration: {duration} s}}]"
        result = Mission(load_rendezvous(path, [*settings, fault]).config, number).run()
        end = [event["data"]["to"] for event in result.log.events if event["event"] == "transition"][-1]
        summary = result.summary
        clearance = summary["least_clearance"]
        least = min(least, clearance)
        ends[kind, end] += 1
        states = "-".join(
            event["data"]["to"][:3]
            for event in result.log.events
            if event["event"] == "transition" and event["data"]["to"] != event["data"]["from"]
        )
        print(
            f"{number:4d} {kind:8} {start:5.1f} s for {duration:5.1f} s  {end:8} at {summary['time']:6.1f} s  "
            f"least clearance {100 * clearance:5.1f} cm  without an escape {summary['escape_missing']:3d}  "
            f"{summary['cause']}  {states}",
            flush=True,
        )
    for (kind, end), count in sorted(ends.items()):
        print(f"{kind:8} {end:8} {count}")
    print(f"least clearance {100 * least:.1f} cm")


if __name__ == "__main__":
    main()
