"""Does the bound of the reference's error hold through the whole chain, from depth frames to the approach?

    python benchmarks/rendezvous_bound.py [--target upper_stage] [--tumbles 200] [--seed 1] [OVERRIDE ...]

Missions are flown until the approach starts. The estimate of that moment is propagated along the plan without updates,
and so is the true motion. The bound holds if the difference of the two references, as the chaser sees them, is within
it at all times and on all axes, of position, velocity and force together. 95 % are asked for; the interval is
Wilson's. Missions that never start an approach are counted apart.
"""

from __future__ import annotations

import numpy as np
from machine import machine
from tumbles import FOLDER, Job, measured, parsed

from safe_inspect.dynamics.quaternion import conjugate, multiply, rotate
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.metrics.statistics import wilson
from safe_inspect.missions.mission import Mission
from safe_inspect.rendezvous.coordination.context import Following, MissionContext
from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.rendezvous.experiment import RendezvousConfig, load_rendezvous
from safe_inspect.rendezvous.planner.problem import Path, to_inertial
from safe_inspect.types import FloatArray


def _reference(
    following: Following, inertia: FloatArray, time: float, chaser: BodyState, target: BodyState
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return position, velocity and acceleration of a plan's reference relative to the chaser, propagated from a time.

    They are in axes that turn with neither body and equal those of the chaser at that time, shape (K, 3) each.
    """
    plan, back = following.plan, conjugate(chaser.orientation)
    states = multiply(back, target.orientation), target.angular_velocity
    q, w = (value[0] for value in tumble(inertia, *(state[None] for state in states), plan.times - time))
    path = Path(plan.position_target, plan.velocity_target, plan.acceleration_target)
    centre = rotate(back, target.position - chaser.position)
    position, velocity, acceleration = to_inertial(inertia, q, w, path, centre)
    return position, velocity - rotate(back, chaser.velocity - target.velocity), acceleration


class _Approach(Mission):
    """A mission that compares the error of the reference with its bound when the approach starts."""

    def __init__(self, config: RendezvousConfig, number: int) -> None:
        super().__init__(config, number, watch=self._compare)
        self.ratios: tuple[float, ...] = ()
        self._mass, self._inertia = config.chaser.mass, config.target().principal

    def _compare(self, context: MissionContext) -> None:
        following, estimate = context.following, context.estimate
        if following is None or self.ratios:
            return
        bound, truth = following.unrenewed, self._truth
        seen = _reference(following, estimate.inertia, estimate.time, estimate.chaser, estimate.target)
        true = _reference(following, self._inertia, estimate.time, truth.chaser, truth.target)
        found = []
        for value, other, width in zip(
            seen, true, (bound.position, bound.velocity, bound.force / self._mass), strict=True
        ):
            error = rotate(estimate.chaser.orientation, value - other)
            found.append(float((np.abs(error).max(axis=1) / width).max()))
        self.ratios = (*found, float(bound.position.max()))


def _measure(job: Job) -> tuple[float, ...]:
    """Return the largest ratios of error to bound of position, velocity and force, and the largest width [m]."""
    overrides, number, _ = job
    mission = _Approach(load_rendezvous(f"{FOLDER}/experiment.yml", overrides).config, number)
    for _ in mission.steps():
        if mission.ratios:
            return mission.ratios
    return (np.nan,) * 4


def main() -> None:
    """Print a line for each mission and the share of those whose bound holds."""
    assert __doc__ is not None
    arguments = parsed(__doc__, None, 200)
    rows = []
    for number, row in enumerate(measured(_measure, arguments)):
        rows.append(row)
        text = "no approach" if np.isnan(row[3]) else (
            f"error relative to the bound: position {row[0]:.2f}, velocity {row[1]:.2f}, force {row[2]:.2f}; "
            f"bound {100.0 * row[3]:.1f} cm"
        )  # fmt: skip
        print(f"mission {number} of {arguments.tumbles}: {text}", flush=True)
    started = [row for row in rows if np.isfinite(row[3])]
    print(f"{len(started)} of {len(rows)} missions start an approach")
    if not started:
        return
    position, velocity, force, width = np.array(started).T
    largest = np.maximum(np.maximum(position, velocity), force)
    for name, ratio in (("all together", largest), ("position", position), ("velocity", velocity), ("force", force)):
        held = int((ratio <= 1.0).sum())
        low, high = wilson(held, len(ratio))
        print(f"{name}: {held} of {len(ratio)} hold [{low:.3f}, {high:.3f}]; "
              f"error relative to the bound: median {np.median(ratio):.2f}, largest {ratio.max():.2f}")  # fmt: skip
    print(f"largest width of the bound: {100.0 * np.median(width):.1f} cm in the median")
    print(f"{arguments.target or 'Envisat'}, seed {arguments.seed}, {' '.join(arguments.overrides)}; {machine()}")


if __name__ == "__main__":
    main()
