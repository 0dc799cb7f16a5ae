"""A proof that a plan keeps its clearance from the target at all times, including those between its samples.

In T the chaser's speed is at most ``L = max |v| + max |w| max |p|``, where the path (`ApproachPath`) bounds the first
and the last factor, and the distance is 1-Lipschitz. In an interval of length h the distance is therefore at least
d(mid) - L h / 2. Intervals for which this does not prove the clearance are halved.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safe_inspect.dynamics.quaternion import to_matrix
from safe_inspect.dynamics.tumble import largest_rate, tumble
from safe_inspect.rendezvous.planner.path import ApproachPath
from safe_inspect.rendezvous.planner.query import ALLOWANCE, PlanQuery

_INTERVALS = 60


class Certificate(NamedTuple):
    """The result of a proof of clearance.

    Attributes:
        certified: Whether the clearance is proved.
        clearance: Lower bound of (distance - radius - margin) if certified, else a value that the path reaches [m].
        time: Time since the plan's start at which the proof failed [s]; NaN if certified.
        evaluations: Number of computed distances.
    """

    certified: bool
    clearance: float
    time: float
    evaluations: int


def certify(query: PlanQuery, path: ApproachPath, wait: float = 0.0, resolution: float = 1e-3) -> Certificate:
    """Prove that ``distance >= radius + margin - 1 cm`` at all times of a path; the 1 cm scales with the length of 1 m.

    The margin in an interval is the largest of its values at the two ends and in the middle.

    Args:
        query: The query.
        path: The path of a plan.
        wait: Time before the approach starts [s].
        resolution: Uncertainty of the distance below which an interval is not halved but counts as not clear [length].
    """
    allowance, resolution = ALLOWANCE * query.length, resolution * query.length
    rate = largest_rate(query.inertia, query.angular_velocity[None])[0]
    speed = float(path.largest_speed + rate * path.largest_distance)
    edges = np.linspace(0.0, path.duration, _INTERVALS + 1)
    left, right = edges[:-1], edges[1:]
    least, evaluations = np.inf, 0
    while len(left):
        middle = 0.5 * (left + right)
        p, _, _ = path.at(middle)
        q, _ = tumble(query.inertia, query.orientation[None], query.angular_velocity[None], wait + middle)
        in_target = np.einsum("kji,kj->ki", to_matrix(q[0]), p)
        margin = np.max([query.margin(left), query.margin(middle), query.margin(right)], axis=0)
        spare = query.boxes.distance(in_target @ query.R_MT.T) - query.limits.radius - margin
        bound = spare - 0.5 * speed * (right - left)
        evaluations += len(middle)
        clear = bound >= -allowance
        least = min(least, float(bound[clear].min(initial=np.inf)))
        failed = ~clear & ((spare < -allowance) | (speed * (right - left) < 2.0 * resolution))
        if failed.any():
            worst = int(np.where(failed, spare, np.inf).argmin())
            return Certificate(False, float(spare[worst]), float(middle[worst]), evaluations)
        left, middle, right = left[~clear], middle[~clear], right[~clear]
        left, right = np.concatenate((left, middle)), np.concatenate((middle, right))
    return Certificate(True, least, float("nan"), evaluations)
