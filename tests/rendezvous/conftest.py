"""A plan to a tumbling target that heeds no limits."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.geometry.oriented_boxes import OrientedBoxes
from safe_inspect.rendezvous.planner.paths import SplinePath
from safe_inspect.rendezvous.planner.problem import approach_problem, sampled_plan
from safe_inspect.rendezvous.planner.query import Plan, PlanQuery


@pytest.fixture(scope="session")
def query() -> PlanQuery:
    """An approach from 1.5 m at rest, to a target that turns at 5 degrees per second."""
    rate = np.array([0.7, 0.5, 0.5])
    return PlanQuery(
        t0=0.0,
        state=np.array([0.0, -1.5, 0.0, 0.0, 0.0, 0.0]),
        orientation=np.array([0.1, -0.3, 0.5, 0.8]) / np.sqrt(0.99),
        angular_velocity=np.deg2rad(5.0) * rate / np.linalg.norm(rate),
        inertia=np.array([0.1314, 0.9661, 1.0]),
        mating_point=np.array([0.25, 0.0, 0.42]),
        solid=OrientedBoxes(np.zeros((1, 3)), np.full((1, 3), 0.1), np.eye(3)[None]),
        R_MT=np.eye(3),
    )


@pytest.fixture(scope="session")
def plan(query) -> Plan:
    return unobstructed_plan(query)


def unobstructed_plan(query: PlanQuery) -> Plan:
    """Return the cheapest approach of a query, whatever is in its way."""
    problem = approach_problem(query, 0.0, 60.0, 20, 121)
    return sampled_plan(query, SplinePath(problem.basis, problem.cold()))
