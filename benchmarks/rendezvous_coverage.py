"""Does the bound of the reference's error hold? Estimates from noisy poses of random tumbles, against the truth.

    python benchmarks/rendezvous_coverage.py --tumbles 1000
    python benchmarks/rendezvous_coverage.py --tumbles 200 --seconds 120 --edges

For each tumble a chaser at rest measures poses to the model (or relative poses, `--edges`) with errors of 0.5 degrees
that stay alike over 2 s, and knows the ratios of the moments as well as the fit assumes. The motion is fitted, and the
bound is made from trials that are drawn from the fit's covariance, without updates. The error of the estimated
reference along an approach of 60 s is then compared with the bound, at all times and axes of position, velocity and
force together. 95 % are asked for; the interval is Wilson's.
"""

from __future__ import annotations

import argparse
from typing import NamedTuple

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, exp, from_matrix, multiply
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.metrics.statistics import wilson
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.control.bound import (
    BoundQuery,
    ErrorSamples,
    conformal_bound,
    sample_errors,
    trial_streams,
)
from safe_inspect.rendezvous.estimate import JointErrors
from safe_inspect.rendezvous.estimation.characteriser import KnownBody, PolhodeCharacteriser
from safe_inspect.rendezvous.estimation.states import History, Motion, TargetEstimate, logits_of, ratios_of
from safe_inspect.rendezvous.planner.paths import SplinePath
from safe_inspect.rendezvous.planner.problem import Path, approach_problem, sampled_plan, to_inertial
from safe_inspect.rendezvous.planner.query import PlanQuery
from safe_inspect.rendezvous.plugins import EnvisatTarget, RandomTumble
from safe_inspect.rendezvous.poses import MODEL
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.simulators.resets.parameters import Draw
from safe_inspect.tasks.rendezvous.tumble_parameter import tumble_states
from safe_inspect.types import FloatArray

#: Chaser's attitude R_WB: it looks along y of W.
_CHASER = from_matrix(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
#: Standard deviation of a pose [rad], the time over which its errors stay alike [s], and the standard deviation of the
#: logits of the known ratios.
_VIEW, _MEMORY, _KNOWN = np.deg2rad(0.5), 2.0, 0.05


class _Truth(NamedTuple):
    """The true motion at the frames."""

    times: FloatArray
    orientation: FloatArray
    angular_velocity: FloatArray


def _measured(truth: _Truth, target: Target, streams: Streams, *, edges: bool) -> History:
    """Return what a chaser at rest measures, a frame a second."""
    count = len(truth.times)
    views = streams.normal("coverage.view", 3 * count)[0].reshape(count, 3) * _VIEW
    share = np.exp(-1.0 / _MEMORY)
    for k in range(1, count):
        views[k] = share * views[k - 1] + np.sqrt(1.0 - share**2) * views[k]
    chaser = np.tile(_CHASER, (count, 1))
    seen = multiply(conjugate(truth.orientation), chaser)  # q_TB
    glued = multiply(conjugate(seen[0]), seen)
    noisy = multiply(seen, exp(views))
    if edges:
        first, second = np.arange(count - 1), np.arange(1, count)
        rotation = multiply(conjugate(noisy[:-1]), noisy[1:])
        variance = 2.0 * (1.0 - share) * _VIEW**2
    else:
        first, second = np.full(count, MODEL), np.arange(count)
        rotation, variance = multiply(from_matrix(target.R_MT), noisy), _VIEW**2
    covariance = np.tile(variance * np.eye(3), (len(first), 1, 1))
    return History(truth.times, chaser, multiply(glued, exp(views)), first, second, rotation, covariance)


def _errors_of(found: TargetEstimate) -> JointErrors:
    joint = np.zeros((14, 14))
    order = [6, 7, 0, 1, 2, 3, 4, 5]
    joint[:8, :8] = found.covariance[np.ix_(order, order)]
    return JointErrors(0.0, 0.0, joint=joint)


def covered(number: int, seconds: int, *, edges: bool) -> tuple[bool, float] | None:
    """Return whether the bound of one tumble holds, and its largest width [m]; None without an estimate."""
    streams = Streams(11, np.array([number]), np.zeros(1, np.int64))
    target = EnvisatTarget()()
    (q0,), (w0,) = tumble_states("tumble", RandomTumble()(Draw(streams, "tumble")))
    times = np.arange(seconds + 1.0)
    q, w = (value[0] for value in tumble(target.principal, q0[None], w0[None], times))
    ratios = target.principal[:2] / target.principal[2]
    known = ratios_of(logits_of(ratios) + _KNOWN * streams.normal("coverage.ratios", 2)[0])
    body = KnownBody(known, None if edges else from_matrix(target.R_MT))
    characteriser = PolhodeCharacteriser(telescoping=0.0, memory=_MEMORY, drift=0.0)
    history = _measured(_Truth(times, q, w), target, streams, edges=edges)
    found = characteriser(history, body, before=Motion(0.0, q0, w0, logits_of(ratios)))
    if found is None:
        return None
    query = PlanQuery(
        t0=float(times[-1]),
        state=np.array([0.0, -1.5, 0.0, 0.0, 0.0, 0.0]),
        orientation=found.orientation,
        angular_velocity=found.angular_velocity,
        inertia=found.inertia,
        mating_point=target.mating_point,
        solid=target.solid,
        R_MT=target.R_MT,
    )
    problem = approach_problem(query, 0.0, 60.0, 20, 121)
    plan = sampled_plan(query, SplinePath(problem.basis, problem.cold()))
    trials = sample_errors(BoundQuery(plan, found.inertia, _errors_of(found), None), trial_streams(streams, 300))
    bound = conformal_bound(trials, 0.05, 100)
    elapsed = plan.times - times[-1]
    path = Path(plan.position_target, plan.velocity_target, plan.acceleration_target)
    estimated, true = (
        to_inertial(inertia, *(value[0] for value in tumble(inertia, a[None], b[None], elapsed)), path)
        for inertia, a, b in (
            (found.inertia, found.orientation, found.angular_velocity),
            (target.principal / target.principal[2], q[-1], w[-1]),
        )
    )
    position, velocity, acceleration = (a - b for a, b in zip(estimated, true, strict=True))
    error = ErrorSamples(plan.times, position[None], velocity[None], 9.583788668 * acceleration[None])
    return bool(bound.covers(error)[0]), float(bound.position.max())


def main() -> None:
    """Print the share of tumbles whose bound holds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tumbles", type=int, default=1000)
    parser.add_argument("--seconds", type=int, default=120, help="length of the observation")
    parser.add_argument("--edges", action="store_true", help="relative poses instead of poses to the model")
    options = parser.parse_args()
    held, widths = 0, []
    for number in range(options.tumbles):
        found = covered(number, options.seconds, edges=options.edges)
        if found is None:
            continue
        held += found[0]
        widths.append(found[1])
        count = len(widths)
        if count % 25 == 0 or number == options.tumbles - 1:
            low, high = wilson(held, count)
            print(
                f"{held} of {count} hold: {held / count:.3f} [{low:.3f}, {high:.3f}]; "
                f"median of the largest width {100.0 * np.median(widths):.1f} cm",
                flush=True,
            )


if __name__ == "__main__":
    main()
