"""What is left of the filter's guarantee where thrust turns with the body while it is held?

    python benchmarks/turning_filter.py [--rows 512] [--steps 200]

The `backup` filter certifies thrusts along Hill's axes. Here they are given to thrusters of a vehicle that turns, in
body axes, at the attitude at the beginning or in the middle of each hold, which is known before the hold as attitude
does not depend on thrust. The filter counts on 1 / sqrt(3) N along each of Hill's axes, which thrusters of 1 N give at
any attitude. Starts and adversaries are those of `rta_filter.py`.
"""

from __future__ import annotations

import argparse
import math

import numpy as np
from rta_filter import desired_controls, starts

from safe_inspect.dynamics import ClohessyWiltshireAttitude
from safe_inspect.dynamics.base import advance_kernel
from safe_inspect.dynamics.quaternion import rotate_back
from safe_inspect.random.streams import Streams
from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.constraints import RelativeState
from safe_inspect.simulators.resets.initializers import drawn_attitude
from safe_inspect.simulators.resets.parameters import Draw
from safe_inspect.types import FloatArray

HOLD, MASS, RATE = 10.0, 12.0, 0.001027
VEHICLE = ClohessyWiltshireAttitude(mean_motion=RATE)
TURNS = ("rests in inertial space", "turns at its first rate", "full moments at random")


class Body:
    """R bodies that fly from a state."""

    def __init__(self, start: RelativeState, turns: str, seed: int) -> None:
        rows = len(start)
        streams = Streams(seed, np.arange(rows), np.zeros(rows, dtype=np.int64))
        rate = np.zeros((rows, 3)) if turns == TURNS[0] else 0.01 * (2.0 * streams.uniform("rate", 3) - 1.0)
        attitude = drawn_attitude(Draw(streams, "attitude"))
        self.arrays = [array[:, None].copy() for array in (start.position, start.velocity, attitude, rate)]

    def advance(self, control: FloatArray, seconds: float) -> None:
        """Hold a control, shape (R, 6), for some seconds."""
        rows = len(control)
        counters = np.zeros((rows, 1)), np.zeros(rows), np.zeros(rows, dtype=np.int64)
        mass = np.array([MASS])
        advance_kernel(VEHICLE, seconds)(*VEHICLE(seconds), *self.arrays, control[:, None], mass, seconds, 1, *counters)

    def attitude_in(self, moment: FloatArray, seconds: float) -> FloatArray:
        """Return the attitudes after some seconds under a held moment, shape (R, 4)."""
        ahead = object.__new__(Body)
        ahead.arrays = [array.copy() for array in self.arrays]
        if seconds:
            ahead.advance(np.concatenate((np.zeros_like(moment), moment), axis=1), seconds)
        return ahead.arrays[2][:, 0]


def fly(start: RelativeState, steps: int, turns: str, ahead: float) -> None:
    """Fly filtered adversaries, and print which shares of the flights broke each constraint."""
    run, body, theta = BackupFilter({"u_max": 1.0 / math.sqrt(3.0)}), Body(start, turns, 0), start.sun_angle.copy()
    generator, moments = np.random.default_rng(1), np.random.default_rng(2)
    kind = np.arange(len(start)) % 6
    least, lost = np.full((len(start), len(run.names)), np.inf), np.zeros(len(start))
    for step in range(steps):
        state = RelativeState(body.arrays[0][:, 0], body.arrays[1][:, 0], theta)
        result = run(state, desired_controls(state, kind, step, generator))
        lost += result.infeasible
        moment = np.zeros((len(start), 3))
        if turns == TURNS[2]:
            moment = moments.choice([-1e-3, 1e-3], (len(start), 3))
        thrust = rotate_back(body.attitude_in(moment, ahead), result.control)
        body.advance(np.concatenate((np.clip(thrust, -1.0, 1.0), moment), axis=1), HOLD)
        theta = theta + RATE * HOLD
        least = np.minimum(least, run.phi(RelativeState(body.arrays[0][:, 0], body.arrays[1][:, 0], theta)))
    where = "middle" if ahead else "beginning"
    print(f"\n{turns}, thrust turned at the {where} of the hold: {len(start) * steps:,} steps")
    print(f"  flights of {steps} steps that break a constraint: {100.0 * (least < 0.0).any(axis=1).mean():.1f} %")
    print(f"  steps without a plan: {100.0 * lost.sum() / (len(start) * steps):.3f} %")
    for j, name in enumerate(run.names):
        print(
            f"  {name:18}{100.0 * (least[:, j] < 0.0).mean():7.1f} % of flights, smallest phi {least[:, j].min():10.3g}"
        )


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=512)
    parser.add_argument("--steps", type=int, default=200)
    arguments = parser.parse_args()
    drawn = starts(2 * arguments.rows + 8, 0)
    plans = BackupFilter({"u_max": 1.0 / math.sqrt(3.0)}).recoverable(drawn)
    start = drawn[np.flatnonzero(plans)[: arguments.rows]]
    for turns in TURNS:
        for ahead in (0.0, 0.5 * HOLD):
            fly(start, arguments.steps, turns, ahead)


if __name__ == "__main__":
    main()
