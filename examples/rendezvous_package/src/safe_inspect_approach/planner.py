"""A planner of one's own: a path, and the certificate of the package."""

import numpy as np

from safe_inspect.dynamics.tumble import tumble
from safe_inspect.rendezvous.interfaces import (
    Plan,
    PlanQuery,
    PlanReport,
    PlanStatus,
    SampledPath,
    certify,
    mating_state,
    plan_mistake,
    sampled_plan,
)
from safe_inspect.rendezvous.plugins import ApproachPlanner

#: Rows: values and first two derivatives of 1, s, .., s^5 at s = 0, then at s = 1.
_ENDS = np.array(
    [[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, 2, 0, 0, 0],
     [1, 1, 1, 1, 1, 1], [0, 1, 2, 3, 4, 5], [0, 0, 2, 6, 12, 20]], dtype=float,
)  # fmt: skip


class DirectPlanner(ApproachPlanner):
    """The straight way: the polynomial of least jerk to the mating point, after the first wait that leaves it clear."""

    def __call__(self, query: PlanQuery) -> Plan:
        """Return the first plan that keeps the limits and the clearance."""
        for duration in query.durations:
            for wait in query.waits:
                path = direct_path(query, wait, duration)
                plan = sampled_plan(query, path, wait)
                if not plan_mistake(query, plan) and certify(query, path, wait).certified:
                    return plan
        report = PlanReport(message="no straight way is clear and within the limits")
        return Plan(PlanStatus.NOT_CONVERGED, query.t0, query.durations[0], report=report)


def direct_path(query: PlanQuery, wait: float, duration: float) -> SampledPath:
    """Return the polynomial in W from the chaser's state to that of the mating point, sampled at the control's step."""
    q, w = tumble(query.inertia, query.orientation[None], query.angular_velocity[None], np.array([wait + duration]))
    start = np.stack((query.state[:3], query.state[3:], np.zeros(3)))
    scale = np.array([1.0, duration, duration**2])[:, None]
    coefficients = np.linalg.solve(_ENDS, np.vstack((scale * start, scale * mating_state(query, q[0, 0], w[0, 0]))))
    times = np.linspace(0.0, duration, round(duration / query.step) + 1)
    powers = (times[:, None] / duration) ** np.arange(6)
    slopes = np.arange(1, 6) * powers[:, :5] / duration
    return SampledPath(times, powers @ coefficients, slopes @ coefficients[1:])
