"""A proof that a plan keeps clear of the target between its samples too.

In T the chaser moves at most at ``L = max |v| + max |w| max |p|``, with the first and last factor bounded by the path
(`ApproachPath`), and the distance is 1-Lipschitz. So an interval of length h is clear by d(mid) - L h / 2; those that
are not shown to be clear are halved.
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
    """The outcome: whether the plan is clear, and by how much.

    Attributes:
        certified: Whether the clearance is proved.
        clearance: Lower bound of (distance - radius - margin) where certified, else a value that is reached [m].
        time: Where the proof failed, since the plan's start [s]; nan where certified.
        evaluations: Number of distances computed.
    """

    certified: bool
    clearance: float
    time: float
    evaluations: int


def certify(query: PlanQuery, path: ApproachPath, wait: float = 0.0, resolution: float = 1e-3) -> Certificate:
    """Return whether ``distance >= radius + margin - 1 cm`` at all times of a path, 1 cm for a length of 1 m.

    The margin over an interval is taken as the largest of its values at the two ends and in the middle.

    Args:
        query: The query.
        path: The path of a plan.
        wait: Time before the approach starts [s].
        resolution: Uncertainty of the distance below which an interval counts as not clear [length].
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
