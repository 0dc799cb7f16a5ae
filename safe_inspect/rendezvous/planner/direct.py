"""The direct approach: a polynomial between two states that heeds no limits, for tests and comparisons."""

from __future__ import annotations

import numpy as np

from safe_inspect.dynamics.tumble import tumble
from safe_inspect.rendezvous.bound.transport import Path, TargetMotion, to_inertial, to_target, torque_free
from safe_inspect.rendezvous.planner.query import Plan, PlanQuery, PlanStatus
from safe_inspect.types import FloatArray

# Columns: value, first and second derivative at 0, then at 1; rows: coefficients of 1, s, .., s^5.
_QUINTIC = np.linalg.inv(
    np.array(
        [
            [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 2.0, 0.0, 0.0, 0.0],
            [1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
            [0.0, 1.0, 2.0, 3.0, 4.0, 5.0],
            [0.0, 0.0, 2.0, 6.0, 12.0, 20.0],
        ]
    )
)


def direct_approach(query: PlanQuery, step: float = 0.2) -> Plan:
    """Return the quintic polynomial in W from the query's state to the mating point, of the least jerk.

    It ends with the mating point's velocity and acceleration. Obstacles and limits are ignored, and the plan is
    called solved none the less. The first of the query's durations is taken, and no wait.

    Args:
        query: What to plan.
        step: Time between two samples [s].
    """
    duration = query.durations[0]
    since = step * np.arange(round(duration / step) + 1, dtype=np.float64)
    q, w = tumble(query.inertia, query.orientation[None], query.angular_velocity[None], since)
    motion = torque_free(query.inertia, q[0], w[0])
    end = to_inertial(
        TargetMotion(*(value[-1] for value in motion)), Path(query.mating_point, np.zeros(3), np.zeros(3))
    )
    start = Path(query.state[:3], query.state[3:], np.zeros(3))
    scale = np.array([1.0, duration, duration**2])[:, None]
    path = _polynomial(_QUINTIC @ np.vstack((scale * np.array(start), scale * np.array(end))), since, duration)
    inside = to_target(motion, path)
    return Plan(
        PlanStatus.SOLVED,
        query.t0,
        duration,
        times=query.t0 + since,
        position=path.position,
        velocity=path.velocity,
        acceleration=path.acceleration,
        force=query.limits.mass * path.acceleration,
        position_target=inside.position,
        velocity_target=inside.velocity,
        acceleration_target=inside.acceleration,
        orientation=motion.orientation,
        angular_velocity=motion.angular_velocity,
    )


def _polynomial(coefficients: FloatArray, since: FloatArray, duration: float) -> Path:
    """Return a polynomial of t / duration, coefficients (6, 3), and its derivatives at times (K,)."""
    derivatives = []
    for order in range(3):
        powers = (since[:, None] / duration) ** np.arange(len(coefficients))
        derivatives.append(powers @ coefficients / duration**order)
        coefficients = coefficients[1:] * np.arange(1, len(coefficients))[:, None]
    return Path(*derivatives)
